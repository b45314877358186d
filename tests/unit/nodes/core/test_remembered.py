# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The lines of the store: written, cut at any byte, damaged at any byte."""

import math
import xmlrpc.client

import pytest
from rosfleet_multimaster.core import remembered
from rosfleet_multimaster.core.registry import Registry

A = ("/a", "http://robot:1/")
CHANGES = [
    [["node", *A], ["publisher", "/chatter", *A, True], ["type", "/chatter", "std_msgs/String"]],
    [["set", "/text", "line\nbreak, \u00fc and \U0001f916"]],
    [["subscriber", "/other", *A, True]],
    [["delete", "/text"]],
]


def file_of(changes):
    lines = [remembered.line(number, records) for number, records in enumerate(changes, 1)]
    return remembered.head("boot") + b"".join(lines)


def state_of(changes):
    registry = Registry()
    for records in changes:
        for record in records:
            registry.apply(record)
    return vars(registry)


def test_what_is_written_is_read():
    found = remembered.read(file_of(CHANGES))
    assert vars(found.registry) == state_of(CHANGES)
    assert found.boot == "boot" and not found.torn and not found.damaged and found.good == len(file_of(CHANGES))


def test_cut_at_any_byte_it_is_what_was_written_to_its_end():
    data, first = file_of(CHANGES), len(remembered.head("boot"))
    for size in range(first, len(data)):
        found = remembered.read(data[:size])
        whole = data[:size].count(b"\n") - 1
        assert vars(found.registry) == state_of(CHANGES[:whole]) and not found.damaged
        assert found.torn == (data[size - 1 : size] != b"\n")


def test_a_file_without_a_first_line_is_none():
    for size in range(len(remembered.head("boot"))):
        assert remembered.read(file_of(CHANGES)[:size]) is None
    assert remembered.read(b"something else\n") is None
    assert remembered.read(remembered.line(0, {"format": remembered.FORMAT + 1})) is None


def test_a_changed_byte_ends_the_file_there_and_never_makes_another_state():
    data, first = file_of(CHANGES), len(remembered.head("boot"))
    states = [state_of(CHANGES[:count]) for count in range(len(CHANGES) + 1)]
    for at in range(first, len(data)):
        found = remembered.read(data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :])
        assert vars(found.registry) in states[: data[:at].count(b"\n")] and found.torn


def test_a_line_that_is_missing_or_twice_ends_the_file():
    lines = file_of(CHANGES).splitlines(keepends=True)
    for other in (lines[:2] + lines[3:], lines[:3] + lines[2:]):
        found = remembered.read(b"".join(other))
        assert found.damaged and vars(found.registry) in [state_of(CHANGES[:count]) for count in (1, 2)]


@pytest.mark.parametrize("value", [1, -1.5, math.inf, True, "\ufffe", [1, ["x"]], {"a": {"b": []}}, ""])
def test_values_of_parameters_stay_what_they_are(value):
    found = remembered.read(file_of([[["set", "/value", value]]])).registry.parameters["value"]
    assert found == value and type(found) is type(value)


def test_binary_values_and_times_stay_what_they_are():
    def special(value):
        return getattr(xmlrpc.client, value.kind)(value.content())

    values = [xmlrpc.client.Binary(b"\0\xff"), xmlrpc.client.DateTime("20260101T00:00:00")]
    data = file_of([[["set", "/values", values]]])
    assert remembered.read(data, special).registry.parameters["values"] == values
    with pytest.raises(TypeError, match="cannot be kept"):
        remembered.line(1, object())


def test_a_whole_registry_is_read_back():
    registry = remembered.read(file_of(CHANGES)).registry
    found = remembered.read(file_of([[record] for record in registry.records()]))
    assert vars(found.registry) == vars(registry) and not found.torn


def test_a_file_is_written_anew_when_it_has_grown_much():
    assert not remembered.grown(remembered.SLACK, 10) and remembered.grown(remembered.SLACK + 100, 10)
    assert not remembered.grown(15 << 20, 10 << 20) and remembered.grown(21 << 20, 10 << 20)
