# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Services called without ROS: what nodes answer, and what strangers may send instead."""

import struct

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.ros_client import tcpros
from hypothesis import given
from hypothesis import strategies as st
from provider import GET_SYNC_INFO, LIST_MASTERS, answer, head, master, provider, rows, synced, text

NAME = "/master_discovery/list_masters"


def call(uri, known=None):
    return tcpros.call(uri, NAME, known or tcpros.LIST_MASTERS, "/me")[0]


@pytest.mark.parametrize("md5sum", tcpros.LIST_MASTERS)
def test_masters_are_read(md5sum):
    asked = []
    two = rows(master("one", "http://one:11311/", True, "http://10.0.0.1:11611"), master("two", online=False))
    with provider(head(md5sum=md5sum), answer(two), asked) as uri:
        first, second = call(uri)
    assert first == {
        "name": "one",
        "uri": "http://one:11311/",
        "online": True,
        "discoverer_name": "/master_discovery",
        "monitoruri": "http://10.0.0.1:11611",
    }
    assert (second["name"], second["online"]) == ("two", False)
    assert asked == [head(callerid="/me", service=NAME, md5sum="*")]


def test_imports_are_read():
    with provider(head(md5sum=GET_SYNC_INFO), answer(rows(synced("http://two:1/", "/base", "http://two:2/")))) as uri:
        (host,) = call(uri, tcpros.GET_SYNC_INFO)
    topic = {"topic": "/odom", "node": "/base", "nodeuri": "http://two:2/"}
    assert (host["masteruri"], host["publisher"], host["subscriber"]) == ("http://two:1/", [topic], [topic])
    assert host["services"] == [
        {"service": "/plan", "serviceuri": "rosrpc://x:1", "node": "/base", "nodeuri": "http://two:2/"}
    ]


def test_another_type_is_named():
    with provider(head(md5sum="0", type="old_msgs/DiscoverMasters")) as uri:
        with pytest.raises(OSError, match="old_msgs/DiscoverMasters.*0"):
            call(uri)


GOOD = head(md5sum=LIST_MASTERS)
STRANGE = {
    "an error": (head(error="not a provider\x1b[2J"), b"", r"not a provider\\x1b\[2J"),
    "a failed call": (GOOD, answer(b"it broke", good=False), "it broke"),
    "a header that is too long": (struct.pack("<I", 1 << 30), b"", "1073741824 bytes"),
    "an answer that is too long": (GOOD, b"\1" + struct.pack("<I", 1 << 31), "2147483648 bytes"),
    "too many entries": (GOOD, answer(struct.pack("<I", 1 << 31)), "more than 50000 entries"),
    "a text without its end": (GOOD, answer(rows(struct.pack("<I", 1 << 20) + b"x")), "its end is missing"),
    "half a header": (GOOD[:9], b"", "no answer within"),
    "half an answer": (GOOD, answer(rows(master("one")))[:-9], "no answer within"),
}


@pytest.mark.parametrize("case", STRANGE)
def test_what_strangers_send_is_a_sentence(case, monkeypatch):
    first, second, expected = STRANGE[case]
    if expected == "no answer within":  # the others come in time
        monkeypatch.setattr(tcpros, "CALL", 0.3)
    with provider(first, second) as uri:
        with pytest.raises(OSError, match=expected):
            call(uri)


@pytest.mark.parametrize("uri", ["", "http://x:1", "rosrpc://", "rosrpc://x", "rosrpc://x:99999", "rosrpc://[:1"])
def test_what_is_no_address_of_a_service_is_a_sentence(uri):
    with pytest.raises(OSError, match=NAME):
        call(uri)


def test_nobody_there():
    with pytest.raises(OSError, match="refused"):
        call("rosrpc://127.0.0.1:1")


@given(st.binary(max_size=400))
def test_any_bytes_are_read_or_refused(data):
    for read in (*tcpros.LIST_MASTERS.values(), *tcpros.GET_SYNC_INFO.values()):
        try:
            tcpros.ValueReader(data).items(read)
        except ValueError:
            pass


def test_texts_of_masters_are_plain():
    name = "evil\x1b[2J\n" + "x" * 300
    (row,) = tcpros.ValueReader(rows(text(name) + text("") + bytes(17) + text("") + text(""))).items(
        tcpros.LIST_MASTERS[LIST_MASTERS]
    )
    assert "\x1b" not in row["name"] and len(row["name"]) <= 200
