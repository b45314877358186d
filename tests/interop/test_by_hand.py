# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The two robots of Fig. 5 with upstream's nodes, set up by hand as the report says: verified from the inventory alone."""

import pytest
from machines.layout import Extra
from machines.podman import ROOT
from setups import manual_setup
from subject import lab_of
from upstream import MOUNTS, SETUP, UPSTREAM

FIRST, SECOND = "kobuki1computer", "kobuki2computer"
ADDRESSES = {FIRST: "192.168.1.229", SECOND: "192.168.1.239"}
WORKSPACE = {"multimaster_ros_setup": SETUP}
PROGRAMS = manual_setup.programs_of(
    *(f"env {UPSTREAM.environment} python3 {UPSTREAM.program(node)}" for node in ("discovery", "sync"))
)


@pytest.fixture
def fleet_rests():
    """The robots stay as they are between the tests."""


@pytest.fixture(scope="module")
def lab():
    """These robots, in the place of those of the other files."""
    mounts = tuple(f"{source}:{target}" for target, source in MOUNTS.items())
    with lab_of(
        "by-hand", ROOT / "inventory" / "single_computer", {host: Extra((), mounts) for host in ADDRESSES}
    ) as lab:
        for host in ADDRESSES:
            lab.run(host, UPSTREAM.ready)
        with manual_setup.robots(lab, ADDRESSES, PROGRAMS, f". {SETUP}"):
            yield lab


def test_robots_that_talk_pass_and_drift_is_named(lab):
    status, output = lab.play("playbooks/verify.yml", variables=WORKSPACE)
    assert status == 0, output
    assert "PASSED: none of" in output
    for host in ADDRESSES:
        assert f"nothing conflicts with the plan: {host}" in output
    assert f'UDP port 11511 and TCP port 11611: "python3 {UPSTREAM.program("discovery")}' in output
    for host in (FIRST, SECOND):
        assert f"the nodes on {host} were started by hand" in output
    assert "follows: services are active (1)" in output


QUICK = {**WORKSPACE, "verify_patience": 3}
# Verification's own topics do not cross, all others do.
SELECTIVE = f"{PROGRAMS[manual_setup.SYNC]} _ignore_topics:='[/multimaster_verify/*]'"


def start(lab, unit, command):
    manual_setup.start(lab, SECOND, unit, f". {SETUP}; exec {command}")


def refusal(lab):
    """The output of verify.yml, which fails."""
    status, output = lab.play("playbooks/verify.yml", variables=QUICK)
    assert status != 0, output
    return output


def test_a_discovery_node_that_does_not_run_is_named(lab):
    lab.run(SECOND, f"systemctl stop {manual_setup.DISCOVERY}")
    output = refusal(lab)
    start(lab, manual_setup.DISCOVERY, PROGRAMS[manual_setup.DISCOVERY])
    assert f"the discovery node of {SECOND} does not run" in output


@pytest.mark.parametrize(
    ("unit", "said"),
    [
        # Upstream's discovery node asks the services of its robot, and waits for this one: it may be named before.
        (manual_setup.SYNC, f"the sync node of {SECOND} does not run"),
        (manual_setup.DISCOVERY, f"1. the discovery node of {SECOND} runs and does not answer"),
    ],
)
def test_a_node_that_hangs_is_named(lab, unit, said):
    lab.run(SECOND, f"systemctl kill --signal STOP {unit}")
    output = refusal(lab)
    lab.run(SECOND, f"systemctl kill --signal CONT {unit}")
    assert said in output, output


def test_a_sync_node_with_a_filter_is_named(lab):
    lab.run(SECOND, f"systemctl stop {manual_setup.SYNC}")
    start(lab, manual_setup.SYNC, SELECTIVE)
    output = refusal(lab)
    lab.run(SECOND, f"systemctl stop {manual_setup.SYNC}")
    start(lab, manual_setup.SYNC, PROGRAMS[manual_setup.SYNC])
    assert "takes other topics and services than planned" in output, output


def test_site_yml_still_refuses_and_does_not_print_the_plan(lab):
    status, output = lab.play("site.yml", variables=WORKSPACE)
    assert status != 0
    assert f"{FIRST}: TCP port 11311 is held by" in output and "set multimaster_roscore to 'existing'" in output
    assert '"sysctl"' not in output and '"environment"' not in output
