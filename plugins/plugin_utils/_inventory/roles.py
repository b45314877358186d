# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The options of the collection's roles, as their argument specifications have them, and the values of an inventory for them.

Ansible itself checks them at the beginning of each role, when other roles have changed the computers already.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

ROLES = Path(__file__).parents[3] / "roles"
#: The share of equal letters from which a name is taken for a misspelt option: one letter too few in `routes_on_conflict` is 0.97.
CLOSE = 0.9

Specification = Mapping[str, Any]


def read_options(roles: Path = ROLES) -> dict[str, Specification]:
    """Return the options of all roles: name to its specification, such as {"type": "str", "choices": ["fail", "replace"]}."""
    options: dict[str, Specification] = {}
    for path in sorted(roles.glob("*/meta/argument_specs.yml")):
        document = yaml.load(path.read_text(encoding="utf-8"), getattr(yaml, "CSafeLoader", yaml.SafeLoader))
        for entry in document["argument_specs"].values():
            options = {**entry.get("options", {}), **options}
    return options


def find_misspelt(names: Iterable[str], options: Mapping[str, Specification]) -> dict[str, str]:
    """Return the variables that are nearly options of a role: name to the option that is probably meant.

    Names of other people's roles stay unmentioned: `services_enabled` is no option, and is like no option.
    """
    prefixes = {option.partition("_")[0] for option in options}
    strange = (name for name in names if name not in options and name.partition("_")[0] in prefixes)
    near = {name: difflib.get_close_matches(name, options, 1, CLOSE) for name in strange}
    return {name: matches[0] for name, matches in near.items() if matches}


def say_misspelt(host: str, name: str, option: str) -> str:
    """Return the sentence for a variable that is nearly an option."""
    return f"{host}: {name} is no option of a role; expected {option}: correct the name in the inventory."


def say_wrong(host: str, name: str, value: object, specification: Specification) -> str:
    """Return the sentence for a value that the specification of its option does not allow."""
    choices = specification.get("choices")
    kind = f"one of {', '.join(map(str, choices))}" if choices else f"a value of the type {specification['type']}"
    return f"{host}: {name} is {value!r}; expected {kind}: correct it in the inventory."
