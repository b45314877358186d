# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""teardown.yml takes back what site.yml brings, in the order in which nothing is missed."""

import pathlib

import yaml

ROOT = pathlib.Path(__file__).resolve().parents[3]
COMPUTER = "rosfleet.multimaster.multimaster_computer"
INFO = "rosfleet.multimaster.multimaster_info"


def read(path):
    return yaml.safe_load((ROOT / path).read_text(encoding="utf-8"))


TAKE, CLOSE = [play for play in read("playbooks/teardown.yml") if "hosts" in play]
TASKS = [*TAKE["tasks"], *read("playbooks/tasks/close.yml")]
RUNS = [task[COMPUTER] for task in TASKS if COMPUTER in task]


def test_every_concern_is_taken_back():
    (computer,) = [
        task[COMPUTER] for task in read("roles/computer/tasks/main.yml") if "shells" in task.get(COMPUTER, {})
    ]
    assert {concern for run in RUNS for concern in run} == set(computer) - {"shells"}


def test_every_bundle_is_taken_back():
    bundles = [
        bundle["bundle"]
        for run in RUNS
        for kind in ("managed_files", "managed_services")
        for bundle in run.get(kind, ())
    ]
    assert sorted(bundles) == [
        "clock",
        "environment",
        "multicast_routing",
        "multicast_routing",
        "multimaster",
        "nodes",
    ]


def test_services_end_before_their_files_go():
    assert [list(run) for run in RUNS if "managed_services" in run] == [["managed_services"]] == [list(RUNS[0])]


def test_what_is_asked_about_was_looked_at():
    (look,) = [task[INFO] for task in TASKS if INFO in task]
    assert {"owned", "sshd"} <= set(look["parts"])


def test_the_last_words_come_after_a_look_at_what_is_left():
    look, say = CLOSE["tasks"][-2:]
    assert "owned" in look[INFO]["parts"]
    summary = say["rosfleet.multimaster.fleet_summary"]
    assert summary["after"] == look["register"]
    registered = [task["register"] for task in TASKS if COMPUTER in task]
    assert summary["results"] == registered and set(registered) <= set(summary["warnings"])
    assert [task["register"] for task in TAKE["tasks"] if INFO in task] == [summary["before"]]
