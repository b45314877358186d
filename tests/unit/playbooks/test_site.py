# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""What site.yml looks at before it leaves a computer alone is what the roles would do."""

import pathlib

import pytest
import yaml

ROOT = pathlib.Path(__file__).resolve().parents[3]
PREFIX = "rosfleet.multimaster."
CONFIRMING = {"confirm_within"}
ROUTER = ("sysctl", "routes")  # all that a router needs


def read(path):
    return yaml.safe_load((ROOT / path).read_text(encoding="utf-8"))


PLAY = next(play for play in read("playbooks/site.yml") if "pre_tasks" in play)
LOOKED_AT = PLAY["vars"]["site_due"]
BROUGHT = PLAY["module_defaults"][PREFIX + "multimaster_computer"]
CHANGING = ("sysctl", "routes", "hosts_entries", "managed_files", "managed_services")


def tasks_of(role):
    """The tasks of a role that change the machine: module -> its options."""
    for task in read(f"roles/{role}/tasks/main.yml"):
        for module in CHANGING:
            if PREFIX + module in task:
                yield module, task[PREFIX + module]


ALWAYS = [entry["role"].removeprefix(PREFIX) for entry in PLAY["roles"]]
ALWAYS = [
    role for role in ALWAYS if role not in ("firewall", "multicast_routing")
]  # where these are due, nothing is left out
TASKS = [(role, module, options) for role in ALWAYS for module, options in tasks_of(role)]


@pytest.mark.parametrize(("role", "module", "options"), TASKS, ids=[f"{role}-{module}" for role, module, _o in TASKS])
def test_a_role_is_looked_at_with_its_own_options(role, module, options):
    if options.get("bundle") == "packages":  # due by what preflight found, see `other`
        assert "{{ nodes_changes.new }}" in LOOKED_AT["other"]
        return
    looked = LOOKED_AT[module]
    if isinstance(looked, list):
        (looked,) = [one for one in looked if one["bundle"] == options["bundle"]]
    expected = {name: value for name, value in options.items() if name not in {*CONFIRMING, "brief"}}
    if role == "nodes":  # by digests: the contents need not travel
        expected["files"] = "{{ nodes_sums.files }}"
        assert options["files"] == "{{ nodes_planned }}"
    assert looked == expected


def test_what_is_looked_at_is_what_is_brought():
    (look,) = [task[PREFIX + "multimaster_due"] for task in PLAY["pre_tasks"] if PREFIX + "multimaster_due" in task]
    assert list(BROUGHT) == [*CHANGING, "shells"]
    for concern in CHANGING:
        assert look[concern] == (
            f"{{{{ site_due.{concern} }}}}"
            if concern in ROUTER
            else f"{{{{ omit if multimaster_plan.is_router else site_due.{concern} }}}}"
        )
        within = f" | combine({{'confirm_within': {concern}_confirm_within}})"
        assert concern == "managed_files" or BROUGHT[concern] == (
            f"{{{{ site_due.{concern}{within} }}}}"
            if concern in ROUTER
            else f"{{{{ none if multimaster_plan.is_router else site_due.{concern} }}}}"
        )
    # The files of the nodes travel where they are to be written.
    (nodes,) = [options for role, _module, options in TASKS if options.get("bundle") == "nodes"]
    assert BROUGHT["managed_files"].split(" else ")[1].strip(" }\n") == (
        "[site_due.managed_files[0], {'bundle': 'nodes', 'files': nodes_planned, 'brief': [nodes_library]}]"
    )
    assert nodes == {"bundle": "nodes", "files": "{{ nodes_planned }}", "brief": ["{{ nodes_library }}"]}


def test_every_computer_is_brought_once_and_those_that_forward_first():
    (block,) = [task["block"] for task in PLAY["pre_tasks"] if "block" in task]
    conditions = [task["when"] for task in block if PREFIX + "multimaster_computer" in task]
    assert conditions == [
        "multimaster_plan.is_router",
        "multimaster_plan.is_gateway",
        "not multimaster_plan.is_router",
    ]
    _router, gateway, computer = (task[PREFIX + "multimaster_computer"] for task in block)
    assert gateway == dict.fromkeys(("hosts_entries", "managed_files", "managed_services", "shells"))
    assert computer == {
        concern: f"{{{{ none if multimaster_plan.is_gateway else {BROUGHT[concern].strip('{} ')} }}}}".replace(
            "'} }}", "} }}"
        )
        for concern in ROUTER
    }


def test_every_concern_has_a_task():
    assert {module for _role, module, _options in TASKS} == set(CHANGING)


def test_a_firewall_and_the_routing_of_multicast_are_never_left_out():
    conditions = " ".join(PLAY["pre_tasks"][0]["when"])
    for role in ("firewall", "multicast_routing"):
        assert f"not multimaster_plan.{role}_due" in conditions
