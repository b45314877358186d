# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The lines of the store: written, cut at any byte, damaged at any byte."""

import io
import math
import xmlrpc.client
import zlib

import pytest
from rosfleet_multimaster.roscore.core import store_format
from rosfleet_multimaster.roscore.core.registry import Record, Registry

from tests.unit.nodes.roscore.records import rec

A = ("/a", "http://robot:1/")
CHANGES = [
    [["node", *A], ["publisher", "/chatter", *A, True], ["type", "/chatter", "std_msgs/String"]],
    [["set", "/text", "line\nbreak, \u00fc and \U0001f916"]],
    [["subscriber", "/other", *A, True]],
    [["delete", "/text"]],
]


def file_of(changes):
    lines = [store_format.format_line(number, records) for number, records in enumerate(changes, 1)]
    return store_format.format_head("boot") + b"".join(lines)


def read(data):
    return store_format.read(io.BytesIO(data))


def state_of(changes):
    registry = Registry()
    for records in changes:
        for record in records:
            registry.apply(Record.from_row(record))
    return vars(registry)


def test_what_is_written_is_read():
    found = read(file_of(CHANGES))
    assert vars(found.registry) == state_of(CHANGES)
    assert found.boot == "boot" and not found.torn and not found.damaged and found.size == len(file_of(CHANGES))


def test_cut_at_any_byte_it_is_what_was_written_to_its_end():
    data, first = file_of(CHANGES), len(store_format.format_head("boot"))
    for size in range(first, len(data)):
        found = read(data[:size])
        whole = data[:size].count(b"\n") - 1
        assert vars(found.registry) == state_of(CHANGES[:whole]) and not found.damaged
        assert found.torn == (data[size - 1 : size] != b"\n")


def test_a_file_without_a_first_line_is_none():
    for size in range(len(store_format.format_head("boot"))):
        assert read(file_of(CHANGES)[:size]) is None
    assert read(b"something else\n") is None
    assert read(store_format.format_line(0, {"format": store_format.FORMAT + 1})) is None


def test_a_changed_byte_ends_the_file_and_makes_no_other_state():
    data, first = file_of(CHANGES), len(store_format.format_head("boot"))
    states = [state_of(CHANGES[:count]) for count in range(len(CHANGES) + 1)]
    for at in range(first, len(data)):
        found = read(data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :])
        assert vars(found.registry) in states[: data[:at].count(b"\n")] and found.torn


def test_a_line_that_is_missing_or_twice_ends_the_file():
    lines = file_of(CHANGES).splitlines(keepends=True)
    for other in (lines[:2] + lines[3:], lines[:3] + lines[2:]):
        found = read(b"".join(other))
        assert found.damaged and vars(found.registry) in [state_of(CHANGES[:count]) for count in (1, 2)]


@pytest.mark.parametrize("value", [1, -1.5, math.inf, True, "\ufffe", [1, ["x"]], {"a": {"b": []}}, ""])
def test_values_of_parameters_stay_what_they_are(value):
    found = read(file_of([[["set", "/value", value]]])).registry.parameters["value"]
    assert found == value and type(found) is type(value)


def test_binary_values_and_times_stay_what_they_are():
    values = [xmlrpc.client.Binary(b"\0\xff"), xmlrpc.client.DateTime("20260101T00:00:00")]
    data = file_of([[["set", "/values", values]]])
    assert read(data).registry.parameters["values"] == values
    with pytest.raises(TypeError, match="cannot be kept"):
        store_format.format_line(1, object())


def test_a_whole_registry_is_read_back():
    registry = read(file_of(CHANGES)).registry
    found = read(
        file_of(
            [[row] for row in (["set", "/", registry.parameters], *(record.row for record in registry.facts.values()))]
        )
    )
    assert vars(found.registry) == vars(registry) and not found.torn


def test_a_file_is_written_anew_when_it_has_grown_much():
    assert not store_format.is_renewal_due(store_format.SLACK, 10) and store_format.is_renewal_due(
        store_format.SLACK + 100, 10
    )
    assert not store_format.is_renewal_due(15 << 20, 10 << 20) and store_format.is_renewal_due(21 << 20, 10 << 20)


def test_a_line_that_is_whole_and_says_nothing_is_left_out_alone():
    deep = "[" * 100_000 + "]" * 100_000
    wrong = [["set", "/x"], ["publisher", "/t", "/a", 7, True], "nothing", ["what", 1], ["set", "/", 5], [["set"], 1]]
    before = [CHANGES[0], wrong, CHANGES[1]]
    data = store_format.format_head("boot") + b"".join(
        store_format.format_line(number, records) for number, records in enumerate(before, 1)
    )
    text = f"4 {deep}".encode()
    data += b"%08x %s\n" % (zlib.crc32(text), text) + store_format.format_line(5, CHANGES[2])
    found = read(data)
    assert vars(found.registry) == state_of(CHANGES[:3]) and not found.torn and found.omissions == len(wrong) + 1


@pytest.mark.costly
def test_entries_beyond_a_roscores_bounds_are_left_out_alone():
    data = file_of([[["set", f"/p{number}", "x" * (10 << 20)]] for number in range(35)] + [[["set", "/last", 1]]])
    found = read(data)
    assert set(found.registry.parameters) == {*(f"p{number}" for number in range(6)), "last"} and found.omissions == 29


class Strange:
    """Something that JSON has not."""


def test_a_value_that_cannot_be_kept_is_left_out_alone():
    records = [
        rec("set", "/tree", {"a": 1, "b": Strange(), "c": {"d": Strange(), "e": [1, Strange()]}}),
        rec("set", "/x", Strange()),
    ]
    records += [rec("node", *A), rec("set", "/y", 7)]
    kept, without = store_format.strip_values(records)
    assert kept == [rec("set", "/tree", {"a": 1, "c": {}}), rec("delete", "/x"), rec("node", *A), rec("set", "/y", 7)]
    assert without == ["/tree", "/x"]


@pytest.mark.parametrize("given", [["ServerProxy", "http://x/"], ["Binary"], [1, 2], "Binary", {}, ["Binary", 7]])
def test_a_mapping_of_a_stranger_makes_no_object(given):
    found = read(file_of([[["set", "/x", {"\0special": given}]]]))
    assert found.registry.parameters["x"] == {"\0special": given}
