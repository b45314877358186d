# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""site.yml is the preflight and one role, which brings those that forward to their plan first."""

import pathlib

import yaml

ROOT = pathlib.Path(__file__).resolve().parents[3]
COMPUTER = "rosfleet.multimaster.multimaster_computer"


def read(path):
    return yaml.safe_load((ROOT / path).read_text(encoding="utf-8"))


BROUGHT = [task for task in read("roles/computer/tasks/main.yml") if COMPUTER in task and "check_mode" not in task]


def test_site_is_preflight_and_the_role_of_a_computer():
    roles = [entry["role"] for play in read("playbooks/site.yml") for entry in play.get("roles", ())]
    assert roles == ["rosfleet.multimaster.preflight", "rosfleet.multimaster.computer"]
    assert len((ROOT / "playbooks/site.yml").read_text(encoding="utf-8").splitlines()) <= 60


def test_those_that_forward_come_first():
    assert [task["when"] for task in BROUGHT] == [
        "multimaster_plan.is_router or multimaster_plan.is_gateway",
        "not multimaster_plan.is_router",
    ]
    way, computer = (task[COMPUTER] for task in BROUGHT)
    assert set(way) == {"sysctl", "routes", "firewall"} < set(computer)


def test_a_gateway_is_brought_to_each_concern_once():
    way = read("roles/computer/vars/main.yml")["computer_way"]
    assert set(way) == {"sysctl", "routes", "firewall"}
    for concern, value in way.items():
        assert value.startswith("{{ none if multimaster_plan.is_gateway else ")
        assert BROUGHT[1][COMPUTER][concern] == f"{{{{ computer_way.{concern} }}}}"


def test_a_packet_filter_is_tried_before_anything_changes():
    tasks = [task for task in read("roles/computer/tasks/main.yml") if COMPUTER in task]
    assert tasks[0]["check_mode"] is True and "firewall" in tasks[0][COMPUTER]


def test_the_warnings_of_each_task_are_repeated_at_the_end():
    summary = read("playbooks/site.yml")[-1]["post_tasks"][-1]["rosfleet.multimaster.fleet_summary"]
    compared = read("roles/preflight/tasks/compare.yml")[0]["register"]
    predicted = read("playbooks/site.yml")[1]["post_tasks"][0]["register"]
    assert {compared, predicted, *(task["register"] for task in BROUGHT)} <= set(summary["warnings"])
