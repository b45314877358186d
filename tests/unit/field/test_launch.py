# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Launch files with upstream's nodes: what they set is a parameter of the bundled nodes, or a sentence names it."""

import xml.etree.ElementTree as xml

import field
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from rosfleet_multimaster.protocol.parameters import DISCOVERY, SYNC, ParameterError, overlay

TABLES = {"master_discovery": DISCOVERY, "master_sync": SYNC}


def given_by(node):
    """The private parameters of a node in a launch file, as roslaunch reads them."""
    found = {entry.get("name"): yaml.safe_load(entry.get("value")) for entry in node.iter("param")}
    for entry in node.iter("rosparam"):
        value = yaml.safe_load(entry.text)
        found.update({entry.get("param"): value} if entry.get("param") else value)
    return found


NODES = [
    (name, node.get("type"), given_by(node))
    for name, content in field.read("launch").items()
    for node in xml.fromstring(content.replace(b"$(arg group)", b"224.0.0.1")).iter("node")  # its default
]
VALUES = st.sampled_from(
    [value for _name, _kind, values in NODES for value in values.values()] + [None, "", [], {}, -1, 1e400]
)


@pytest.mark.parametrize(("file", "kind", "values"), NODES, ids=[f"{name}-{kind}" for name, kind, _values in NODES])
def test_a_launch_file_of_upstream_is_read(file, kind, values):
    try:
        taken, warnings = overlay(TABLES[kind], values, foreign=True)
    except ParameterError as problem:
        assert file == "everything_wrong.launch" and any(f"~{name}" in str(problem) for name in values)
        return
    assert file != "everything_wrong.launch"
    for name, value in values.items():
        assert taken.get(name) == value or any(name in text for text in warnings)


@given(
    kind=st.sampled_from(sorted(TABLES)),
    names=st.lists(st.sampled_from([n for *_rest, v in NODES for n in v]), max_size=4),
    values=st.lists(VALUES, min_size=4, max_size=4),
)
@field.tries()
def test_any_mixture_is_taken_or_named(kind, names, values):
    given_ = dict(zip(names, values, strict=False))
    try:
        taken, _warnings = overlay(TABLES[kind], given_, foreign=True)
    except ParameterError as problem:
        assert any(f"~{name}" in str(problem) for name in given_)
        return
    # A section of filters is taken for a host of its name.
    again = {name: taken[name] for name in given_ if name in taken}
    assert overlay(TABLES[kind], again, foreign=True)[0] == taken
