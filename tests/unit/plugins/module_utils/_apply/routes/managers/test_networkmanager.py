# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The back end for NetworkManager, over profiles held here; the real daemon is in the Molecule scenario `routes`."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes.boot import Boot
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes.kernel import RouteSpec
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes.managers import contract
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes.managers import networkmanager as nm
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes.record import read_record
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base import commands
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.network import NetworkInterface
from hypothesis import given
from hypothesis import strategies as st

UUID = "7a9f2a3e-5d3f-4f9f-8a63-4a6a2c7d1e01"
PLACE = "nmcli:" + UUID
FILE = "/etc/NetworkManager/system-connections/eth0.nmconnection"
STATIC = RouteSpec("192.168.11.0/24", "192.168.1.201", "eth0")
LINE = "ipv4.routes 192.168.11.0/24 192.168.1.201 0"
OWNERS = "ipv4.routes 10.77.0.0/16 192.168.1.1"


class Daemon:
    """Profiles by uuid, and nmcli in front of them as far as the back end uses it."""

    def __init__(self, lines=(), refuse=""):
        self.lines, self.refuse, self.calls = {UUID: list(lines)}, refuse, []
        self.settings = {"connection.autoconnect": "yes", "ipv4.method": "manual", "ipv6.method": "manual"}

    def __call__(self, *words):
        self.calls.append(words)
        if words[:2] == ("--fields", "DEVICE,CON-UUID,STATE"):
            return answer("eth0:%s:connected\nlo:%s:connected (externally)\nwlan0::disconnected" % (UUID, "1-2"))
        if "UUID,FILENAME" in words:
            return answer("%s:%s\n1-2:/run/NetworkManager/system-connections/lo.nmconnection" % (UUID, FILE))
        uuid = words[words.index("uuid") + 1]
        if uuid not in self.lines:
            return commands.Answer(10, b"", "Error: %s - no such connection profile." % uuid)
        if "modify" in words:
            return self.modify(uuid, words[words.index("uuid") + 2 :])
        routes = {setting: [] for setting in ("ipv4.routes", "ipv6.routes")}
        for line in self.lines[uuid]:
            setting, _space, route = line.partition(" ")
            routes[setting].append(route)
        values = dict(self.settings, **{setting: ", ".join(listed) for setting, listed in routes.items()})
        return answer("\n".join("%s:%s" % pair for pair in values.items()))

    def modify(self, uuid, words):
        if self.refuse:
            return commands.Answer(1, b"", "Error: %s." % self.refuse)
        for setting, route in zip(words[::2], words[1::2]):
            line = "%s %s" % (setting[1:], route)
            if setting[0] == "+":
                self.lines[uuid].append(line)
            else:
                self.lines[uuid].remove(line)
        return answer("")


def answer(text):
    return commands.Answer(0, text.encode(), "")


@pytest.fixture
def daemon(monkeypatch):
    held = Daemon([OWNERS])
    monkeypatch.setattr(nm, "nmcli", held)
    monkeypatch.setattr(nm.shutil, "which", lambda name, path: "/usr/bin/nmcli")
    return held


def back_end(recorded=None, booted=True):
    machine = contract.MachineContext(
        {name: NetworkInterface(name, index) for index, name in enumerate(("lo", "eth0", "wlan0"), 1)}, booted
    )
    return nm.BackEnd(machine, recorded or {})


@pytest.mark.parametrize(
    ("route", "line"),
    [
        (STATIC, LINE),
        (RouteSpec("0.0.0.0/0", "192.168.1.201", "eth0", metric=50), "ipv4.routes 0.0.0.0/0 192.168.1.201 50"),
        (RouteSpec("226.0.0.0/8", "", "eth0"), "ipv4.routes 226.0.0.0/8 0"),
        (RouteSpec("10.6.0.0/16", type="blackhole"), "ipv4.routes 10.6.0.0/16 0 type=blackhole"),
        (RouteSpec("fd00:11::/64", "fd00:1::201", "eth0", 1024), "ipv6.routes fd00:11::/64 fd00:1::201 1024"),
        (
            RouteSpec("10.5.0.0/16", "192.168.1.9", "eth0", 30, 100, "192.168.1.13", True),
            "ipv4.routes 10.5.0.0/16 192.168.1.9 30 onlink=true src=192.168.1.13 table=100",
        ),
    ],
)
def test_a_route_is_a_line(route, line):
    assert nm.format_line(route, 0) == line
    version = 6 if line.startswith("ipv6") else 4
    assert nm.parse_lines(version, line.partition(" ")[2], UUID) == [line]


def test_a_profile_with_its_own_table_gets_the_table_main():
    assert nm.format_line(STATIC, 100) == LINE + " table=254"
    assert nm.format_line(STATIC._replace(table=100), 100) == LINE


def test_nmclis_order_and_form_do_not_matter():
    printed = "10.5.1.0/16 192.168.1.9 30 table=100 src=192.168.1.13, FD00:11:0::/64 fd00:1:0::201"
    assert nm.parse_lines(4, printed.split(", ", maxsplit=1)[0], UUID) == [
        "ipv4.routes 10.5.0.0/16 192.168.1.9 30 src=192.168.1.13 table=100"
    ]
    assert nm.parse_lines(6, printed.split(", ")[1], UUID) == ["ipv6.routes fd00:11::/64 fd00:1::201"]


def test_an_unknown_form_is_named():
    with pytest.raises(Problem, match='ipv4.routes "{ ip = 10.0.0.0/8 }"'):
        nm.parse_lines(4, "{ ip = 10.0.0.0/8 }", UUID)


def test_owns_what_it_has_activated_itself(daemon):
    assert back_end().list_interfaces() == {"eth0"}
    assert back_end(booted=False).list_interfaces() == set()


def test_place_of_an_active_profile(daemon):
    assert back_end().find_place("eth0") == PLACE


@pytest.mark.parametrize(
    ("active", "words"),
    [
        (None, "no profile is active"),
        (nm.Active(UUID, True, "/run/NetworkManager/system-connections/eth0.nmconnection"), "connected .externally."),
        (
            nm.Active(UUID, False, "/run/NetworkManager/system-connections/eth0.nmconnection"),
            "only in memory .*nmcli connection modify",
        ),
        (
            nm.Active(UUID, False, "/run/NetworkManager/system-connections/netplan-eth0.nmconnection"),
            "choose the backend netplan",
        ),
    ],
)
def test_a_profile_that_brings_nothing_back_is_named(active, words):
    end = back_end()
    end._active = {} if active is None else {"eth0": active}
    with pytest.raises(Problem, match="eth0 .*" + words):
        end.find_place("eth0")


def test_a_profile_of_two_interfaces_is_refused():
    end = back_end()
    end._active = {"eth0": nm.Active(UUID, False, FILE), "wlan0": nm.Active(UUID, False, FILE)}
    with pytest.raises(Problem, match="active on wlan0 too"):
        end.find_place("eth0")


def test_a_route_is_added_beside_others_and_taken_away_again(daemon):
    end = back_end()
    wanted = end.render(PLACE, {"eth0": [STATIC]})
    assert wanted == LINE + "\n"
    end.check({PLACE: wanted})
    end.write(PLACE, wanted)
    assert daemon.lines[UUID] == [OWNERS, LINE]

    later = back_end({PLACE: [LINE + "\n"]})
    assert later.read() == {PLACE: wanted}
    assert later.render(PLACE, {"eth0": [STATIC]}) == wanted
    assert later.render(PLACE, {}) is None
    later.write(PLACE, None)
    assert daemon.lines[UUID] == [OWNERS]


@pytest.mark.parametrize("recorded", [True, False])
def test_a_profile_that_loses_its_routes_is_planned(daemon, tmp_path, recorded):
    """The plan of production, without any route."""
    daemon.lines[UUID].append(LINE)
    place = {"backend": "networkmanager", "texts": [LINE + "\n"], "routes": [STATIC._asdict()]}
    eth0 = contract.MachineContext({"eth0": NetworkInterface("eth0", 2)}, True, str(tmp_path))
    plan = Boot(eth0, read_record({"boot": {"places": {PLACE: place}}} if recorded else {}))
    plan.plan({})
    assert plan.wanted == ({PLACE: None} if recorded else {})
    assert plan.changes == ({"networkmanager": [PLACE]} if recorded else {})
    plan.apply()
    assert daemon.lines[UUID] == ([OWNERS] if recorded else [OWNERS, LINE])


def test_a_change_is_one_step_and_can_be_taken_back(daemon):
    daemon.lines[UUID].append(LINE)
    end = back_end({PLACE: [LINE + "\n"]})
    other = end.render(PLACE, {"eth0": [STATIC._replace(gateway="192.168.1.202")]})
    end.write(PLACE, other)
    assert [words for words in daemon.calls if "modify" in words] == [
        ("connection", "modify", "uuid", UUID)
        + ("-ipv4.routes", "192.168.11.0/24 192.168.1.201 0")
        + ("+ipv4.routes", "192.168.11.0/24 192.168.1.202 0")
    ]
    end.write(PLACE, LINE + "\n")
    assert daemon.lines[UUID] == [OWNERS, LINE]


def test_a_route_that_the_profile_has_by_itself_is_not_ours(daemon):
    daemon.lines[UUID].append(LINE)
    assert back_end().render(PLACE, {"eth0": [STATIC]}) is None


def test_a_refusal_is_a_sentence_and_changes_nothing(daemon):
    daemon.refuse = "Insufficient privileges"
    with pytest.raises(Problem, match='refuses the change of the profile %s ."Insufficient privileges"' % UUID):
        back_end().write(PLACE, LINE + "\n")
    assert daemon.lines[UUID] == [OWNERS]


def test_a_profile_that_is_gone_holds_nothing(daemon):
    del daemon.lines[UUID]
    end = back_end({PLACE: [LINE + "\n"]})
    assert end.read() == {}
    end.write(PLACE, None)
    with pytest.raises(Problem, match="is gone"):
        end.write(PLACE, LINE + "\n")


@pytest.mark.parametrize(
    ("setting", "value", "words"),
    [("connection.autoconnect", "no", "autoconnect no"), ("ipv4.method", "disabled", "ipv4.method disabled")],
)
def test_a_profile_without_routes_at_boot_is_refused_before(daemon, setting, value, words):
    daemon.settings[setting] = value
    end = back_end()
    with pytest.raises(Problem, match=words):
        end.check({PLACE: end.render(PLACE, {"eth0": [STATIC]})})
    end.check({PLACE: None})


LINES = ["ipv4.routes 10.%d.0.0/16 192.168.1.1 0" % number for number in range(8)]
SOME = st.lists(st.sampled_from(LINES), unique=True)


@given(profile=SOME, texts=st.lists(SOME, max_size=2), wanted=SOME)
def test_any_record_keeps_foreign_items(profile, texts, wanted):
    daemon = Daemon(profile)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(nm, "nmcli", daemon)
        patch.setattr(nm.shutil, "which", lambda name, path: "/usr/bin/nmcli")
        recorded = {PLACE: ["".join(line + "\n" for line in sorted(lines)) for lines in texts]}
        end = back_end(recorded)
        routes = [RouteSpec(line.split()[1], "192.168.1.1", "eth0") for line in wanted]
        content = end.render(PLACE, {"eth0": routes})
        end.write(PLACE, content)
        ours = {line for lines in texts for line in lines}
        assert set(daemon.lines[UUID]) == (set(profile) - ours) | set(wanted)
        assert [line for line in daemon.lines[UUID] if line in profile and line not in ours] == [
            line for line in profile if line not in ours
        ]
        assert len(daemon.lines[UUID]) == len(set(daemon.lines[UUID]))
        assert back_end({PLACE: [content or ""]}).read().get(PLACE) == content
