# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The parts of a router dialect, and the list of the dialects.

A dialect is a file in `dialects/` with the constant DIALECT. The file has the name of the dialect. Examples of its output
are in tests/unit/golden/router_config.
"""

from __future__ import annotations

import importlib
import pathlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

# Kinds of devices.
ROUTER, GATEWAY = "router", "gateway"
# A block may be repeated for each of these.
ROUTES, PEERS = "routes", "peers"

# RouterOS finds our entries by this text.
MARK = "rosfleet.multimaster"

# Values of Dialect.again.
REPLACES = "Using it again replaces what it put there."
ADDS = "Do so before a robot goes or gets another address."


class Block(NamedTuple):
    """A piece of a dialect: a template, and the kinds of device that need it."""

    text: str
    each: str = ""  # ROUTES, PEERS, or empty for once
    kinds: tuple[str, ...] = (ROUTER, GATEWAY)


@dataclass(frozen=True)
class Dialect:
    """The language of one make of device. Templates are those of str.format."""

    position: int  # in lists of all dialects; give the next number to a new one
    title: str
    suffix: str  # of the file
    comment: str  # the begin of a line of comment
    use: str  # the sentence with the use of a file
    again: str  # the sentence for a second use, after a change of the fleet
    interfaces: Mapping[str, str]  # kind -> the maker's name of the interface on the common network
    add: tuple[Block, ...]
    remove: tuple[Block, ...]
    first_line: str = ""
    notes: Mapping[str, str] = field(default_factory=dict)


def load_dialects() -> dict[str, Dialect]:
    """Return every dialect by its name. Files of helpers have names that begin with `_`."""
    package = f"{__package__}.dialects"
    names = [path.stem for path in pathlib.Path(__file__).with_name("dialects").glob("[!_]*.py")]
    dialects: dict[str, Dialect] = {name: importlib.import_module(f"{package}.{name}").DIALECT for name in names}
    return dict(sorted(dialects.items(), key=lambda item: (item[1].position, item[0])))
