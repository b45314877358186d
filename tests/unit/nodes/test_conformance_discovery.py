# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""An own master_discovery towards multimaster_fkie 1.3.2: what of the checklist (16.A, by number) and of the defects of its
original (15, by number) no test of one part holds."""

import os
import pathlib
import shutil
import subprocess
import sys
import xmlrpc.client

import pytest
from mentioned import mentions
from rosfleet_multimaster.discovery.core.actions import Send
from rosfleet_multimaster.discovery.core.discovery import Discovery
from rosfleet_multimaster.discovery.core.peer import Contact
from rosfleet_multimaster.edge import local_roscore
from rosfleet_multimaster.edge.rpc_client import Rpc
from rosfleet_multimaster.edge.rpc_server import PerCaller, RefusedCall, RpcServer
from rosfleet_multimaster.protocol.filters import NAMES, Filters
from rosfleet_multimaster.protocol.graph import (
    ExportPolicy,
    State,
    add_stamps,
    build,
    document,
    graph_of,
    local_types,
    stamp_text,
)
from rosfleet_multimaster.protocol.heartbeat import Heartbeat, Kind, Stamp, decode, encode
from rosfleet_multimaster.protocol.messages import AnnouncedMaster
from rosfleet_multimaster.protocol.parameters import DISCOVERY, ParameterError, Settings, overlay
from rosfleet_multimaster.protocol.wire_filters import read_rules, write_rules
from virtual_time import Robot, World

NODES = pathlib.Path(__file__).parents[3] / "roles/nodes/files/python"
HERE, THERE = "192.168.1.229", "192.168.1.239"
URI = "http://robot1:11311/"
OWN = AnnouncedMaster("robot1", URI, f"http://{HERE}:11611", "/master_discovery", 1000.0, 1000.0, True)
CONTACT = Contact(2000.0, "http://robot2:11311/", "robot2", "/master_discovery")


def core(**settings):
    return Discovery(Settings(**settings), ["127.0.0.1", HERE], 11611)


def running(**settings):
    made = core(**settings)
    made.take_own_state(OWN, 0.0)
    made.tick(6.0)
    made.actions.clear()
    return made


def beat(stamp=2000, rate=0.0, kind=Kind.STATE):
    return encode(Heartbeat(kind, 11611, rate, Stamp(stamp), Stamp(stamp)))


def take(made, kind):
    found = [action for action in made.actions if isinstance(action, kind)]
    made.actions.clear()
    return found


SYSTEM = [
    [["/chatter", ["/talker", "/far"]], ["/secret", ["/talker"]]],
    [["/chatter", ["/listener"]], ["/theirs", ["/listener"]]],
    [["/add", ["/adder"]], ["/far/add", ["/far"]]],
]
SYSTEM[0].append(["/theirs", ["/far"]])
TYPES = [["/chatter", "std_msgs/String"], ["/secret", "own_msgs/Key"], ["/theirs", "evil_msgs/Import"]]
URIS = {name: f"http://robot1:{at}/" for at, name in enumerate(["/talker", "/listener", "/adder"], 40000)}
URIS["/far"] = "http://robot2:40000/"
SERVICES = {"/add": "rosrpc://inner:5000", "/far/add": "rosrpc://robot2:5000"}
ORIGINS = {("/far", URIS["/far"]): CONTACT.uri}


def state(system=None, types=None, uris=None, origins=None):
    graph = graph_of(State(URI, "robot1"), SYSTEM if system is None else system, TYPES if types is None else types)
    return build(graph, URIS if uris is None else uris, SERVICES, ORIGINS if origins is None else origins)


STATE = add_stamps(state(), None, 1700000000.123456)


def told(caller, **parameters):
    values, _warnings = overlay(DISCOVERY, parameters)
    return document(*ExportPolicy.from_parameters(values).view(STATE, caller))


# 16.A

ON_THE_WIRE = """
import socket
from rosfleet_multimaster.protocol.heartbeat import Heartbeat, Kind, Stamp, encode
from rosfleet_multimaster.discovery.udp import Udp
udp = Udp("226.0.0.0", 11511, "192.168.1.1", True)
second = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)  # upstream's options
second.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
second.bind(("", 11511))
second.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton("226.0.0.0") + socket.inet_aton("192.168.1.1"))
second.setsockopt(socket.IPPROTO_IP, 12, 1)  # IP_RECVTTL
second.settimeout(3.0)
udp.send(encode(Heartbeat(Kind.STATE, 11611, 1.0, Stamp(0x01020304, 5), Stamp(6, 7))), None)
data, ancillary, _flags, source = second.recvmsg(1024, 1024)
assert data.hex() == "52020a00" "04030201" "05000000" "5b2d0000" "06000000" "07000000", data.hex()
assert source == ("192.168.1.1", 11511), source
assert [int.from_bytes(value[:4], "little") for _level, kind, value in ancillary if kind == socket.IP_TTL] == [20]
"""


@pytest.mark.skipif(
    os.geteuid() != 0 or shutil.which("unshare") is None or shutil.which("ip") is None,
    reason="needs root, unshare and ip",
)
def test_16_a1_24_bytes_from_the_port_of_the_protocol_ttl_20():
    network = (
        "ip link set lo up && ip link add name one type veth peer name end && ip address add 192.168.1.1/24 dev one"
        " && ip link set one up && ip link set end up"
    )
    command = ["unshare", "--net", "sh", "-c", network + ' && exec "$@"', "sh", sys.executable, "-c", ON_THE_WIRE]
    environment = {**os.environ, "PYTHONPATH": str(NODES)}
    done = subprocess.run(command, env=environment, timeout=30, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("wall", [0.0, -5.0, 0.3, 1700000000.0, 2.0**31, 4e9])
def test_16_a2_the_announced_stamp_is_never_zero(wall):
    made = add_stamps(state(), None, wall)
    assert float(stamp_text(made.stamp)) >= 1.0
    assert (
        decode(
            encode(Heartbeat(Kind.STATE, 1, 1.0, Stamp.from_seconds(made.stamp), Stamp.from_seconds(made.stamp)))
        ).kind
        is Kind.STATE
    )


def test_16_a6_imports_do_not_move_the_local_stamp():
    less = [[row for row in part if row[0] != "/theirs"] for part in SYSTEM[:2]] + [[SYSTEM[2][0]]]
    less[1] = SYSTEM[1]
    after = add_stamps(state(less), STATE, 1800000000.0)
    assert (after.stamp, after.local_stamp) == (1800000000.0, STATE.local_stamp)


@pytest.fixture
def server():
    def nothing():
        raise RefusedCall("robot1 has no state")

    methods = {
        "masterContacts": nothing,
        "masterInfo": PerCaller(lambda caller: [caller, None, "x" * 5000]),
        "masterInfoFiltered": PerCaller(lambda caller, filters: [caller, filters]),
    }
    made = RpcServer("127.0.0.1", 0, methods, lambda host, why: None)
    yield f"http://127.0.0.1:{made.server_address[1]}"
    made.stop()


@pytest.mark.parametrize("path", ["", "/", "/RPC2"])
def test_16_a8_nil_paths_and_lists_of_methods(server, path):
    peer = xmlrpc.client.ServerProxy(server + path, allow_none=True)
    assert peer.masterInfo() == ["127.0.0.1", None, "x" * 5000]
    assert peer.masterInfoFiltered([True, None]) == ["127.0.0.1", [True, None]]
    assert {"masterContacts", "masterInfo", "masterInfoFiltered"} <= set(peer.system.listMethods())


def test_16_a8_a_fault_instead_of_an_empty_state(server):
    with pytest.raises(xmlrpc.client.Fault, match="has no state"):
        Rpc(server, 3.0).call("masterContacts")


@pytest.mark.parametrize("length", [8, 9, 10, 11])
def test_16_a9_filters_of_8_to_11_elements_in_any_case(length):
    rules = read_rules([False, "", "", r"\A/CHATTER\Z", *[""] * 7][:length])
    topics = [topic for topic, _nodes in document(STATE, [rules])[4]]
    assert topics == ["/secret", "/theirs"]


# 15


@pytest.mark.parametrize("step", [-10.0, 3600.0, 0.0])
def test_15_10_a_clock_step_ends_nothing_and_changes_give_stamps(step):
    first = add_stamps(state(), None, 1700000000.5)
    second = add_stamps(state([[], SYSTEM[1], SYSTEM[2]]), first, 1700000000.5 + step)
    third = add_stamps(state(), second, 1700000000.5 + step)
    assert first.local_stamp != second.local_stamp != third.local_stamp
    made = running()
    for found in (first, second, third):
        made.take_own_state(
            AnnouncedMaster("robot1", URI, "http://x:1", "/d", found.stamp, found.local_stamp, True), 20.0
        )
        record = decode(take(made, Send)[0].datagram)
        assert record.stamp.seconds == float(document(found)[0]) == float(stamp_text(found.stamp))
        assert record.local_stamp.seconds == float(document(found)[1])


def test_15_10_the_core_knows_no_wall_clock():
    one, two = Robot("one", "10.0.0.1"), Robot("two", "10.0.0.2")
    world = World([one, two])
    world.run(20.0)
    for two.stamp in (990.0, 4600.0):  # its clock stepped by -10 s, then by an hour
        two.core.take_own_state(two.master(), world.now)
        world.carry_out(two)
        world.run(world.now + 10.0)
        assert one.core.view.masters()[1].stamp == two.stamp and one.core.view.masters()[1].online
    assert not [event for event in one.events if event[1] == "removed"]


def test_15_11_one_silent_master_does_not_postpone_the_others():
    made = running()
    for number in range(1, 4):
        address = f"10.0.0.{number}"
        made.datagram(beat(rate=1.0), (address, 11511), True, 10.0)
        made.take_contact(
            (address, 11511, 11611), CONTACT._replace(uri=f"http://r{number}:1/", name=f"r{number}"), "", 10.0
        )
    now = 10.0
    while now < 16.0:
        made.tick(now)
        now += 0.25
        if now < 15.0:
            made.datagram(beat(rate=1.0), ("10.0.0.2", 11511), True, now)
    assert {master.name for master in made.view.masters() if not master.online} == {"r1", "r3"}


def test_15_17_those_who_hear_of_it_forget_it_and_find_it_again():
    one, two = Robot("one", "10.0.0.1"), Robot("two", "10.0.0.2")
    world = World([one, two])
    world.run(20.0)
    world.answered = lambda robot, action, contact, problem: robot.core.take_contact(
        action.key, None, "no state", world.now, gone=True
    )
    for tenth in range(0, 80, 5):
        two.core.note_silent_roscore(20.0, world.now)
        world.carry_out(two)
        world.run(20.0 + tenth / 10)
    assert [change for _now, change, master in one.events if master.uri == two.uri][-1] == "removed"
    del world.answered
    world.start(two)
    world.run(40.0)
    assert one.core.view.masters()[1].online


# 13: what upstream's server does for anybody


def test_13_no_clock_is_set_and_no_package_is_imported():
    source = (NODES / "rosfleet_multimaster/discovery/source.py").read_text(encoding="utf-8")
    assert "setTime" not in source
    assert local_types(STATE) == {"std_msgs/String", "own_msgs/Key"}, "evil_msgs/Import is only named by another master"


# What is told to whom


def names(info):
    return sorted({name for part in info[4:7] for name, _nodes in part})


def test_exports_are_by_address_and_only_of_own_nodes():
    exports = [
        {"to": [THERE], "topics": ["/chatter"], "services": []},
        {"to": ["*"], "services": ["/a*"]},
    ]
    info = told(THERE, exports=exports, hide_subscribers=["*"])
    assert info[4:7] == [[["/chatter", ["/talker"]]], [], [["/add", ["/adder"]]]]
    assert info[7] == [["/chatter", "std_msgs/String"]]
    assert [node[0] for node in info[8]] == ["/talker", "/adder"] and [row[0] for row in info[9]] == ["/add"]
    assert names(told("10.0.0.9", exports=exports, hide_subscribers=["*"])) == ["/add"]
    assert names(told(THERE, exports=[])) == []
    assert names(told(None, exports=[])) == names(document(STATE))
    assert told(THERE) == document(STATE), "everything to everybody, where nothing is declared"


def test_exports_hold_for_the_types_too():
    values, _warnings = overlay(DISCOVERY, {"exports": [{"to": [THERE], "topics": ["/chatter"]}]})
    policy = ExportPolicy.from_parameters(values)
    assert local_types(*policy.view(STATE, THERE)) == {"std_msgs/String"}
    assert local_types(*policy.view(STATE, "10.0.0.9")) == set()


@pytest.mark.parametrize(
    ("hidden", "left"),
    [
        ({"hide_nodes": ["/listener", "/far"]}, ["/add", "/chatter", "/secret"]),
        ({"hide_topics": "/S*"}, ["/add", "/chatter", "/far/add", "/theirs"]),
        ({"hide_services": ["*"]}, ["/chatter", "/secret", "/theirs"]),
        ({"do_not_sync": ["/chatter", "/add"]}, ["/far/add", "/secret", "/theirs"]),
    ],
)
def test_what_is_hidden_is_hidden_in_the_unfiltered_state_too(hidden, left):
    assert names(told(THERE, **hidden)) == left
    assert names(told(None, **hidden)) == names(document(STATE))


def test_hidden_subscribers_leave_the_publishers():
    info = told(THERE, hide_subscribers=["/chatter"])
    assert info[5] == [["/theirs", ["/listener"]]] and ["/chatter", ["/far", "/talker"]] in info[4]


@pytest.mark.parametrize(
    ("exports", "words"),
    [
        ({"to": ["*"]}, "entries list"),
        (["/chatter"], "entries list"),
        ([{"to": ["*"], "topic": ["/a"]}], "1 topic"),
        ([{"to": ["*"]}, {"topics": ["/a"]}], "2 whom"),
        ([{"to": []}], "whom"),
        ([{"to": "*"}], "* texts"),
        ([{"to": ["robot2"]}], "robot2 IPv4 *"),
        ([{"to": ["*"], "topics": ["/a["]}], "1 topics /a["),
        ([{"to": ["*"], "services": [5]}], "texts list"),
    ],
)
def test_wrong_exports_are_a_sentence(exports, words):
    with pytest.raises(ParameterError) as caught:
        overlay(DISCOVERY, {"exports": exports})
    assert mentions(str(caught.value), *words.split())


def test_a_filter_of_the_importing_side_comes_on_top():
    values, _warnings = overlay(DISCOVERY, {"exports": [{"to": ["*"], "topics": ["*"], "services": ["*"]}]})
    view, rules = ExportPolicy.from_parameters(values).view(STATE, THERE)
    wanted = Filters({"sync_topics": ["/secret"]}).rules("robot1")
    assert names(document(view, [*rules, read_rules(write_rules(wanted, False))])) == ["/secret"]
    assert len(write_rules(wanted, False)) == 1 + len(NAMES) and isinstance(view, State)


@pytest.mark.parametrize("answer", [5, [1], [1, "", 7], [0, "no", "http://a:1/"], None])
def test_a_roscore_with_nonsense_for_geturi_is_waited_for(monkeypatch, answer):
    made = RpcServer("127.0.0.1", 0, {"getUri": lambda caller: answer}, lambda host, why: None)
    waits = []

    def sleep(seconds):
        waits.append(seconds)
        if len(waits) == 2:
            raise InterruptedError

    monkeypatch.setattr(local_roscore, "sleep", sleep)
    with pytest.raises(InterruptedError):
        local_roscore.wait_for_roscore(f"http://127.0.0.1:{made.server_address[1]}")
    made.stop()
