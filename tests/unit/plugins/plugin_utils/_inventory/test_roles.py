# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Options of roles in an inventory: a misspelt name is told, and a name of others is left alone."""

import random
from pathlib import Path

import pytest
import yaml
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory.roles import (
    find_misspelt,
    read_options,
    say_wrong,
)
from mentioned import mentions

ROOT = Path(__file__).parents[5]
OPTIONS = read_options()


def test_all_options_have_a_type():
    assert {"routes_on_conflict", "hosts_path", "services_timeout"} <= set(OPTIONS)
    assert all("type" in specification for specification in OPTIONS.values())


@pytest.mark.parametrize("seed", range(40))
def test_an_option_with_one_letter_wrong_is_told(seed):
    draw = random.Random(seed)
    option = draw.choice([name for name in sorted(OPTIONS) if len(name) > 11])
    at = draw.randrange(option.index("_") + 1, len(option))
    name = option[:at] + draw.choice(["", "x", option[at] * 2]) + option[at + 1 :]
    if name not in OPTIONS:
        assert find_misspelt([name], OPTIONS) == {name: option}


def test_other_peoples_variables_are_left_alone():
    names = [
        "services_enabled",
        "hosts_domain",
        "nodes",
        "routes",
        "sysctl_config",
        "firewall_allowed_ports",
        "verify_ssl",
    ]
    assert find_misspelt([*names, *OPTIONS, "ansible_host"], OPTIONS) == {}


def test_names_of_our_roles_and_inventories_are_no_misspellings():
    names = set()
    for folder in ("roles", "inventory", "playbooks", "extensions", "tests/systems", "lab"):
        for path in (ROOT / folder).rglob("*.yml"):
            for document in yaml.load_all(path.read_text(encoding="utf-8"), _Tolerant):
                names |= set(_keys(document))
    assert len(names) > 100
    assert find_misspelt(names, OPTIONS) == {}


class _Tolerant(yaml.SafeLoader):
    """Reads tags such as !vault as their text."""


_Tolerant.add_multi_constructor("", lambda loader, _tag, node: str(node.value))


def _keys(value):
    if isinstance(value, dict):
        for key, entry in value.items():
            yield str(entry if key == "register" else key)
            yield from _keys(entry)
    elif isinstance(value, list):
        for entry in value:
            yield from _keys(entry)


def test_a_wrong_value_is_one_sentence():
    assert mentions(
        say_wrong("kobuki", "routes_on_conflict", "ignore", OPTIONS["routes_on_conflict"]),
        "kobuki",
        "routes_on_conflict",
        "ignore",
    )
