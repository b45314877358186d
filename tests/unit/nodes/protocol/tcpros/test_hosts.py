# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The hosts in URIs: one spelling for each, by nodes, modules and controller alike."""

import ipaddress
import socket
from urllib.parse import urlsplit

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import network
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.measure import exchange
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.ros_client import hosts as of_modules
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.ros_client import node_hosts
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._adopt import facts
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base import hosts as of_controller
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory import kinds
from hypothesis import given
from hypothesis import strategies as st
from rosfleet_multimaster.protocol.tcpros.hosts import LONGEST, is_address, place_of, spell_host


@pytest.mark.parametrize(
    ("uri", "place"),
    {
        "http://Tibi-Visio:34567/": ("tibi-visio", 34567),
        "rosrpc://tibi_laser.lab.:1": ("", 1),
        "rosrpc://tibi_laser.lab:1": ("tibi_laser.lab", 1),
        "http://192.168.1.9": ("192.168.1.9", 0),
        "http://[FE80:0::01]:9/": ("fe80::1", 9),
        "http://[::ffff:192.168.1.9]:9/": ("", 0),
        "http://[::FFFF:c0a8:109]:9/": ("", 9),
        "http://[fe80::1%eth0]:9/": ("", 0),
        "http://3com.example:9/": ("3com.example", 9),
        "http://example.3com:9/": ("example.3com", 9),
        "http://example.3:9/": ("", 9),
        "http://a..b:9/": ("", 9),
        "http://-a:9/": ("", 9),
        "http://a:65536/": ("", 0),
        "http://a:1_0/": ("", 0),
        "http://a:9/\n": ("", 0),
    }.items(),
)
def test_a_place_has_one_spelling(uri, place):
    assert place_of(uri) == place


@given(st.text("0123456789abcdefx.X-[]:%@/\uff11\u3002 ", max_size=24))
def test_what_libc_takes_for_an_address_is_one_or_refused(text):
    """inet_aton(3) has many spellings, and getaddrinfo(3) takes them all."""
    host = place_of(f"http://{text}:1/")[0]
    assert place_of(f"http://{host}:1/")[0] == host or ":" in host, "the only spelling is its own"
    try:
        socket.inet_aton(host)
    except OSError:
        return
    assert is_address(host)


def resolve(host):
    """The address that getaddrinfo(3) takes a text for without asking anybody; None for a name and for nothing."""
    try:
        found = socket.getaddrinfo(host, None, 0, socket.SOCK_STREAM, 0, socket.AI_NUMERICHOST)
    except (OSError, UnicodeError, ValueError):
        return None
    return ipaddress.ip_address(found[0][4][0].partition("%")[0])


def spell_number(number, form):
    """An IPv4 address in one of the spellings that programs take."""
    octets = number.to_bytes(4, "big")
    usual = ".".join(map(str, octets))
    return {
        "usual": usual,
        "decimal": str(number),
        "hex": hex(number),
        "octal": f"0{number:o}",
        "HEX": f"0X{number:X}",
        "parts of hex": ".".join(map(hex, octets)),
        "parts of octal": ".".join(f"0{octet:o}" for octet in octets),
        "zeros": ".".join(f"{octet:03}" for octet in octets),
        "two parts": f"{octets[0]}.{number & 0xFFFFFF}",
        "three parts": f"{octets[0]}.{octets[1]}.{number & 0xFFFF}",
        "a dot behind": f"{usual}.",
        "mapped": f"[::ffff:{usual}]",
        "mapped in hex": f"[::FFFF:{number >> 16:x}:{number & 0xFFFF:x}]",
        "compatible": f"[::{usual}]",
        "a blank": f"{usual} ",
        "full width": "".join(chr(ord(letter) + 0xFEE0) for letter in usual),
    }[form]


FORMS = (
    *("usual", "decimal", "hex", "octal", "HEX", "parts of hex", "parts of octal", "zeros", "two parts", "three parts"),
    *("a dot behind", "mapped", "mapped in hex", "compatible", "a blank", "full width"),
)
NUMBERS = st.integers(0, 2**32 - 1) | st.sampled_from([2130706433, 0, 2**32 - 1, 167772165])
NAMES = ("localhost", "LOCALHOST", "localhost.", "0", "0x", "0x.a", "a.0x7f", "127.1.a", "xn--bcher-kva", "b\u00fccher")
IPV6 = st.integers(0, 2**128 - 1).map(ipaddress.IPv6Address)
HOSTS = st.one_of(
    st.builds(spell_number, NUMBERS, st.sampled_from(FORMS)),
    st.sampled_from(NAMES),
    IPV6.map("[{}]".format),
    IPV6.map(lambda address: f"[{address.exploded.upper()}]"),
    st.text("aB3_x0-.", min_size=1, max_size=12),
)
PORTS = ("", ":1", ":11311", ":0", ":65535", ":65536", ":011311", ":+1", ":1_0", ":\u0661", ":", ":1:2", ":-1")
URIS = st.builds(
    "{}://{}{}{}{}".format,
    st.sampled_from(["http", "HTTP", "rosrpc"]),
    st.sampled_from(["", "", "", "user@", "127.0.0.1@", "a:b@"]),
    HOSTS,
    st.sampled_from(PORTS),
    st.sampled_from(["", "", "/", "/", "//", "/a", "?a", "#a", "@b", "\\@b", "\n", "\t", " "]),
)


@given(URIS)
def test_each_reader_sees_what_the_resolver_would_or_refuses(uri):
    host, port = place_of(uri)
    assert place_of(uri) == of_modules.place_of(uri) == of_controller.place_of(uri)
    adopted = facts.uri(uri)
    if not host:
        assert adopted is None
        return
    # What programs split and resolve in their own way is the same place.
    theirs = urlsplit(uri)
    there = ipaddress.ip_address(theirs.hostname) if ":" in theirs.hostname else theirs.hostname
    assert (str(there), theirs.port or 0, theirs.username) == (host, port, None)
    address = resolve(host)
    assert address is None or str(address) == host, "no other spelling of an address is let through"
    assert is_address(host) == network.is_address(host) == isinstance(address, ipaddress.IPv4Address)
    assert ":" in host or spell_host(host) == host
    assert adopted is None or (adopted.host, adopted.port) == (host, port or 11311)


@given(HOSTS)
def test_no_name_is_an_address_for_the_resolver(host):
    """Neither in an inventory, nor in what a node tells of its connections."""
    assert not kinds.is_host_name(host) or resolve(host) is None
    row = [1, "/other", "o", "TCPROS", "/topic", True, f"TCPROS connection on port 1 to [{host}:5 on socket 7]"]
    (link,) = exchange.links([row])
    address = resolve(link["host"]) if link["host"] else None
    assert address is None or str(address) == link["host"]


def test_a_node_at_an_odd_place_is_told_with_all_of_its_uri():
    (row,) = node_hosts.announced({"/odd": "http://0x7f.1:41233/"}, {}, [], "here-pc")
    assert (row["host"], row["port"]) == ("http://0x7f.1:41233/", 41233)


def test_a_long_uri_costs_nothing():
    assert place_of(f"http://{'a' * LONGEST}:1/") == ("", 0) == place_of("http://" + "a." * 1_000_000)
