# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Values of parameters of other robots: what is taken, and that it is the same after it was written and read again."""

import datetime
import random
import xmlrpc.client

import pytest
from rosfleet_multimaster.protocol.xml_rpc import loads
from rosfleet_multimaster.sync.core import values

NESTED = 0
for _level in range(values.DEPTH + 1):
    NESTED = [NESTED]


def written_and_read(value):
    """The value as a roscore gives it back."""
    return loads(xmlrpc.client.dumps((value,), "setParam").encode())[0][0]


@pytest.mark.parametrize(
    "value",
    ["<robot/>", 1, -1.5, True, b"\x00\xff", ["a", [1, 2.5]], {"a": {"b c": [False]}}, "", [], "ü\U0001f600", -(2**31)],
)
def test_a_plain_value_is_taken_as_it_is(value):
    made, size = values.take(value)
    assert made == value and type(made) is type(value) and size > 0
    assert values.digest(written_and_read(made)) == values.digest(made)


def test_line_ends_are_as_whoever_reads_the_copy_has_them():
    made, _size = values.take({"model": "a\r\nb\rc\n"})
    assert made == {"model": "a\nb\nc\n"} == written_and_read(made)


@pytest.mark.parametrize(
    ("value", "why"),
    [
        (NESTED, "more than 16 lists and mappings in each other"),
        ([0] * (values.PARTS + 1), "more than 20000 parts"),
        ("x" * (values.BYTES + 1), "more than 1048576 bytes"),
        ("ü" * (values.BYTES // 2 + 1), "more than 1048576 bytes"),
        ({"a/b": 1}, "a member whose name"),
        ({"": 1}, "a member whose name"),
        ({"a\n": 1}, "a member whose name"),
        ({"k" * 256: 1}, "a member whose name"),
        ({1: 1}, "a member whose name"),
        ("\x1b[31m", "a character that XML"),
        ("\ud800", "a character that XML"),
        (float("nan"), "a number that XML-RPC"),
        (float("inf"), "a number that XML-RPC"),
        (2**31, "a number that XML-RPC"),
        (None, "is no text"),
        ([datetime.datetime(2026, 1, 1)], "is no text"),
    ],
    ids=lambda value: None if isinstance(value, str) else "value",
)
def test_what_is_beyond_a_bound_is_not_taken(value, why):
    with pytest.raises(values.UnusableValue, match=why):
        values.take(value)


def test_the_digest_tells_types_apart():
    alike = [1, 1.0, True, "1", [1], {"1": 1}]
    assert len({values.digest(value) for value in alike}) == len(alike)
    assert values.digest({"a": 1, "b": 2}) == values.digest({"b": 2, "a": 1})


def drawn(random_numbers, depth=0):
    """Any value, wrong ones among them."""
    text = "".join(chr(random_numbers.choice((10, 13, 60, 97, 228, 0x1F600, 0, 0xFFFE))) for _count in range(5))
    plain = [text, random_numbers.getrandbits(40), random_numbers.uniform(-1e300, 1e300), None, True, b"\x01", 7, "ok"]
    kind = random_numbers.randrange(6)
    if kind == 0 and depth < 20:
        return [drawn(random_numbers, depth + 1) for _count in range(random_numbers.randrange(3))]
    if kind == 1 and depth < 20:
        return {random_numbers.choice(["a", "b", "c/d", text]): drawn(random_numbers, depth + 1) for _count in range(2)}
    return random_numbers.choice(plain)


@pytest.mark.parametrize("seed", range(20))
def test_a_drawn_value_is_refused_or_comes_back_the_same(seed):
    numbers, taken = random.Random(seed), 0
    for _count in range(200):
        try:
            made, _size = values.take(drawn(numbers))
        except values.UnusableValue:
            continue
        taken += 1
        assert values.digest(written_and_read(made)) == values.digest(made)
    assert taken
