# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Differences: what is told by them is what the whole document tells, for whatever rules, after whatever happened."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosfleet_multimaster.protocol import differences
from rosfleet_multimaster.protocol.differences import History, apply_difference, changes, difference_in_view, digest
from rosfleet_multimaster.protocol.filters import Pattern, Rules
from rosfleet_multimaster.protocol.graph import (
    ExportPolicy,
    InvalidDocument,
    State,
    add_stamps,
    build,
    document,
    parse,
)

URI, OTHER = "http://own:11311/", "http://other:11311/"
NODES = ["/a/one", "/a/two", "/b/one", "/far"]
TOPICS = ["/tf", "/a/pose", "/b/pose", "/secret", "/camera"]
SERVICES = ["/a/get", "/b/get", "/tf"]
TYPES = ["std_msgs/Int32", "std_msgs/String", "*"]
CALLER = "192.168.1.9"


def endpoints(names):
    users = st.lists(st.sampled_from(NODES), min_size=1, max_size=3, unique=True).map(
        lambda found: tuple(sorted(found))
    )
    return st.dictionaries(st.sampled_from(names), users, max_size=4)


#: a roscore: who has what, the URIs of nodes and services, and which nodes were imported
roscores = st.tuples(
    endpoints(TOPICS),
    endpoints(TOPICS),
    st.dictionaries(st.sampled_from(SERVICES), st.sampled_from(NODES).map(lambda node: (node,)), max_size=3),
    st.fixed_dictionaries({topic: st.sampled_from(TYPES) for topic in TOPICS}),
    st.fixed_dictionaries({node: st.sampled_from(["http://own:1/", "http://own:2/"]) for node in NODES}),
    st.fixed_dictionaries({name: st.sampled_from(["rosrpc://own:1", "rosrpc://own:2"]) for name in SERVICES}),
    st.sets(st.sampled_from(NODES), max_size=2),
)
patterns = st.lists(st.sampled_from(["/a/*", "/b/pose", "/secret", "*", "/far", "/tf"]), max_size=2)
policies = st.fixed_dictionaries(
    {
        "hide_topics": patterns,
        "hide_nodes": patterns,
        "hide_services": patterns,
        "hide_subscribers": patterns,
        "do_not_sync": patterns,
        "exports": st.none()
        | st.lists(
            st.fixed_dictionaries({"to": st.sampled_from([["*"], [CALLER]]), "topics": patterns, "services": patterns}),
            max_size=2,
        ),
    }
).map(ExportPolicy.from_parameters)
wanted = st.fixed_dictionaries(
    dict.fromkeys(("ignore_nodes", "sync_topics", "sync_services", "ignore_publishers", "ignore_type"), patterns)
).map(lambda found: Rules(**{name: Pattern.from_items(items) for name, items in found.items()}))


def state_of(roscore, before):
    publishers, subscribers, services, types, uris, service_uris, foreign = roscore
    origins = {(node, uris[node]): OTHER for node in foreign}
    made = build(State(URI, "own", 0.0, 0.0, publishers, subscribers, services, types), uris, service_uris, origins)
    return add_stamps(made, before, 1000.0 if before is None else before.stamp + 1.0)


def viewer(policy, rules):
    def view(state):
        shown, given_rules = policy.view(state, CALLER)
        return document(shown, [*given_rules, rules])

    return view


@pytest.mark.slow
@settings(max_examples=100, deadline=None)
@given(st.lists(roscores, min_size=2, max_size=6), policies, wanted, st.lists(st.booleans(), min_size=6, max_size=6))
def test_what_differences_tell_is_what_the_whole_tells(roscores, policy, rules, asks):
    """The asker does not ask after each change; it never sees a name that the whole does not show."""
    view, history, state = viewer(policy, rules), History(), None
    for roscore, ask in zip(roscores, asks):
        before, state = state, state_of(roscore, state)
        if before is None:
            held, revision = parse(view(state)), history.revision
            continue
        history.add(changes(before, state))
        if not ask:
            continue
        found = difference_in_view(state, history.undo_since(revision), view)
        whole = parse(view(state))
        if found is not None:
            shown = repr(found)
            hidden = [name for name in {*TOPICS, *SERVICES, *NODES} if name not in repr(whole) + repr(held)]
            assert not [name for name in hidden if f"'{name}'" in shown]
            assert apply_difference(held, found.document, found.gone) == whole
            assert digest(apply_difference(held, found.document, found.gone)) == digest(whole)
        held, revision = whole, history.revision


def first():
    roscore = (
        {"/tf": ("/a/one", "/b/one"), "/a/pose": ("/a/one",)},
        {"/tf": ("/a/two",)},
        {"/a/get": ("/a/one",)},
        dict.fromkeys(TOPICS, "std_msgs/Int32"),
        dict.fromkeys(NODES, "http://own:1/"),
        dict.fromkeys(SERVICES, "rosrpc://own:1"),
        set(),
    )
    return state_of(roscore, None)


def whole(state):
    return document(state)


def test_one_new_topic_is_one_row():
    before = first()
    after = State(**{**before.__dict__, "publishers": {**before.publishers, "/b/pose": ("/b/one",)}})
    found = difference_in_view(after, changes(before, after), whole)
    assert found.document[4:] == [
        [["/b/pose", ["/b/one"]]],
        [],
        [],
        [],
        [["/b/one", "http://own:1/", URI, None, "local"]],
        [],
    ]
    assert found.gone == [[], [], []]
    left = apply_difference(before, found.document, found.gone)
    assert left == after and left.types is before.types and left.nodes is before.nodes, "what did not change is shared"


def test_a_moved_node_is_told_to_the_robots_that_see_it():
    before = first()
    moved = before.nodes["/b/one"]._replace(uri="http://own:2/")
    after = State(**{**before.__dict__, "nodes": {**before.nodes, "/b/one": moved}})
    undo = changes(before, after)
    assert difference_in_view(after, undo, whole).document[8] == [["/b/one", "http://own:2/", URI, None, "local"]]
    hidden = viewer(ExportPolicy.from_parameters({"hide_nodes": ["/b/*"]}), Rules())
    assert not difference_in_view(after, undo, hidden)


def test_a_change_that_is_hidden_is_no_difference():
    before = first()
    after = State(**{**before.__dict__, "publishers": {**before.publishers, "/secret": ("/a/one",)}})
    assert not difference_in_view(
        after, changes(before, after), viewer(ExportPolicy.from_parameters({"hide_topics": ["/secret"]}), Rules())
    )


def test_a_type_that_goes_while_its_topic_stays_takes_the_whole():
    before = first()
    after = State(**{**before.__dict__, "types": {"/tf": "std_msgs/Int32"}})
    assert difference_in_view(after, changes(before, after), whole) is None


def test_a_history_reaches_back_as_far_as_there_is_room(monkeypatch):
    monkeypatch.setattr(differences, "MOST_RECORDS", 3)
    monkeypatch.setattr(differences, "MOST_NAMES", 4)
    history = History()
    start = history.revision
    for number in range(5):
        history.add({"types": {"/tf": f"old {number}"}})
    assert history.undo_since(start) is None and history.undo_since(history.revision + 1) is None
    assert history.undo_since(history.revision) == {}
    assert history.undo_since(history.revision - 3) == {"types": {"/tf": "old 2"}}, "the oldest one counts"
    history.add({"types": {f"/{number}": None for number in range(5)}})
    assert history.undo_since(history.revision - 1) is None and history.undo_since(history.revision) == {}


@pytest.mark.parametrize(
    "told_document, gone",
    [
        ([], [[], [], []]),
        (whole(State(OTHER, "other")), [[], [], []]),
        (whole(State(URI, "own")), []),
        (whole(State(URI, "own")), [[], [], [1]]),
        (whole(State(URI, "own")), None),
        (whole(State(URI, "own"))[:9] + [[["/a/get"]]], [[], [], []]),
    ],
)
def test_what_is_no_difference_is_refused(told_document, gone):
    with pytest.raises(InvalidDocument):
        apply_difference(first(), told_document, gone)


def test_an_odd_type_takes_the_place_of_the_one_before():
    state, odd = first(), whole(State(URI, "own"))
    odd[7] = [["/tf", "no type\n"]]
    assert "/tf" not in apply_difference(state, odd, [[], [], []]).types
