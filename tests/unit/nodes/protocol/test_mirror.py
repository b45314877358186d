# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The mirror of a roscore: what records tell is what getSystemState, getTopicTypes and the look-ups would tell."""

import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosfleet_multimaster.protocol.differences import Stamps
from rosfleet_multimaster.protocol.graph import InvalidDocument, State, add_stamps, build
from rosfleet_multimaster.protocol.mirror import Mirror

URI, OTHER = "http://own:11311/", "http://other:11311/"
NODES, NAMES, TYPES = ["/a", "/b", "/c"], ["/one", "/two", "/three"], ["std_msgs/Int32", "*"]

pairs = st.sets(st.tuples(st.sampled_from(NAMES), st.sampled_from(NODES)), max_size=5)
roscores = st.fixed_dictionaries(
    {
        "publisher": pairs,
        "subscriber": pairs,
        "service": st.dictionaries(st.sampled_from(NAMES), st.tuples(st.sampled_from(NODES), st.sampled_from("12"))),
        "type": st.dictionaries(st.sampled_from(NAMES), st.sampled_from(TYPES)),
        "node": st.fixed_dictionaries({node: st.sampled_from(["http://own:1/", "http://own:2/"]) for node in NODES}),
    }
)


def records(before, after):
    """The answer of a roscore about a change; all that it has if there is no state before."""
    found = []
    for kind in ("publisher", "subscriber"):
        old = before[kind] if before else set()
        found += [[kind, *pair, False] for pair in sorted(old - after[kind])]
        found += [[kind, *pair, True] for pair in sorted(after[kind] - old)]
    old = before["service"] if before else {}
    found += [["service", name, node, ""] for name, (node, _uri) in old.items() if name not in after["service"]]
    found += [["service", name, *to] for name, to in after["service"].items() if old.get(name) != to]
    for kind in ("type", "node"):
        old = before[kind] if before else {}
        found += [[kind, name, value] for name, value in after[kind].items() if old.get(name) != value]
    return found


def read(roscore, types, origins):
    """The state as the poller reads it; a roscore keeps types for ever."""
    tables = []
    for kind in ("publisher", "subscriber"):
        names = sorted({name for name, _node in roscore[kind]})
        tables.append({name: tuple(sorted(node for of, node in roscore[kind] if of == name)) for name in names})
    services = {name: (node,) for name, (node, _uri) in roscore["service"].items()}
    uris = {name: uri for name, (_node, uri) in roscore["service"].items()}
    return build(State(URI, "own", 0.0, 0.0, *tables, services, types), roscore["node"], uris, origins)


@pytest.mark.slow
@settings(max_examples=150, deadline=None)
@given(st.lists(st.tuples(roscores, st.booleans(), st.sets(st.sampled_from(NODES))), min_size=1, max_size=5))
def test_what_is_told_is_what_would_be_read(steps):
    mirror, stamps, before, last, types, origins = Mirror(URI, "own"), Stamps(), None, None, {}, {}
    for at, (roscore, whole, foreign) in enumerate(steps):
        whole = whole or before is None
        types = {**({} if whole else types), **roscore["type"]}
        mirror.take(whole, records(None if whole else before, roscore))
        origins = {key: of for key, of in origins.items() if key in roscore["node"].items()}
        told = {(node, roscore["node"][node]): OTHER for node in foreign}
        mirror.belong(told)
        origins.update(told)
        expected = read(roscore, types, origins)
        assert mirror.state == expected
        last, before = add_stamps(expected, last, 100.0 + at), roscore
        assert stamps.stamp(mirror.state, 100.0 + at) == last


def test_what_did_not_change_is_the_same_object():
    mirror = Mirror(URI, "own")
    mirror.take(True, [["publisher", "/one", "/a", True], ["node", "/a", "http://own:1/"], ["type", "/one", "*"]])
    before = mirror.state
    mirror.take(False, [["subscriber", "/one", "/a", True]])
    assert mirror.state.publishers is before.publishers and mirror.state.nodes is before.nodes


def test_unknown_is_left_out_and_malformed_refused():
    mirror = Mirror(URI, "own")
    mirror.take(True, [["refused", "/a", "http://other:1/", "why"], ["parameter", "/do_not_sync", ["/secret"]], []])
    assert mirror.parameters == {"/do_not_sync": ["/secret"]}
    mirror.take(False, [["parameter", "/do_not_sync"]])
    assert mirror.parameters == {}
    for malformed in (
        None,
        [["publisher", "/one", "/a"]],
        [["publisher", "/one", ["/a"], True]],
        [["service", "/one", {}, "http://own:1/"]],
        [["node", "/a", ["http://own:1/"]]],
        [["type", 1, "*"]],
        [[["node"], "/a", "http://own:1/"]],
    ):
        with pytest.raises(InvalidDocument):
            mirror.take(False, malformed)


def test_a_topic_of_20000_nodes_is_read_in_a_moment():
    """As many as the bundled roscore takes of one name: sorted anew for each, they took minutes."""
    began, mirror = time.monotonic(), Mirror(URI, "own")
    mirror.take(True, [["publisher", "/tf", f"/node{number}", True] for number in range(20_000)])
    assert len(mirror.state.publishers["/tf"]) == 20_000 and time.monotonic() - began < 5.0
