# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""What multimaster_verify reads out of texts and packets."""

import socket
import struct

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._verify import texts
from ansible_collections.rosfleet.multimaster.plugins.module_utils._verify.multicast import echo_request
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import environment as environment_module
from hypothesis import given
from hypothesis import strategies as st

# As rosservice of ROS 1.15 prints it.
LISTED = """masters:\x20
  -\x20
    name: "kobuki1computer"
    uri: "http://kobuki1computer:11311/"
    last_change:\x20
      secs: 1795230710
      nsecs: 998000144
    last_change_local:\x20
      secs: 1795230709
      nsecs:         0
    online: True
    discoverer_name: "/master_discovery"
    monitoruri: "http://192.168.1.229:11611"
  -\x20
    name: "kobuki2computer"
    uri: "http://kobuki2computer:11311/"
    last_change:\x20
      secs: 0
      nsecs:         0
    last_change_local:\x20
      secs: 0
      nsecs:         0
    online: False
    discoverer_name: "/master_discovery"
    monitoruri: "http://192.168.1.239:11611"
"""
# Fig. 8 of the report: other time fields, texts without quotes.
OLD = """masters:
  -
    name: kobuki1computer
    uri: http://kobuki1computer:11311/
    timestamp: 1426681423.24
    timestamp_local: 1426681423.24
    online: True
    discoverer_name: /master_discovery
    monitoruri: http://192.168.1.229:11611
"""


def test_masters_of_today_and_of_the_report():
    first, second = texts.masters(LISTED)
    assert first == {
        "name": "kobuki1computer",
        "uri": "http://kobuki1computer:11311/",
        "online": True,
        "monitoruri": "http://192.168.1.229:11611",
    }
    assert (second["name"], second["online"]) == ("kobuki2computer", False)
    assert texts.masters(OLD) == [first]


@pytest.mark.parametrize(
    "text", ["", "masters: []\n", "ERROR: Service [/master_discovery/list_masters] is not available.\n"]
)
def test_no_masters(text):
    assert texts.masters(text) == []


@given(st.text(max_size=300))
def test_any_output_is_read(text):
    texts.masters(text)
    texts.interpreter(text.encode())
    texts.environment(text)
    texts.route(text)


@pytest.mark.parametrize(
    ("script", "words"),
    [
        (b"#!/usr/bin/python3\nimport rostopic\n", ["/usr/bin/python3"]),
        (b"#! /usr/bin/env python\r\n", ["/usr/bin/env", "python"]),
        (b"\x7fELF\x02\x01", []),
        (b"", []),
    ],
)
def test_what_runs_a_command(script, words):
    assert texts.interpreter(script) == words


def test_nodes_of_the_verification_have_names_of_their_own():
    names = {texts.node_of("run.1", computer) for computer in ("tibi-nav", "tibi-visio.lan")}
    assert names == {"multimaster_verify_talker_tibi_nav_run_1", "multimaster_verify_talker_tibi_visio_lan_run_1"}
    assert texts.listener_of("tibi-nav") == "multimaster_verify_listener_tibi_nav"


def test_topic_has_only_letters_of_a_graph_name():
    assert texts.topic_of("tibi-visio.lan") == "/multimaster_verify/tibi_visio_lan"


values = st.text(st.characters(min_codepoint=32, max_codepoint=0x2FF, exclude_characters="\x7f"), max_size=30)


@given(st.dictionaries(st.from_regex(r"[A-Z_][A-Z0-9_]{0,8}", fullmatch=True), values, max_size=5))
def test_environment_is_read_as_it_is_written(variables):
    environment = environment_module.Environment(variables)
    render = dict(environment_module.CONSUMERS)["/etc/rosfleet-multimaster/environment"]
    assert texts.environment(render(environment, environment_module.Machine())) == variables


def test_differing_names_what_the_process_lacks():
    process = {"ROS_MASTER_URI": "http://old:11311", "PATH": "/bin"}
    wanted = {"ROS_MASTER_URI": "http://new:11311", "ROS_HOSTNAME": "kobuki1computer", "PATH": "/bin"}
    assert texts.differing(process, wanted) == ["ROS_HOSTNAME", "ROS_MASTER_URI"]


def ip(body, source="192.168.1.239", destination="192.168.1.229", options=b""):
    head = struct.pack("!BBHHHBBH", 0x40 | (20 + len(options)) // 4, 0, 20 + len(options) + len(body), 0, 0, 64, 1, 0)
    return head + socket.inet_aton(source) + socket.inet_aton(destination) + options + body


def test_echo_reply_is_ours_by_its_identifier():
    reply = ip(b"\0\0" + echo_request(7, 3)[2:], options=b"\1\1\1\0")
    assert texts.echo(reply, 7) == ("192.168.1.239", 3, "")
    assert texts.echo(reply, 8) is None
    assert texts.echo(ip(echo_request(7, 3)), 7) is None  # a request, as on the loopback interface


@pytest.mark.parametrize(
    ("kind", "code", "text"),
    [(3, 1, "host unreachable"), (3, 13, "prohibited"), (11, 0, "time to live"), (3, 3, None), (5, 1, None)],
)
def test_what_routers_say(kind, code, text):
    refusal = struct.pack("!BBHI", kind, code, 0, 0) + ip(echo_request(7, 3), "192.168.1.229", "192.168.1.239")
    heard = texts.echo(ip(refusal, source="192.168.1.1"), 7)
    assert (
        (heard is None)
        if text is None
        else (heard.sequence == 3 and text in heard.error and "192.168.1.1" in heard.error)
    )
    assert texts.echo(ip(refusal), 8) is None


# As rospy and roscpp answer getBusInfo; the last one as before kinetic.
BUS_INFO = [
    [
        1,
        "http://kobuki2computer:41233/",
        "i",
        "TCPROS",
        "/goal",
        True,
        "TCPROS connection on port 40433 to [kobuki2computer:41233 on socket 9]",
    ],
    [2, "/planner", "o", "TCPROS", "/odom", 1, "TCPROS connection on port 39281 to [192.168.1.239:40233 on socket 10]"],
    [3, "http://Kobuki2Computer:41233/", "i", "TCPROS", "/old", 1],
    [4, "/rosout", "o", "TCPROS", "/rosout", 1],
]


def test_links_of_a_node():
    assert texts.links(BUS_INFO) == [
        ("in", "/goal", "http://kobuki2computer:41233/", "kobuki2computer"),
        ("out", "/odom", "/planner", "192.168.1.239"),
        ("in", "/old", "http://Kobuki2Computer:41233/", "kobuki2computer"),
        ("out", "/rosout", "/rosout", ""),
    ]


nonsense = st.recursive(
    st.none() | st.integers() | st.text(max_size=9), lambda inner: st.lists(inner, max_size=8), max_leaves=20
)


@given(nonsense)
def test_any_bus_info_is_read(answer):
    texts.links(answer)


@given(st.binary(max_size=80))
def test_any_packet_is_read(packet):
    texts.echo(packet, 7)


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("192.168.1.239 dev eth0 src 192.168.1.229 uid 0 \n    cache", ("eth0", "192.168.1.229", None, None)),
        (
            "192.168.10.3 via 192.168.1.202 dev wlan0 src 192.168.1.229",
            ("wlan0", "192.168.1.229", "192.168.1.202", None),
        ),
        ("default via 192.168.1.1 dev eth0 onlink", ("eth0", None, "192.168.1.1", None)),
        ("default via 10.0.0.1 dev wlan0 proto dhcp metric 600", ("wlan0", None, "10.0.0.1", "600")),
    ],
)
def test_route(line, expected):
    route = texts.route(line)
    assert (route["device"], route["source"], route["gateway"], route["metric"]) == expected
