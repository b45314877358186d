# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The relay beside upstream's nodes: robots of one kind are told apart, whosever nodes they and the station run."""

import shutil

import pytest
from machines.layout import Extra
from machines.podman import ROOT
from proofs.proof import table
from proofs.twins import tell_apart
from subject import lab_of
from upstream import MOUNTS, SETUP, UPSTREAM

ROBOTS = {f"kobuki{number}": f"kobuki{number}-pc" for number in (1, 2, 3, 4)}
STATION = "station-pc"
PROVIDED = f"multimaster_provider: fkie_existing\nmultimaster_ros_setup: {SETUP}\n"
COPIED = "the model is this robot's"  # a parameter, which upstream's nodes do not copy


@pytest.fixture
def fleet_rests():
    """The robots stay as they are between the tests."""


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """The shipped inventory with the same programs on each robot. Upstream's nodes are there, and nobody runs them yet."""
    inventory = tmp_path_factory.mktemp("relay") / "inventory"
    shutil.copytree(ROOT / "inventory" / "identical_robots", inventory)
    mounts = tuple(f"{source}:{target}" for target, source in MOUNTS.items())
    hosts = (*ROBOTS.values(), STATION)
    with lab_of("relay-beside", inventory, {host: Extra((), mounts) for host in hosts}) as found:
        for host in hosts:
            found.run(host, UPSTREAM.ready)
        yield found


@pytest.mark.parametrize(("upstreams", "without"), [(("kobuki1", "kobuki2"), ()), (("station",), (COPIED,))])
def test_robots_are_told_apart_beside_upstreams_nodes(lab, upstreams, without):
    for robot in upstreams:
        with (lab.inventory / "group_vars" / f"{robot}.yml").open("a") as file:
            file.write(PROVIDED)
    status, output = lab.play("site.yml")
    assert status == 0, output
    for host in ROBOTS.values():  # a roscore that is another one knows no nodes
        lab.start(host, "robot", "python3 {script}", "programs/twin_robot.py")
    robots = {robot: lab.computer(host) for robot, host in ROBOTS.items()}
    results = list(tell_apart(robots, lab.computer(STATION)))
    assert len(results) == 8 * len(ROBOTS) + 1
    assert {result.what for result in results if not result.ok} == {*without}, table(results)
    assert not {"/scan", "/reset"} & set(lab.run(STATION, "rostopic list; rosservice list").split())
    status, output = lab.play("playbooks/verify.yml")
    assert status == 0 and "PASSED" in output, output
