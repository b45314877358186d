# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The catalogue: a file for each fault, data alone. What it means is done by run.py.

    title: a packet filter on one computer drops ICMP
    inject:                      # steps in this order: a computer and a command for its root, or `lab` and a word of words.py
      - tibi-arm: nft ...
    settled:                     # steps whose commands succeed as soon as the fault has its effect
      - kobuki-pc: "! ping -c1 -W1 <tibi-arm>"
    hands:                       # steps of a person who does what the finding tells in words, for --remedy
      - tibi-arm: nft ...
    undo:
      - tibi-arm: nft ...
    parts: [filter icmp in, filter icmp]     # kind and mode of plugin_utils/_verify/components/component.py; each of them is right
    at: [tibi-arm]               # the places, of which one is named
    quick: true                  # it is part of `make test-long`, beside drawn ones: kinds that are not drawn

In a command `<tibi-arm>` is the address of a computer, `<tibi-gate.common>` that in the common network, `<group>` and `<port>`
are those of discovery.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import yaml

FOLDER = Path(__file__).with_name("catalogue")
LAB = "lab"
KEYS = {"title", "inject", "settled", "hands", "undo", "parts", "at", "quick"}
NEEDED = KEYS - {"settled", "hands", "quick"}
PLACEHOLDER = re.compile(r"<([a-z][a-z-]*(?:\.common)?)>")


class CatalogueError(Exception):
    """A file of the catalogue is wrong; the text is for the person who wrote it."""


@dataclass(frozen=True)
class Step:
    """A command for root of a computer, or a word for the lab."""

    where: str
    what: str


@dataclass(frozen=True)
class Fault:
    """One fault: what makes it, what shows that it is there, what takes it back, and the part that is to be named first."""

    name: str
    title: str
    inject: tuple[Step, ...]
    settled: tuple[Step, ...]
    undo: tuple[Step, ...]
    parts: tuple[tuple[str, str], ...]  # (kind, mode)
    at: tuple[str, ...]
    quick: bool
    hands: tuple[Step, ...] = ()  # what is told in words, as commands


def load(facts: Mapping[str, str], folder: Path = FOLDER) -> list[Fault]:
    """All faults, in the order of their names. `facts`: what the placeholders mean."""
    return [read(path, facts) for path in sorted(folder.glob("*.yml"))]


def read(path: Path, facts: Mapping[str, str]) -> Fault:
    """One file."""
    row = yaml.safe_load(path.read_text(encoding="utf-8"))
    keys = set(row)
    if keys - KEYS or NEEDED - keys:
        wrong = [f"{key} is not known" for key in sorted(keys - KEYS)] + [f"{key} is missing" for key in NEEDED - keys]
        raise CatalogueError(f"{path.name}: {', '.join(wrong)}; expected {', '.join(sorted(KEYS))}.")

    def steps(key: str) -> tuple[Step, ...]:
        pairs = [pair for step in row.get(key, ()) for pair in step.items()]
        return tuple(Step(where, filled(command, facts, path.name)) for where, command in pairs)

    return Fault(
        path.stem,
        row["title"],
        steps("inject"),
        steps("settled"),
        steps("undo"),
        tuple(tuple(part.split(" ", 1)) for part in row["parts"]),
        tuple(row["at"]),
        row.get("quick", False),
        steps("hands"),
    )


def filled(command: str, facts: Mapping[str, str], name: str) -> str:
    """The command with addresses instead of placeholders."""

    def fact(found: re.Match[str]) -> str:
        if found[1] not in facts:
            raise CatalogueError(f"{name}: <{found[1]}> is not known; expected one of {', '.join(sorted(facts))}.")
        return facts[found[1]]

    return PLACEHOLDER.sub(fact, command)


def facts_of(listing: Mapping[str, object], extras: Mapping[str, str]) -> dict[str, str]:
    """The values of the placeholders, by the inventory as ansible-inventory lists it."""
    variables = listing["_meta"]["hostvars"]
    found = {"group": "226.0.0.0", "port": "11511", **extras}
    for name, own in variables.items():
        found[name] = own["multimaster_address"]
        gateway = own.get("multimaster_gateway") == name
        found[f"{name}.common"] = own["multimaster_common_address"] if gateway else own["multimaster_address"]
    return found
