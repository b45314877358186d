# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The bounds of a roscore: the values that count, and that the sums stay right whatever changes."""

import json
import pathlib
import random
import re
import sys
import xmlrpc.client

import pytest
from rosfleet_multimaster.protocol import xml_rpc
from rosfleet_multimaster.roscore.core import bounds
from rosfleet_multimaster.roscore.core.bounds import BOUNDS, BoundRefusal, Usage, weigh, weigh_parameter
from rosfleet_multimaster.roscore.core.registry import Registry

from tests.unit.nodes.roscore.records import rec

PAGE = pathlib.Path(__file__).parents[5] / "docs" / "understand" / "roscore.md"


def nested(levels, value=1):
    for _level in range(levels):
        value = {"a": value}
    return value


def some(rng, depth=0):
    """A value of any kind."""
    kind = rng.randrange(7 if depth < 4 else 5)
    if kind == 5:
        return [some(rng, depth + 1) for _count in range(rng.randrange(5))]
    if kind == 6:
        return {f"k{rng.randrange(6)}": some(rng, depth + 1) for _count in range(rng.randrange(5))}
    return [rng.randrange(-(2**31), 2**31), rng.random(), '&<"\n' * rng.randrange(3000), "\U0001f916" * 9, True][kind]


@pytest.mark.parametrize("seed", range(200))
def test_a_value_counts_what_it_costs_in_files_and_answers(seed):
    value = some(random.Random(seed))
    found = weigh(value)
    assert found >= len(json.dumps(value, ensure_ascii=False).encode())
    assert found >= len(xmlrpc.client.dumps((value,)).encode()) - 100
    assert found >= size(value)


def size(value):
    """Bytes of memory."""
    parts = value if isinstance(value, list) else [*value, *value.values()] if isinstance(value, dict) else []
    return sys.getsizeof(value) + sum(map(size, parts))


@pytest.mark.parametrize("seed", range(100))
def test_the_sum_of_the_parameters_is_right_after_any_changes(seed):
    rng, usage, registry = random.Random(seed), Usage(), Registry()
    for _change in range(60):
        name = "/" + "/".join(f"k{rng.randrange(6)}" for _part in range(rng.randrange(1, 4)))
        if rng.random() < 0.3:
            usage.parameters -= weigh_parameter(registry.parameters, name)
            registry.apply(rec("delete", name))
        else:
            value = some(rng) if rng.random() < 0.95 else {"k1": some(rng)}
            name = name if rng.random() < 0.95 or not isinstance(value, dict) else "/"
            usage.parameters += usage.growth(registry.parameters, name, value)
            registry.apply(rec("set", name, value))
        assert usage.parameters == weigh(registry.parameters)


def test_the_sum_of_the_registrations_is_right():
    usage = Usage()
    of = ["/a", "http://robot:1/"]
    there = [
        rec("publisher", "/t", *of, True),
        rec("service", "/s", "/a", "rosrpc://robot:2", of[1], True),
        rec("node", *of),
    ]
    there += [rec("type", "/t", "std_msgs/String"), rec("service", "/s", "/b", "rosrpc://b:2", "http://b:1/", True)]
    for record in there:
        usage.count(record)
    assert usage.registrations > 3000
    for record in (
        rec("publisher", "/t", *of, False),
        rec("service", "/s", "/b", "rosrpc://b:2", "http://b:1/", False),
    ):
        usage.count(record)
    usage.count(rec("node", "/a", ""))
    usage.count(rec("type", "/t", ""))
    assert usage.registrations == 0


@pytest.mark.parametrize(
    ("name", "value", "bound"),
    [
        ("/a", nested(64), "depth"),
        ("/a" * 64, nested(1), "depth"),
        ("/a" * 100, 1, "depth"),
        ("/a", [[[nested(70)]]], "depth"),
        ("/a", "x" * (33 << 20), "parameter"),
        ("/a", "&" * (6 << 20), "parameter"),
        ("/a", {"a": {7: 1}}, ""),
        ("/a", xmlrpc.client.DateTime("<value>"), ""),
    ],
)
def test_what_is_beyond_is_refused_with_a_sentence(name, value, bound):
    with pytest.raises(BoundRefusal) as refusal:
        Usage().growth({}, name, value)
    assert refusal.value.bound == bound and str(refusal.value).startswith(name[:10])


def test_all_parameters_together_have_a_bound_and_may_shrink():
    usage, tree = Usage(), {}
    for number in range(3):
        usage.parameters += usage.growth(tree, f"/p{number}", "x" * (20 << 20))
        tree[f"p{number}"] = "x" * (20 << 20)
    with pytest.raises(BoundRefusal, match="64 MiB"):
        usage.growth(tree, "/p3", "x" * (20 << 20))
    assert usage.growth(tree, "/p1", "small") < 0


def test_real_things_are_taken():
    urdf = '<link name="wheel"><visual/></link>\n' * 140_000  # 5 MB
    assert Usage().growth({}, "/robot_description", urdf) < BOUNDS["parameter"].most / 2
    topics = sum(
        bounds.weigh_registration(f"/robot_{number}/camera/image_{number}", "/node", "http://robot:40000/")
        for number in range(20 * 5000)
    )
    assert topics < 0.7 * BOUNDS["registrations"].most


@pytest.mark.parametrize("text", ["\0", "\ud800", "\x1b", "\uffff"])
def test_characters_that_xml_has_not(text):
    assert not bounds.is_writable([["setParam", {"a": [text]}]]) and not bounds.is_writable([{text: 1}])
    assert bounds.is_writable(["\t\n\r \u00fc\U0001f916"])


def test_the_page_has_the_table():
    rows = [
        line.strip("| ").split(" | ") for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("| ")
    ]
    for name, row in BOUNDS.items():
        shown = f"{row.most // bounds.MIB} MiB" if row.most >= bounds.MIB else f"{row.most:,}"
        what, _semicolon, shares = row.what.partition(";")
        assert [name, shown, what] in rows, name
        assert all(figure in PAGE.read_text(encoding="utf-8") for figure in re.findall(r"\d{3,}", shares)), name


def test_the_bound_of_elements_is_that_of_the_reader():
    assert BOUNDS["elements"].most == xml_rpc._NESTING


def test_all_bounds_together_are_below_the_memory_of_the_unit():
    """The text of the unit: plugins/plugin_utils/_plan/units.py."""
    memory = (
        sum(BOUNDS[name].most for name in ("parameters", "registrations", "under way")) + 3 * BOUNDS["parameter"].most
    )
    assert memory < 0.95 * (1 << 30)
