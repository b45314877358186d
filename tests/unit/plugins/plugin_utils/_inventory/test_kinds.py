# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Kinds of values: the nodes start with the filters that preflight accepts, and preflight refuses no others."""

import random
import sys

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain import to_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.sentences import UnexpectedValue
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory import kinds
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory.exports import (
    make_node_filters,
    read_exports,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory.read import (
    Inventory,
    InventoryProblems,
    read_fleet,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.plan import fleet_plan
from mentioned import mentions
from rosfleet_multimaster.protocol import parameters

PIECES = (
    *("/", "a", "tf", "*", "|", ".", "(", ")", "[a-z]", "[", "?", "+", "{2}", "{99999999999}", "$", "^", "\\", r"\1"),
    *(
        "(?i)",
        "(?x)",
        "(?a)",
        "(?u)",
        "(?i:",
        "(?P<n>a)",
        "(?P<m>b)",
        "(?P=n)",
        "(?!x)",
        "(?<=a*)",
        r"\Z",
        r"\d",
        "é",
        "#",
    ),
)
pytestmark = pytest.mark.filterwarnings("ignore:Possible nested set:FutureWarning")

LONG = "/" + "a" * 30000
SEEDS = range(400)


def draw_filters(seed):
    chance = random.Random(seed)

    def pattern():
        if chance.random() < 0.4:
            return f"/{chance.choice('abc')}{chance.choice(('', '*', '|/d', '(e|f)'))}"
        if chance.random() < 0.01:
            return LONG
        return "".join(chance.choices(PIECES, k=chance.randint(1, 4)))

    names = chance.sample(kinds.FILTERS, chance.randint(1, 3))
    return {name: [pattern() for _number in range(chance.randint(1, 3))] for name in names}


def draw_exports(seed):
    chance = random.Random(seed)
    kind, count, longest = (
        chance.choice(("topics", "services", "actions")),
        chance.choice((1, 9, 900, 8000)),
        chance.randint(3, 9),
    )
    names = {"/" + "".join(chance.choices("abcdef012", k=chance.randint(2, longest))) for _number in range(count)}
    return [{kind: sorted(names)}, {"topics": ["/a*b", "*/c*"]}]


def is_accepted(value, read=kinds.filters):
    try:
        read(value)
    except UnexpectedValue:
        return False
    return True


def starts_with(values, table=parameters.SYNC):
    try:
        parameters.overlay(table, values)
    except parameters.ParameterError:
        return False
    return True


def plan_of(filters, exports=({"topics": ["/a*"], "to": ["eve"]},)):
    """Return the plan of three robots: ana has these filters, bob declares what it gives."""
    shared = {"multimaster_common_network": "192.168.1.0/24"}
    variables = {
        "ana": {**shared, "multimaster_address": "192.168.1.10", "multimaster_filters": filters},
        "bob": {**shared, "multimaster_address": "192.168.1.11", "multimaster_exports": [*exports]},
        "eve": {**shared, "multimaster_address": "192.168.1.12"},
    }
    fleet = read_fleet(Inventory(robots={name: [name] for name in variables}, variables=variables))
    return to_plain(fleet_plan(fleet))["computers"]


def test_nodes_start_with_filters_that_preflight_accepts():
    values = [draw_filters(seed) for seed in SEEDS]
    accepted = [value for value in values if is_accepted(value)]
    assert 40 < len(accepted) < 360
    assert [value for value in accepted if not starts_with(plan_of(value)["ana"]["sync"])] == []


def test_preflight_refuses_only_filters_that_nodes_refuse():
    values = [value for value in map(draw_filters, SEEDS) if all(p.strip() for items in value.values() for p in items)]
    assert [value for value in values if not is_accepted(value) and starts_with(make_node_filters(value))] == []


@pytest.mark.slow
def test_nodes_start_with_exports_that_preflight_accepts():
    values = [draw_exports(seed) for seed in range(12)]
    accepted = [value for value in values if is_accepted(value, read_exports)]
    assert 2 < len(accepted) < 12
    for value in accepted:
        plans = plan_of({}, value)
        assert starts_with(plans["ana"]["sync"]) and starts_with(plans["bob"]["discovery"], parameters.DISCOVERY)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        ({"ignore_topics": ["/a[b"]}, "ignore_topics /a[b"),
        ({"ignore_hosts": ["(?P<n>a)", "(?P<n>b)"]}, "ignore_hosts P<n>b"),
        ({"sync_hosts": ["(?P<n>a)", "(?P<n>b)"]}, "sync_hosts P<n>b"),
        ({"ignore_actions": ["/(?P<n>a)"]}, "ignore_actions ignore_topics /(?P<n>a)/cancel"),
        ({"ignore_topics": ["(?P<n>a)"], "ignore_actions": ["/a", "/(?P<n>b)"]}, "ignore_actions expressions"),
        ({"ignore_topics": ["a{99999999999}"]}, "repetition large"),
        ({"ignore_topics": ["(?a)(?u)/b"]}, "ignore_topics expressions"),
        ({"ignore_topics": [LONG, LONG, LONG]}, "65536 characters"),
        ({"ignore_topics": [" "]}, "empty texts"),
    ],
)
def test_filters_that_no_node_starts_with_are_one_sentence(value, text):
    with pytest.raises(UnexpectedValue) as caught:
        kinds.filters(value)
    assert mentions(str(caught.value), *text.split())


@pytest.mark.skipif(sys.version_info < (3, 11), reason="older Pythons accept it")
def test_a_flag_that_is_not_first_in_its_anchors_is_refused():
    with pytest.raises(UnexpectedValue, match="is no regular expression: global flags"):
        kinds.filters({"sync_hosts": ["(?i)/tf"]})


@pytest.mark.parametrize("name", sorted(name for name in parameters.SYNC if "_" not in name))
def test_a_declaring_master_is_not_called_like_a_parameter(name):
    """The white list that the others have for it would be the value of the parameter."""
    shared = {"multimaster_common_network": "192.168.1.0/24"}
    variables = {
        "ana": {**shared, "multimaster_address": "192.168.1.10"},
        name: {**shared, "multimaster_address": "192.168.1.11"},
    }
    inventory = Inventory(robots={"robot1": ["ana"], "robot2": [name]}, variables=variables)
    assert starts_with(to_plain(fleet_plan(read_fleet(inventory)))["computers"]["ana"]["sync"])
    variables[name]["multimaster_exports"] = [{"topics": ["/a"]}]
    with pytest.raises(InventoryProblems, match=f"the name of its master, {name}, is that of a parameter"):
        read_fleet(inventory)
