# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Dataclasses to plain data and back."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from ipaddress import IPv4Address, IPv4Network
from typing import Any

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain import (
    Mismatch,
    from_plain,
    notation,
    to_plain,
)

EVERYWHERE = IPv4Network("0.0.0.0/0")


@dataclass(frozen=True)
class Inner:
    address: IPv4Address
    source: str = field(default="", metadata=notation(key="from"))


@dataclass(frozen=True, kw_only=True)
class Outer:
    name: str
    number: int = 0
    there: bool = False
    network: IPv4Network = field(default=EVERYWHERE, metadata=notation(words=((EVERYWHERE, "default"),)))
    gateway: IPv4Address | None = None
    part: Inner | None = None
    parts: tuple[Inner, ...] = ()
    by_name: Mapping[str, Inner] = field(default_factory=dict)
    free: Mapping[str, Any] = field(default_factory=dict)
    later: tuple[str, ...] | None = field(default=None, metadata=notation(left_out=True))


INNER = Inner(IPv4Address("192.168.1.1"), "tibi")
FULL = Outer(
    name="a",
    number=3,
    there=True,
    network=IPv4Network("192.168.1.0/24"),
    gateway=IPv4Address("192.168.1.2"),
    part=INNER,
    parts=(INNER,),
    by_name={"b": INNER},
    free={"x": [1]},
    later=("c",),
)
PLAIN_INNER = {"address": "192.168.1.1", "from": "tibi"}
PLAIN = {
    "name": "a",
    "number": 3,
    "there": True,
    "network": "192.168.1.0/24",
    "gateway": "192.168.1.2",
    "part": PLAIN_INNER,
    "parts": [PLAIN_INNER],
    "by_name": {"b": PLAIN_INNER},
    "free": {"x": [1]},
    "later": ["c"],
}
EMPTY = {
    "name": "a",
    "number": 0,
    "there": False,
    "network": "default",
    "gateway": "",
    "part": {},
    "parts": [],
    "by_name": {},
    "free": {},
}


def test_everything_set():
    assert to_plain(FULL) == PLAIN
    assert from_plain(Outer, PLAIN) == FULL
    assert list(to_plain(FULL)) == list(PLAIN)


def test_nothing_set():
    assert to_plain(Outer(name="a")) == EMPTY
    assert from_plain(Outer, EMPTY) == Outer(name="a")


def test_a_missing_key_is_the_default():
    assert from_plain(Outer, {"name": "a"}) == Outer(name="a")


def test_unknown_keys_are_ignored():
    assert from_plain(Outer, {"name": "a", "changed": False}) == Outer(name="a")


def test_empty_values_are_no_shared_objects():
    one, other = (to_plain(Outer(name="a")) for _number in range(2))
    one["part"]["x"] = 1
    assert other["part"] == {}


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"name": 3}, "name is 3; expected a text."),
        ({"number": "3"}, "number is '3'; expected a whole number."),
        ({"number": True}, "number is True; expected a whole number."),
        ({"there": 1}, "there is 1; expected true or false."),
        ({"network": "here"}, "network is 'here'; expected an IPv4 network."),
        ({"part": {"address": "x"}}, "part.address is 'x'; expected an IPv4 address."),
        ({"parts": [{}]}, "parts[0].address is missing."),
        ({"parts": "x"}, "parts is 'x'; expected a list."),
        ({"by_name": {"b": 1}}, "by_name.b is 1; expected a mapping."),
        ({"by_name": 1}, "by_name is 1; expected a mapping."),
    ],
)
def test_a_mismatch_says_where_and_what(change, sentence):
    with pytest.raises(Mismatch) as caught:
        from_plain(Outer, {**PLAIN, **change})
    assert str(caught.value) == sentence


def test_no_record_at_all():
    with pytest.raises(Mismatch, match="Outer is 3; expected a mapping"):
        from_plain(Outer, 3)
