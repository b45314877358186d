# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The kinds of computers in a lab, containers and virtual machines: a table of the commands for each kind."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from machines import containers, virtual
from machines.layout import Host


@dataclass(frozen=True)
class Kind:
    """A kind of computers. A command without a host is for all computers of the lab."""

    bring_up: Callable[[str, Sequence[Host]], None]
    write_inventory: Callable[[str, Sequence[Host]], Path]
    restart: Callable[[str, str | None], None]
    cut_power: Callable[[str, str | None], None]  # for a moment, and wait for the boot
    shell: Callable[[str, str], None]
    take_down: Callable[[str | None], None]  # one lab, or all of this checkout


KINDS: Mapping[str, Kind] = {
    "container": Kind(
        containers.bring_up,
        containers.write_inventory,
        containers.restart,
        containers.cut_power,
        containers.shell,
        containers.take_down,
    ),
    "machine": Kind(
        virtual.bring_up,
        virtual.write_inventory,
        virtual.restart,
        virtual.cut_and_give_power,
        virtual.shell,
        virtual.take_down_all,
    ),
}


def kind_of(lab: str) -> Kind:
    """The kind of the computers of a lab; containers where there is no such lab."""
    return KINDS["machine" if lab in virtual.list_labs() else "container"]


def bring_up(kind: str, lab: str, hosts: Sequence[Host]) -> None:
    """Make a lab of computers of this kind; one of the other kind that has its name goes before."""
    for name, other in KINDS.items():
        if name != kind:
            other.take_down(lab)
    KINDS[kind].bring_up(lab, hosts)
