# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The units: order and digests; their whole texts are in golden/providers and golden/multicast_routing."""

import hashlib
import pathlib
import re

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import quoting, units

GOLDEN = pathlib.Path(__file__).resolve().parents[3] / "golden/multicast_routing"
ADDRESS = "192.168.1.201"
ROSCORE = units.Roscore("/usr/bin/roscore", 11311)
INTERFACES = ["eth1", "eth0"]


def made(names, inputs):
    programs = units.programs("bundled", "/usr/bin/python3", {})
    return {unit.name: unit.content for unit in units.services(names, "tibi", ADDRESS, ROSCORE, programs, inputs)}


def test_the_units_have_the_order_of_the_services():
    names = ["discovery", "roscore"]
    assert list(made(names, units.Inputs("a", "b"))) == [f"multimaster-{name}.service" for name in names]


def test_the_roscore_depends_on_the_environment_alone():
    old, new = (made(["roscore", "sync"], units.Inputs.of("environment", nodes)) for nodes in ("old", "new"))
    assert old["multimaster-roscore.service"] == new["multimaster-roscore.service"]
    assert old["multimaster-sync.service"] != new["multimaster-sync.service"]
    digest = hashlib.sha256(b"environmentnew").hexdigest()
    assert f"Environment=ROSFLEET_INPUTS={digest}\n" in new["multimaster-sync.service"]


def test_a_unit_ends_with_a_newline():
    assert all(
        text.endswith("multi-user.target\n")
        for text in made(["address", "roscore", "sync"], units.Inputs("", "")).values()
    )


def test_the_own_address_is_a_local_route_that_is_found_again_by_its_mark():
    """The text of the stop is that of the new address already when a planned address changes: it may not name one."""
    (text,) = made(["address"], units.Inputs("", "")).values()
    commands = dict(re.findall(r"^(Exec\w+)=-?(.*)$", text, re.M))
    assert commands["ExecStart"] == (
        "/sbin/ip -4 route replace local 192.168.1.201/32 dev lo table local proto 84 metric 84"
    )
    assert commands["ExecStop"] == commands["ExecStartPre"] == "/sbin/ip -4 route flush table local proto 84"
    assert set(re.findall(r"[\w-]+\.service", re.findall(r"^Before=.*$", text, re.M)[0])) == {
        f"multimaster-{name}.service" for name in ("roscore", "discovery", "sync")
    }


def test_no_unit_waits_for_a_network():
    """A target of the network is reached late or never on a robot that is switched on alone."""
    texts = [*made(["address", "roscore", "discovery", "sync"], units.Inputs("", "")).values()]
    texts.append(units.multicast_router("tibi", "239.255.11.11", INTERFACES, "/usr/sbin/smcrouted", "feed").content)
    assert len(texts) == 5
    for text in texts:
        assert not re.search(
            r"network|ifup|dhcp|time-sync", "".join(re.findall(r"^(?:After|Wants|Requires)=.*", text, re.M))
        )


def test_the_multicast_router():
    unit = units.multicast_router("tibi", "239.255.11.11", INTERFACES, "/usr/sbin/smcrouted", "feed")
    assert unit.content == (GOLDEN / unit.name).read_text(encoding="utf-8")
    routes = units.multicast_routes("tibi", "239.255.11.11", INTERFACES)
    assert routes == (GOLDEN / "smcroute.conf").read_text(encoding="utf-8")


def test_names_of_interfaces_are_arguments_and_no_commands():
    unit = units.multicast_router("tibi", "239.255.11.11", ["eth0;reboot", 'a"$(id)%n'], "/usr/sbin/smcrouted", "feed")
    assert 'exit 1\' sh "eth0;reboot" "a\\"$$(id)%%n"\n' in unit.content
    assert unit.content.count("reboot") == 1


@pytest.mark.parametrize("path", ["+/bin/sh", "/tmp/x\nExecStartPre=+/bin/sh", "bin/roscore", ""])
def test_a_path_that_systemd_would_read_otherwise_is_refused(path):
    with pytest.raises(quoting.Unquotable, match="expected an absolute path"):
        units.programs("fkie_existing", "/usr/bin/python3", {"discovery": path, "sync": "/opt/sync"})
    with pytest.raises(quoting.Unquotable, match="expected an absolute path"):
        units.services(["roscore"], "tibi", ADDRESS, units.Roscore(path, 11311), {}, units.Inputs("", ""))


def test_the_name_of_a_robot_is_a_text():
    unit = units.services(["roscore"], "50%h", ADDRESS, ROSCORE, {}, units.Inputs("", ""))[0]
    assert "Description=ROS master of 50%%h (roscore)\n" in unit.content
    with pytest.raises(quoting.Unquotable, match="on one line"):
        units.services(["roscore"], "tibi\n[Service]", ADDRESS, ROSCORE, {}, units.Inputs("", ""))
