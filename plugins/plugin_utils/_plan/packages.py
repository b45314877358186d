# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The Debian packages of multimaster_fkie on a machine: which to install, to remove and to record.

Pure: names in, names out. The record on the machine tells the packages of the collection from those of the owner.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.units import CONFIGURATION

RECORD = f"{CONFIGURATION}/packages"


@dataclass(frozen=True)
class Changes:
    """The names of packages, and the text of the record."""

    new: tuple[str, ...]  # wanted and not installed
    leftover: tuple[str, ...]  # installed by the collection, and wanted no more
    record: str  # the text of the file RECORD; empty where the collection has no package there


def changes(wanted: Sequence[str], installed: Collection[str], ours: Sequence[str]) -> Changes:
    """Compare the wanted packages with the installed ones, and with those that the collection has installed (`ours`).

    The record holds what the collection has installed and what it is about to install. It is written before the
    installation, so an interrupted run is taken back too.
    """
    new = tuple(name for name in wanted if name not in installed)
    recorded = sorted({*ours, *new} & {*wanted})
    lines = ["# The Debian packages that the collection rosfleet.multimaster installed.", *recorded]
    return Changes(
        new=new,
        leftover=tuple(name for name in ours if name not in wanted),
        record="".join(f"{line}\n" for line in lines) if recorded else "",
    )
