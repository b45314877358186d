# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Steps: where one is planned, it is what a round would plan; and one is planned for what is simple."""

import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosfleet_multimaster.protocol.messages import Registration, View
from rosfleet_multimaster.sync.core.step import Knowledge, apply_plan, condition_of, step
from rosfleet_multimaster.sync.core.sync import Candidate, plan

MASTER, THIRD = "http://robot2:11311/", "http://robot3:11311/"
TOPICS, NODES = ["/one", "/two", "/three"], ["/a", "/b", "/own"]


def registration(kind, name, node, uri="http://robot2:1/"):
    return Registration(kind, name, node, uri, "rosrpc://robot2:2" if kind == "service" else "")


def want(item, master=MASTER):
    return Candidate(item, master, "robot2", "std_msgs/Int32")


registrations = st.builds(
    registration,
    st.sampled_from(["publisher", "subscriber", "service"]),
    st.sampled_from(TOPICS),
    st.sampled_from(NODES),
)
owned = st.sets(
    st.tuples(st.sampled_from(["publishers", "subscribers", "services"]), st.sampled_from(TOPICS)), max_size=2
)


def roscore(own, held=()):
    """The content of a roscore: some names of the own node, and what was registered."""
    tables = {"publishers": {}, "subscribers": {}, "services": {}}
    for kind, name in own:
        tables[kind][name] = ("/own",)
    view = View(**tables, types={}, node_uris={"/own": "http://robot1:9/"} if own else {})
    view.service_uris.update({name: "rosrpc://robot1:9" for kind, name in own if kind == "services"})
    for item in held:
        table = tables[f"{item.kind}s"]
        table[item.name] = tuple(sorted({*table.get(item.name, ()), item.node}))
        view.node_uris[item.node] = item.node_uri
        if item.kind == "service":
            view.service_uris[item.name] = item.service_uri
    return view


def one_provider(items):
    """A service has one provider."""
    seen = {}
    return [item for item in sorted(items) if item.kind != "service" or seen.setdefault(item.name, item) == item]


@pytest.mark.slow
@settings(max_examples=300, deadline=None)
@given(st.sets(registrations, max_size=5), st.sets(registrations, max_size=5), owned)
def test_a_step_is_what_a_round_would_do(before, now, own):
    first = plan([want(item) for item in one_provider(before)], roscore(own), {})
    view = roscore(own, first.held)
    wanted = [want(item) for item in one_provider(now)]
    touched = {item.registration for item in wanted} ^ {*first.held, *one_provider(before)}
    found = step(
        touched,
        {item.registration: item for item in wanted if item.registration in touched},
        Knowledge(view, first.claims, first.held, {refusal.name for refusal in first.refused}),
        lambda name, master: False,
    )
    if found is None or any(node == "/own" and own for _call, node in condition_of(found, first.claims, False)):
        return  # it takes a round; or what is asked before it is written says so
    whole = plan(wanted, view, first.claims)
    assert (found.register, found.unregister, found.held) == (whole.register, whole.unregister, whole.held)
    assert {
        key: of for key, of in found.claims.items() if key in {item.node_key for item in found.held}
    } == whole.claims or (whole.unregister)
    assert apply_plan(found, view).registrations(found.claims) == set(found.held)


ONE = registration("publisher", "/one", "/a")
SERVICE = registration("service", "/get", "/a")
EMPTY = View({}, {}, {}, {}, {}, {})


def stepped(item, view=EMPTY, claims=(), held=(), refused=(), contested=False):
    known = Knowledge(view, dict(claims), dict(held), refused)
    return step({item}, {item: want(item)}, known, lambda name, master: contested)


def test_what_is_simple_is_planned_and_its_names_are_asked_for():
    found = stepped(ONE)
    assert found.register == [ONE] and found.claims == {ONE.node_key: MASTER} and found.types == {ONE: "std_msgs/Int32"}
    assert condition_of(found, {}, False) == {("lookupNode", "/a"): None}
    known = condition_of(stepped(ONE, claims=[(ONE.node_key, MASTER)]), {ONE.node_key: MASTER}, False)
    assert known == {("lookupNode", "/a"): ONE.node_uri}
    assert condition_of(stepped(SERVICE), {}, False) == dict.fromkeys([("lookupNode", "/a"), ("lookupService", "/get")])


def test_a_roscore_that_guards_names_is_asked_for_services_alone():
    assert not condition_of(stepped(ONE), {}, True)
    assert not condition_of(stepped(ONE, claims=[(ONE.node_key, MASTER)]), {ONE.node_key: MASTER}, True)
    assert condition_of(stepped(SERVICE), {}, True) == {("lookupService", "/get"): None}


@pytest.mark.parametrize(
    "item, more",
    [
        (ONE, {"view": View({}, {"/one": ("/own",)}, {}, {})}),  # the type guard must look
        (ONE, {"view": View({"/other": ("/a",)}, {}, {}, {}, {"/a": "http://robot1:9/"})}),  # an own node has its name
        (ONE, {"refused": {"/one"}}),
        (ONE, {"refused": {"/a"}}),
        (ONE, {"contested": True}),
        (ONE, {"claims": [(("/a", "http://robot2:7/"), MASTER)]}),  # its node came back with another URI
        (ONE, {"claims": [(ONE.node_key, THIRD)]}),
        (SERVICE, {"view": View({}, {}, {"/get": ("/own",)}, {})}),
        (SERVICE, {"view": View({}, {}, {"/get": ("/a",)}, {}), "claims": [(SERVICE.node_key, MASTER)]}),
    ],
)
def test_what_is_not_simple_takes_a_round(item, more):
    assert stepped(item, **more) is None


@pytest.mark.parametrize(("item", "name"), [(ONE, "/a"), (SERVICE, "/a"), (SERVICE, "/get")])
def test_a_name_that_another_master_has_too_takes_a_round(item, name):
    def stepped_beside(taken):
        return step({item}, {item: want(item)}, Knowledge(EMPTY, {}, {}, set()), lambda asked, master: asked == taken)

    assert stepped_beside(name) is None and stepped_beside("/other") is not None


def test_a_refused_and_gone_topic_takes_a_round():
    known = Knowledge(EMPTY, {}, {}, {"/one"})
    assert step({ONE}, {}, known, lambda name, master: False) is None


def test_a_held_topic_that_has_another_type_now_takes_a_round():
    held = {"claims": [(ONE.node_key, MASTER)], "held": [(ONE, MASTER)]}
    assert stepped(ONE, View({"/one": ("/a",)}, {}, {}, {"/one": "std_msgs/String"}), **held) is None
    assert stepped(ONE, View({"/one": ("/a",)}, {}, {}, {"/one": "std_msgs/Int32"}), **held) is not None


def test_what_is_held_already_is_nothing_to_do():
    found = stepped(ONE, claims=[(ONE.node_key, MASTER)], held=[(ONE, MASTER)])
    assert not found.register and not found.unregister


@pytest.mark.parametrize("topic", ["/one", "/new{}"])
def test_a_robot_of_5000_nodes_is_planned_in_a_moment(topic):
    """The loop waits for it, and the watchdog with it. It took 10 s: for each node there was a look at all others."""
    uris = {f"/n{at}": f"http://robot2:{at + 1024}/" for at in range(5000)}
    items = {registration("publisher", topic.format(node[1:]), node, uri) for node, uri in uris.items()}
    there = View({f"/there{at}": ("/far",) for at in range(100_000)}, {}, {}, {}, {"/far": "http://far:1/"})
    claims = {("/far", "http://far:1/"): THIRD}
    began = time.monotonic()
    todo = step(items, {item: want(item) for item in items}, Knowledge(there, claims, {}, set()), lambda *_name: False)
    after = apply_plan(todo, there)
    assert set(todo.register) == items and len(after.publishers) == 100_000 + len({item.name for item in items})
    gone = step(items, {}, Knowledge(after, todo.claims, todo.held, set()), lambda *_name: False)
    assert set(gone.unregister) == items and apply_plan(gone, after).publishers == there.publishers
    assert time.monotonic() - began < 4.0
