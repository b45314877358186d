# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Things that work now and not after the next boot: one part for each kind of it, and nothing else is suspected."""

from dataclasses import replace

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.preflight import MachineState
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.engine import (
    FAILED,
    OK,
    UNKNOWN,
    WARNING,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import BootDeviation
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.outcomes import Outcome
from fleets import ONE, TWO, assert_told, diagnosed, evaluate, fig12, notable, of, update
from mentioned import mentions

NODES = ("discovery", "sync")
LATER = "/etc/sysctl.d/99-x.conf line 2 sets 0"


def _undone(kind, computer=ONE):
    return lambda seen: update(seen[computer].probe, next_boot=(BootDeviation(kind, "the thing", "1", LATER),))


@pytest.mark.parametrize(
    ("kind", "computer", "fleet"),
    [("unit", ONE, None), ("sysctl", ONE, None), ("names", ONE, None), ("route", "tibi-nav", fig12())],
)
def test_each_kind_is_a_component(kind, computer, fleet):
    assert_told(_undone(kind, computer), f"next_boot_{kind}", FAILED, "boot", computer, kind, fleet=fleet)


def test_the_row_tells_the_reading_and_the_finding_the_thing():
    (row,) = notable(evaluate(_undone("sysctl"))).values()
    assert (row.found, row.expected) == (f"the thing: {LATER}", "1")
    (finding,) = diagnosed(_undone("sysctl")).findings
    assert mentions(finding.sentence(), "kobuki1computer", "next boot")


@pytest.mark.parametrize(("runs", "verdicts"), [((), set()), (("a roscore",), {UNKNOWN})])
def test_a_computer_without_the_collection_is_not_judged(runs, verdicts):
    def change(seen):
        _undone("sysctl")(seen)
        update(seen[ONE], found=MachineState(set_up=False, runs=runs))

    found = {(row.check, row.verdict) for row in evaluate(change) if row.observer == ONE}
    assert {verdict for check, verdict in found if check.startswith("next_boot")} == verdicts


def test_the_router_has_no_names_and_no_services():
    checks = {row.check for row in evaluate(fleet=fig12()) if row.observer == "router" and row.verdict == OK}
    assert {check for check in checks if check.startswith("next_boot")} == {"next_boot_sysctl", "next_boot_route"}


@pytest.mark.parametrize(("computer", "verdict"), [("tibi-visio", FAILED), ("tibi-nav", WARNING)])
def test_modules_that_are_gone_are_a_fault_of_the_next_start(computer, verdict):
    sentence = f"{computer}: the ROS of /opt/ros/noetic/setup.bash lacks the Python modules rospy; expected them for the nodes."

    def change(seen):
        update(seen[computer], found=MachineState(broken_ros=sentence, noted=(sentence,)))

    rows = notable(evaluate(change, fleet=fig12()))
    assert rows["next_start", computer, computer].verdict == verdict
    assert rows["next_start", computer, computer].found.startswith("the ROS of /opt/ros")
    (finding,) = diagnosed(change, fleet=fig12()).findings
    assert (finding.component.kind, finding.component.place) == ("ros", computer)


def test_services_that_start_in_vain_follow_from_a_ros_that_is_gone():
    """As in the lab: rospy was removed, its nodes started again, and site.yml would refuse to mend their units."""
    sentence = f"{ONE}: There is no ROS 1: neither /opt/ros/<distro>/setup.sh nor Debian's python3-rospy."

    def change(seen):
        update(seen[ONE], found=MachineState(broken_ros=sentence, noted=(sentence,)))
        services = seen[ONE].probe.services
        loops = {"active_state": "activating", "sub_state": "start", "restarts": 6, "result": "exit-code", "status": 1}
        refused = {"open": False, "error": "Connection refused", "outcome": Outcome.REFUSED}
        port = of(seen[TWO].probe.masters, ONE, "computer")
        update(port, **refused, clock_offset_s=None, clock_error="no answer")
        update(seen[ONE].probe, services=tuple(replace(one, **loops) if one.name in NODES else one for one in services))

    (finding,) = diagnosed(change).findings
    assert (finding.component.kind, finding.component.mode, finding.component.place) == ("ros", "broken", ONE)
    assert "reinstall" in finding.do[0].text
