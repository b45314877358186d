# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Texts of JSON from strangers: what is read, what is refused, and what it costs."""

import json
import time
import tracemalloc

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosfleet_multimaster.protocol import json_text
from rosfleet_multimaster.protocol.graph import InvalidDocument

VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=20,
)


@pytest.mark.slow
@given(VALUES)
def test_what_is_written_is_read(value):
    try:
        text = json_text.to_json(value)
        text.encode()
    except UnicodeEncodeError:
        return  # half a character: XML-RPC writes another one in its place
    assert json_text.from_json(text) == value


def test_a_large_value_stays_a_value():
    value = ["x" * json_text.MOST]
    assert json_text.to_json(value) is value
    assert json_text.to_json(["x"]) == '["x"]'


def test_half_a_surrogate_is_refused():
    with pytest.raises(ValueError, match="half a character"):
        json_text.from_json(r'["\ud83d"]')
    assert json_text.from_json(r'["\ud83d\ude00", "\\ud83d"]') == ["\U0001f600", r"\ud83d"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[" * 100_000, "too deep"),
        ("[" * 100_000 + "]" * 100_000, "too deep"),
        ('{"a":' * 50_000 + "1" + "}" * 50_000, "too deep"),
        ("[" + "7" * 1_000_000 + "]", "digits"),
        ("[-" + "7" * 1_000_000 + "]", "digits"),
        ("[0." + "7" * 1_000_000 + "]", "digits"),
        ("[1e" + "7" * 1_000_000 + "]", "digits"),
        ("[NaN]", "no number"),
        ("[-Infinity]", "no number"),
        ("[[],]" * 200_000, "memory"),
        ('["' + "x" * (7 << 20) + '"]', "memory"),
        ("", "value"),
        ("[1] [2]", "data"),
        ("\ufeff[]", "value|BOM"),
        ('["\n"]', "control"),
    ],
)
def test_nonsense_is_refused_at_once(text, words):
    began = time.process_time()
    with pytest.raises(ValueError, match=words):
        json_text.from_json(text)
    assert time.process_time() - began < 1.0


@pytest.mark.slow
@pytest.mark.parametrize(
    "part",
    [
        "[]",
        "[[]]",
        "[[[]]]",
        '""',
        '"a"',
        "{}",
        '{"":0}',
        '{"k%d":0}',
        "7777",
        "1.5",
        '["a","b"]',
        '"\U0001f600"',
        "[1]",
    ],
)
def test_no_text_costs_more_memory_than_its_bound(part):
    """The largest text of such parts that is read."""
    few = ",".join(part.replace("%d", str(number)) for number in range(1000))
    cost = len(few) * 4 + sum(map(few.count, "[,:")) * 120 + few.count("{") * 300
    count = 1000 * (24 << 20) // cost - 2000
    text = "[" + ",".join(part.replace("%d", str(number)) for number in range(count)) + "]"
    tracemalloc.start()
    try:
        found = json_text.from_json(text)
        _now, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert len(found) == count and peak < 24 << 20
    with pytest.raises(ValueError, match="memory"):
        json_text.from_json(json.dumps([found, found]))


@pytest.mark.parametrize("count", [0, 1, json_text.ROWS, json_text.ROWS + 1, 3 * json_text.ROWS])
def test_rows_travel_a_few_in_a_text(count):
    rows = [["publisher", f"/{number}", "/\ud800 \0 <&\u2028", True, None] for number in range(count)]
    texts = json_text.pack_rows(rows)
    assert json_text.unpack_rows(texts) == rows and len(texts) == -(-count // json_text.ROWS)
    assert all(text.isascii() and text.isprintable() for text in texts)


@pytest.mark.parametrize("texts", [None, 7, ["{"], [7], [["a"]], ["7"], [None], ["[" * 100000]])
def test_what_is_no_text_of_rows(texts):
    with pytest.raises(InvalidDocument):
        json_text.unpack_rows(texts)
