# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Things that work now and not after the next boot: one part for each kind of it, and nothing else is suspected."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.preflight import MachineState
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.engine import (
    FAILED,
    OK,
    UNKNOWN,
    WARNING,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import BootDeviation
from fleets import ONE, assert_told, diagnosed, evaluate, fig12, notable, update
from mentioned import mentions

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
