# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The plan of parameters that cross: never over a value of somebody else, and nothing of ours stays behind."""

import json
import random

import pytest
from rosfleet_multimaster.sync.core import copies
from rosfleet_multimaster.sync.core.copies import Contents, Copy, OfferedParameter
from rosfleet_multimaster.sync.core.values import digest


def offers(**values):
    return {f"/{name}": OfferedParameter("robot2", value, digest(value)) for name, value in values.items()}


def own(**parameters):
    """The own roscore, with these parameters below the root."""
    digests = {f"/{name}": digest(value) for name, value in parameters.items()}
    return Contents(frozenset(leaves(parameters)), digests)


def leaves(tree, at=""):
    for name, value in tree.items():
        if isinstance(value, dict):
            yield from leaves(value, f"{at}/{name}")
        else:
            yield f"{at}/{name}"


def ours(**values):
    return {f"/{name}": Copy("robot2", (digest(value),)) for name, value in values.items()}


def planned(offered, there, record=None, keep=()):
    todo = copies.plan_copies(offered, set(keep), record or {}, there)
    return todo.delete, todo.set, sorted(todo.record), [item.name for item in todo.refused]


def test_a_free_name_is_set():
    assert planned(offers(a=1), own()) == ([], {"/a": 1}, ["/a"], [])


def test_what_is_there_already_of_ours_is_left_alone():
    assert planned(offers(a=1), own(a=1), ours(a=1)) == ([], {}, ["/a"], [])


def test_a_new_value_replaces_ours():
    todo = copies.plan_copies(offers(a=2), set(), ours(a=1), own(a=1))
    assert todo.set == {"/a": 2} and todo.record["/a"].digests == (digest(1), digest(2)), "either may be there"
    assert copies.settle(todo, set())["/a"].digests == (digest(2),)
    assert copies.settle(todo, {"/a"})["/a"].digests == (digest(1), digest(2))


@pytest.mark.parametrize("there", [own(a=5), own(a=1), own(a={"b": 5})], ids=["other", "same", "below"])
def test_a_value_of_somebody_else_is_never_touched(there):
    assert planned(offers(a=1), there) == ([], {}, [], ["/a"])


def test_no_namespace_takes_the_place_of_a_value():
    offered = {"/a/b": OfferedParameter("robot2", 1, digest(1))}
    assert planned(offered, own(a=5)) == ([], {}, [], ["/a/b"])
    assert planned(offered, own(a={"c": 5}))[1] == {"/a/b": 1}


def test_who_changed_our_value_has_it_from_then_on():
    assert planned(offers(a=2), own(a=7), ours(a=1)) == ([], {}, [], ["/a"])
    assert planned({}, own(a=7), ours(a=1)) == ([], {}, [], [])


def test_what_is_not_offered_any_more_is_taken_away():
    assert planned({}, own(a=1), ours(a=1)) == (["/a"], {}, [], [])
    assert planned({}, own(a=1), ours(a=1), keep=["/a"]) == ([], {}, ["/a"], [])


def test_what_somebody_took_away_is_set_again():
    assert planned(offers(a=1), own(), ours(a=1)) == ([], {"/a": 1}, ["/a"], [])
    assert planned({}, own(), ours(a=1)) == ([], {}, [], [])


def test_a_name_of_an_earlier_plan_gives_way():
    offered = {"/a/b": OfferedParameter("robot2", 1, digest(1))}
    assert planned(offered, own(a={"c": 1}), ours(a={"c": 1})) == (["/a"], {"/a/b": 1}, ["/a/b"], [])
    record = {"/a/c": Copy("robot2", (digest(1),))}
    there = Contents(frozenset({"/a/c"}), {"/a": digest({"c": 1}), "/a/c": digest(1)})
    assert planned(offers(a=1), there, record) == (["/a/c"], {"/a": 1}, ["/a"], [])


def test_a_record_is_read_as_it_was_written():
    record = {"/a": Copy("robot2", ("x", "y")), "/b/c": Copy("robot3", ("z",))}
    assert copies.read(copies.write(record)) == record


@pytest.mark.parametrize(
    "name", ["/run_id", "/roslaunch/uris/x", "/", "a", "/a//b", "/rosfleet_multimaster/imports", "/a b"]
)
def test_a_forged_record_has_no_name_that_never_crosses(name):
    assert copies.read(json.dumps({name: ["robot2", "x"], "/a": ["robot2", "x"]})) == {"/a": Copy("robot2", ("x",))}


@pytest.mark.parametrize("text", ["", "[1]", "{", None, 7, '{"/a": 1}', '{"/a": []}', '{"/a": [1]}', "[" * 9999])
def test_a_damaged_record_is_an_empty_one(text):
    assert copies.read(text) == {}


# Drawn: a roscore that others write to as well

NAMES = ("a", "a/b", "a/b/c", "d")


def find(tree, name):
    for part in name.split("/"):
        if not isinstance(tree, dict) or part not in tree:
            return None
        tree = tree[part]
    return tree


def put(tree, name, value):
    *parents, last = name.split("/")
    for part in parents:
        if not isinstance(tree.get(part), dict):
            tree[part] = {}
        tree = tree[part]
    if value is None:
        tree.pop(last, None)
    else:
        tree[last] = value


def look(tree):
    there = {f"/{name}": find(tree, name) for name in NAMES}
    return Contents(
        frozenset(leaves(tree)), {name: digest(value) for name, value in there.items() if value not in (None, {})}
    )


@pytest.mark.parametrize("seed", range(30))
def test_drawn_changes_never_touch_what_others_have_set(seed):
    numbers, tree, record = random.Random(seed), {}, {}
    for step in range(200):
        if numbers.random() < 0.3:  # somebody else; each of these values is there once
            put(tree, numbers.choice(NAMES), numbers.choice([None, f"own {step}", {"x": f"own {step}"}]))
        name = numbers.choice(NAMES)  # the plan has no name below another one
        value = numbers.choice([step, {"b": step}, {"x": {"y": step}}])
        offered = {f"/{name}": OfferedParameter("robot2", value, digest(value))} if numbers.random() < 0.7 else {}
        before = json.loads(json.dumps(tree))
        todo = copies.plan_copies(offered, set(), record, look(tree))
        for gone in todo.delete:
            put(tree, gone[1:], None)
        for new, made in todo.set.items():
            put(tree, new[1:], made)
        record = copies.settle(todo, set())
        if numbers.random() < 0.2:  # killed: the next life has the record alone
            record = copies.read(copies.write(todo.record))
        others = {leaf for leaf in leaves(before) if str(find(before, leaf[1:])).startswith("own")}
        assert all(find(tree, leaf[1:]) == find(before, leaf[1:]) for leaf in others)
    todo = copies.plan_copies({}, set(), record, look(tree))
    for gone in todo.delete:
        put(tree, gone[1:], None)
    assert all(str(find(tree, leaf[1:])).startswith("own") or _is_mixed(tree, leaf) for leaf in leaves(tree))


def _is_mixed(tree, leaf):
    """Return True if a program of others has put a value into a namespace of ours: then all of it is theirs."""
    top = find(tree, leaf[1:].split("/")[0])
    return isinstance(top, dict) and any(str(find(top, name[1:])).startswith("own") for name in leaves(top))
