# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The reader of `systemctl show`: properties of systemd's units, and of systemd itself."""

import time
import typing

from .._base import commands

_LIMIT = 60.0  # seconds; it answers in hundredths, and with a hundred busy processes within half a minute

Properties = typing.Dict[str, str]


class UnitProperties(typing.NamedTuple):
    """The properties of each unit in the order of the question, and the error or ""."""

    units: typing.List[Properties]
    error: str = ""


def show(units: typing.Sequence[str], properties: typing.Sequence[str], limit: float = _LIMIT) -> UnitProperties:
    """Ask systemd for properties of units in one call of at most `limit` seconds; without units of systemd itself.

    The names of properties are those of org.freedesktop.systemd1(5). A missing unit has the LoadState "not-found", without
    an error.
    """
    answer = commands.run(["systemctl", "show", "--property=" + ",".join(properties), "--"] + list(units), limit=limit)
    error = "" if answer.status == 0 else answer.error or str(answer.status)
    return UnitProperties(parse(answer.text), error)


def states(units: typing.Sequence[str], properties: typing.Sequence[str]) -> typing.List[Properties]:
    """Ask systemd for properties of units; empty ones if it does not answer."""
    found = show(units, properties).units if units else []
    return found if len(found) == len(units) else [{} for unit in units]


def parse(output: str) -> typing.List[Properties]:
    """Split the output of `systemctl show`: one block of NAME=VALUE for each unit, and an empty line between blocks."""
    blocks = [block for block in output.strip("\n").split("\n\n") if block]
    return [dict(line.partition("=")[::2] for line in block.splitlines() if "=" in line) for block in blocks]


def find_change(unit: Properties) -> float:
    """Return the time (s since 1970) of a unit's last change of state, by its StateChangeTimestampMonotonic."""
    age = time.monotonic() - int(unit.get("StateChangeTimestampMonotonic") or 0) / 1e6
    return time.time() - age
