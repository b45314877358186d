# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The parts of a router dialect, and the list of the dialects.

A dialect is a file in `dialects/` with the constant DIALECT. The name of the file is the name of the dialect. Its files are
shown in tests/unit/golden/router_config.
"""

from __future__ import annotations

import importlib
import pathlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

# Kinds of devices.
ROUTER, GATEWAY = "router", "gateway"
# Things that a block is repeated for.
ROUTES, PEERS = "routes", "peers"

# RouterOS finds by this text what is ours.
MARK = "rosfleet.multimaster"

# Values of Dialect.again.
REPLACES = "Using it again replaces what it put there."
ADDS = "Do so before a robot goes or gets another address."


class Block(NamedTuple):
    """A piece of a dialect: a template, what it is repeated for, and the kinds of device that need it."""

    text: str
    each: str = ""  # ROUTES, PEERS, or once
    kinds: tuple[str, ...] = (ROUTER, GATEWAY)


@dataclass(frozen=True)
class Dialect:
    """The language of one make of device. Templates are those of str.format."""

    position: int  # in lists of all dialects; a new one comes last
    title: str
    suffix: str  # of the file
    comment: str  # how a line of comment begins
    use: str  # tells a person what to do with a file
    again: str  # tells what happens when the file of a changed fleet is used
    interfaces: Mapping[str, str]  # kind -> the interface of the common network, as the maker names it
    add: tuple[Block, ...]
    remove: tuple[Block, ...]
    first_line: str = ""
    notes: Mapping[str, str] = field(default_factory=dict)


def load_dialects() -> dict[str, Dialect]:
    """Return every dialect by its name. A file whose name begins with `_` is none."""
    package = f"{__package__}.dialects"
    names = [path.stem for path in pathlib.Path(__file__).with_name("dialects").glob("[!_]*.py")]
    dialects: dict[str, Dialect] = {name: importlib.import_module(f"{package}.{name}").DIALECT for name in names}
    return dict(sorted(dialects.items(), key=lambda item: (item[1].position, item[0])))
