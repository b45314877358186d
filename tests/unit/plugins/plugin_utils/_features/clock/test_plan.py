# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The clock of a computer: whom it follows, the files of chrony, and time services of somebody else."""

from dataclasses import replace

import pytest
from ansible_collections.rosfleet.multimaster.plugins.filter.clock_files import clock_files
from ansible_collections.rosfleet.multimaster.plugins.module_utils._features.clock import facts as machine
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain import to_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._features.clock import plan as clock
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._features.clock.model import Clock
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory.read import InventoryProblems
from fleets import fig12, plan, sealed

NOTHING = {"chronyd": "", "enabled": False, "settable": True, "others": [], "restart_due": False, "sources": []}
OTHERS = {
    service: [{"service": service, "file": "/etc/chrony/x.conf", "line": "server 192.0.2.1"}]
    for service in ("chrony.service", "ntpsec.service", "systemd-timesyncd.service")
}


def look(computer, clock_name="tibi-nav", **found):
    """The plan of a computer of Fig. 12 with what its machine is like, and the warnings."""
    of = fig12(multimaster_clock=clock_name).computers[computer]
    info = {"clock": {**NOTHING, **found}}
    return clock.add_machine(Clock.find(of), info), list(clock.list_clock_warnings(of, info))


def list_packages(planned):
    of = fig12().computers["tibi-nav"]
    return clock.list_clock_packages(replace(of, features={"clock": planned} if planned else {}), {})


def text(planned):
    return {file["path"]: file["content"] for file in clock.render_clock(planned)}


def test_without_a_source_nothing_is_planned():
    assert {Clock.find(of) for of in fig12().computers.values()} == {None}
    assert clock.render_clock(None) == [] == clock_files({}) and list_packages(None) == ()
    assert "clock" not in to_plain(fig12().computers["tibi-nav"])
    assert all("clock" not in of.look_at.parts for of in fig12().computers.values())


def test_each_computer_follows_the_address_that_it_reaches():
    """Within the robot that of its own network; from elsewhere that of the gateway in the common network."""
    by_gateway = fig12(multimaster_clock="tibi-visio").computers
    assert Clock.find(by_gateway["tibi-visio"]).server is None
    assert str(Clock.find(by_gateway["tibi-nav"]).server) == "192.168.11.101"
    assert str(Clock.find(by_gateway["dabo-nav"]).server) == "192.168.1.201"
    inner = fig12(multimaster_clock="tibi-nav").computers
    assert {str(found.server) for of in inner.values() if (found := Clock.find(of))} == {"None", "192.168.11.100"}
    assert Clock.find(inner["router"]) is None  # it has no ROS
    assert [str(network) for network in Clock.find(inner["tibi-nav"]).networks] == [
        "192.168.1.0/24",
        "192.168.11.0/24",
        "192.168.10.0/24",
        "192.168.12.0/24",
    ]


def test_a_robot_means_the_computer_of_its_master():
    assert Clock.find(plan(multimaster_clock="kobuki2").computers["kobuki1computer"]).source == "kobuki2computer"


@pytest.mark.parametrize(("name", "words"), [("tibi-naf", "did you mean tibi-nav?"), ("router", "no such computer")])
def test_a_source_that_is_none_is_a_sentence(name, words):
    with pytest.raises(InventoryProblems) as found:
        fig12(multimaster_clock=name)
    assert f"multimaster_clock is '{name}'" in str(found.value) and words in str(found.value)


def test_a_sealed_computer_is_no_source():
    with pytest.raises(InventoryProblems) as found:
        sealed(multimaster_clock="hsr")
    assert "hsrb is sealed" in str(found.value)


def test_a_follower_has_one_source():
    planned, warnings = look("dabo-nav", chronyd="/usr/sbin/chronyd", enabled=True)
    files = text(planned)
    assert list(files) == [clock.CONFIGURATION, clock.DROP_IN] == list(machine.OURS) and not warnings
    lines = files[clock.CONFIGURATION].splitlines()
    assert [line for line in lines if line.startswith(("server", "pool", "include", "local", "allow"))] == [
        "server 192.168.11.100 iburst minpoll 2 maxpoll 4"
    ]
    assert f"-F 1 -f {clock.CONFIGURATION}" in files[clock.DROP_IN] and "Condition" not in files[clock.DROP_IN]
    assert clock_files(to_plain(planned)) == clock.render_clock(planned) and list_packages(planned) == ("chrony",)


def test_a_source_keeps_its_own_and_answers_the_fleet():
    planned, _warnings = look("tibi-nav", others=OTHERS["chrony.service"])
    lines = text(planned)[clock.CONFIGURATION].splitlines()
    assert lines[1:3] == ["include /etc/chrony/chrony.conf", "local stratum 10"]
    assert len([line for line in lines if line.startswith("allow ")]) == 4


def test_a_clock_that_cannot_be_set_is_measured():
    planned, warnings = look("dabo-nav", settable=False)
    assert " -x -f " in text(planned)[clock.DROP_IN] and "ConditionCapability=\n" in text(planned)[clock.DROP_IN]
    assert "CAP_SYS_TIME" in warnings[0]


def test_a_service_that_does_not_start_at_boot_is_told():
    assert "does not start at boot" in look("dabo-nav", chronyd="/usr/sbin/chronyd")[1][0]


@pytest.mark.parametrize(
    ("computer", "service", "kept"),
    [
        ("dabo-nav", "chrony.service", True),
        ("dabo-nav", "ntpsec.service", True),
        ("dabo-nav", "systemd-timesyncd.service", True),
        ("tibi-nav", "ntpsec.service", True),
        ("tibi-nav", "chrony.service", False),
    ],
)
def test_what_somebody_has_configured_stays(computer, service, kept):
    planned, warnings = look(computer, others=OTHERS[service])
    assert bool(planned.kept) is kept
    assert bool(clock.render_clock(planned)) is not kept and bool(list_packages(planned)) is not kept
    assert [service in line and "/etc/chrony/x.conf" in line for line in warnings] == [True] * kept


def test_a_source_with_another_file_than_its_own_is_kept():
    """The collection's would not include that one."""
    other = {
        "service": "chrony.service",
        "file": "/etc/default/chrony",
        "line": 'DAEMON_OPTS="-F 1 -f /etc/chrony/lab.conf"',
    }
    planned, warnings = look("tibi-nav", others=[other])
    assert planned.kept == "chrony.service" and not clock.render_clock(planned) and "/etc/default/chrony" in warnings[0]
