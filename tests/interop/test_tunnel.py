# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Upstream's nodes in a tunnel of the collection: they know nothing of it, and use it."""

import shutil

import pytest
from machines.layout import Extra
from machines.podman import ROOT
from subject import lab_of
from upstream import MOUNTS, SETUP, UPSTREAM

HOSTS = ("ana-pc", "bob-pc", "dan-gate", "dan-arm")
PROVIDED = {"multimaster_provider": "fkie_existing", "multimaster_ros_setup": SETUP}


@pytest.fixture
def fleet_rests():
    """The robots stay as they are between the tests."""


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """Three robots with upstream's nodes, in the place of those of the other files. The keys are kept beside the inventory."""
    inventory = tmp_path_factory.mktemp("tunnel") / "inventory"
    shutil.copytree(ROOT / "tests" / "systems" / "tunnel", inventory)
    mounts = tuple(f"{source}:{target}" for target, source in MOUNTS.items())
    with lab_of("in-tunnel", inventory, {host: Extra((), mounts) for host in HOSTS}) as found:
        for host in HOSTS:
            found.run(host, UPSTREAM.ready)
        status, output = found.play("site.yml", variables=PROVIDED)
        assert status == 0, output
        yield found


def test_all_is_proved_inside_the_tunnel(lab):
    status, output = lab.play("playbooks/verify.yml", variables=PROVIDED)
    assert status == 0 and "PASSED: none of" in output, output


def test_its_masters_are_known_by_their_addresses_in_it(lab):
    said = lab.run("bob-pc", "timeout -k 5 10 rosservice call /master_discovery/list_masters")
    assert said.count("online: True") == 3 and "10.77.0.21" in said, said
