# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The form of the contract: default values, examples and plain data, before the controller makes dataclasses of it and after."""

# ruff: noqa: UP006, UP007, UP035, UP045
# The types are written as Python 3.6 has them.

import typing
from dataclasses import dataclass

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._contract.fields import Struct, field
from ansible_collections.rosfleet.multimaster.plugins.module_utils._contract.outcomes import Outcome


def make_structs():
    class Entry(Struct):
        name: str = field("A name.", "eth0", needed=True)
        mtu: typing.Optional[int] = field("Bytes, or null.", 1500)

    class Whole(Struct, returned="when O(action=collect)"):
        text: str = field("A text.", "a")
        found: Outcome = field("A word.", "open")
        entries: typing.Tuple[Entry, ...] = field("Entries.")
        users: int = field("A number.", 3, default=1, returned="always")
        first: typing.Optional[Entry] = field("An entry.")

    return Entry, Whole


@pytest.fixture(params=["on a robot", "on the controller"])
def structs(request):
    made = make_structs()
    return [dataclass(frozen=True, init=False)(each) for each in made] if "controller" in request.param else made


def test_what_is_left_out_has_the_empty_value_of_its_type(structs):
    entry, whole = structs
    assert whole().plain() == {"text": "", "found": "not_tried", "entries": [], "users": 1, "first": None}
    assert entry("eth1").plain() == {"name": "eth1", "mtu": None}


def test_plain_data_has_all_fields(structs):
    entry, whole = structs
    made = whole(found=Outcome.OPEN, entries=[entry(name="eth0", mtu=9000)], first=entry("lo"))
    assert made.plain()["entries"] == [{"name": "eth0", "mtu": 9000}]
    assert made.plain()["first"] == {"name": "lo", "mtu": None} and made.plain()["found"] == "open"


def test_a_field_that_is_needed_or_unknown_is_an_error(structs):
    entry, whole = structs
    for wrong in (entry, lambda: entry("eth0", speed=1), lambda: whole(nothing=1)):
        with pytest.raises(TypeError):
            wrong()


def test_an_example_is_made_of_those_of_the_fields(structs):
    _entry, whole = structs
    example = {"name": "eth0", "mtu": 1500}
    assert whole.make_sample() == {"text": "a", "found": "open", "entries": [example], "users": 3, "first": example}


def test_when_a_field_is_returned_is_said_by_its_class_or_by_itself(structs):
    entry, whole = structs
    assert (whole.FIELDS["text"].returned, whole.FIELDS["users"].returned) == ("when O(action=collect)", "always")
    assert entry.FIELDS["mtu"].returned == "always"
