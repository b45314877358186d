# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""teardown.yml takes back at once what the roles take back one after the other."""

import pathlib

import pytest
import yaml

ROOT = pathlib.Path(__file__).resolve().parents[3]
PREFIX = "rosfleet.multimaster."
SEVERAL = ("managed_files", "managed_services")  # concerns with a run for each bundle
ROLES = ("services", "multicast_routing", "nodes", "environment", "hosts", "sysctl", "routes")


def read(path):
    return yaml.safe_load((ROOT / path).read_text(encoding="utf-8"))


def tasks_of(entries):
    """All tasks, also those of blocks."""
    for task in entries:
        yield task
        yield from tasks_of(task.get("block", ()))


TAKE, CLOSE = [play for play in read("playbooks/teardown.yml") if "hosts" in play]
TASKS = [*tasks_of(TAKE["pre_tasks"]), *tasks_of(read("playbooks/tasks/close.yml"))]


def taken_back():
    """Each concern of multimaster_computer with its options."""
    for task in TASKS:
        for concern, options in task.get(PREFIX + "multimaster_computer", {}).items():
            for one in options if concern in SEVERAL else [options]:
                yield concern, one


def of_roles():
    """The same out of the roles."""
    for role in ROLES:
        for task in read(f"roles/{role}/tasks/absent.yml"):
            for concern in ("sysctl", "routes", "hosts_entries", *SEVERAL):
                if PREFIX + concern in task and task[PREFIX + concern].get("bundle") != "packages":
                    yield concern, task[PREFIX + concern]


def as_text(options):
    """Where a role has registered what it saw, the playbook has looked once."""
    return str(options).replace("environment_found", "teardown_found")


def test_the_same_is_taken_back_at_once_and_by_the_roles():
    at_once = sorted((concern, as_text(options)) for concern, options in taken_back())
    assert at_once == sorted((concern, as_text(options)) for concern, options in of_roles())


def test_services_end_before_their_files_go():
    runs = [list(task[PREFIX + "multimaster_computer"]) for task in TASKS if PREFIX + "multimaster_computer" in task]
    assert [run for run in runs if "managed_services" in run] == [["managed_services"]] == runs[:1]


@pytest.mark.parametrize("part", ["owned", "packages", "sshd"])
def test_what_is_asked_about_was_looked_at(part):
    (look,) = [task[PREFIX + "multimaster_info"] for task in TASKS if PREFIX + "multimaster_info" in task]
    assert part in look["parts"]


def test_where_packages_or_a_packet_filter_are_to_go_the_roles_do_all():
    imported = [task["ansible.builtin.import_role"]["name"] for task in TAKE["tasks"]]
    assert imported == [PREFIX + role for role in ROLES[:5]]
    (one_by_one,) = [task for task in read("playbooks/tasks/close.yml") if "block" in task]
    assert one_by_one["when"] == "'files-firewall' in teardown_found.owned"
    roles = [task["ansible.builtin.import_role"]["name"].removeprefix(PREFIX) for task in one_by_one["block"]]
    assert roles == ["firewall", "sysctl", "routes"]
