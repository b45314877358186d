# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Computers that the collection did not set up: what is told of them, and what is not judged."""

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._faults.fault import CONTROLLER
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.preflight import MachineState
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.engine import FAILED, UNKNOWN, WARNING
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.components.component import FOLLOWS
from fleets import ONE, ROBOTS, components, diagnosed, evaluate, fig12, notable, update

HELD = (
    f"{ONE}: TCP port 11311 is held by rosmaster (pid 812, user robot), but the plan has multimaster-roscore.service."
)
OURS = ("services", "environment", "packet_filter", "next_boot_unit", "parameters")


def _found(**values):
    """The facts that preflight found on the first computer; no program of the collection runs there."""

    def change(seen):
        update(seen[ONE], found=MachineState(**values))
        for service in seen[ONE].probe.services:
            update(service, load_state="not-found", active_state="inactive", sub_state="dead")

    return change


def test_nodes_started_by_hand_are_named_before_site_yml():
    found = notable(evaluate(_found(set_up=False, runs=(HELD,))))
    assert {check: finding.verdict for (check, _observer, _target), finding in found.items()} == {
        **dict.fromkeys(OURS, UNKNOWN),
        "as_planned": WARNING,
    }
    assert found["as_planned", ONE, ONE].found == HELD.partition(": ")[2]
    for check in OURS:
        assert found[check, ONE, ONE].found == "the collection has not set this computer up"
    told = diagnosed(_found(set_up=False, runs=(HELD,)))
    assert components(told) == [("set_up", ONE, "others")]
    assert told.findings[0].do[-1].where == CONTROLLER


def test_a_new_idle_computer_is_one_finding():
    found = notable(evaluate(_found(set_up=False)))
    assert found["services", ONE, ONE].verdict == found["set_up", ONE, ONE].verdict == FAILED
    told = diagnosed(_found(set_up=False))
    assert components(told) == [("set_up", ONE, "never")] and [one.where for one in told.findings[0].do] == [CONTROLLER]


def test_a_computer_of_the_collection_is_judged_at_any_ports():
    found = notable(evaluate(_found(set_up=True, runs=(HELD,))))
    assert found["services", ONE, ONE].verdict == FAILED
    assert found["as_planned", ONE, ONE].verdict == WARNING


def test_what_site_yml_would_refuse_is_a_warning():
    def change(seen):
        update(seen[ONE], found=MachineState(noted=(f"{ONE}: systemd does not run it.",)))

    found = notable(evaluate(change))
    assert [(finding.check, finding.verdict, finding.found) for finding in found.values()] == [
        ("as_planned", WARNING, "systemd does not run it.")
    ]
    assert components(diagnosed(change)) == [("set_up", ONE, "refused")]


def test_a_second_computer_is_of_the_robot_of_its_master():
    inner = "tibi-nav"
    master = fig12().master_of["tibi"].computer

    def verdicts(master_is_ours):
        def change(seen):
            update(seen[inner], found=MachineState(set_up=False))
            update(seen[master], found=MachineState(set_up=master_is_ours, runs=() if master_is_ours else (HELD,)))
            for service in seen[inner].probe.services:
                update(service, load_state="not-found", active_state="inactive")

        return {finding.verdict for finding in notable(evaluate(change, fig12())).values() if finding.observer == inner}

    assert inner in ROBOTS["tibi"][3]
    assert verdicts(master_is_ours=False) == {UNKNOWN}
    assert FAILED in verdicts(master_is_ours=True)


def test_an_interface_in_the_network_of_another_robot_is_a_warning_of_its_own():
    what = "br0 has 192.168.10.1/24, in the network of dabo (192.168.10.0/24)"
    told = diagnosed(lambda seen: update(seen[ONE], found=MachineState(overlaps=(what,))))
    assert components(told) == [("interface", ONE, "overlap")]
    assert what in told.findings[0].sentence() and "daemon.json" in told.findings[0].do[0].text


def test_a_route_that_an_overlap_turns_away_follows_from_it():
    assert ("interface", "overlap") in FOLLOWS["route", "other"]
    assert ("interface", "address") in FOLLOWS["interface", "overlap"]
