# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The classes of the contract as dataclasses, which all records of the controller are: they are compared, replaced and read alike."""

from __future__ import annotations

from dataclasses import dataclass, is_dataclass

from ....module_utils._contract.fields import Struct, find_struct


def make_dataclasses(*structs: type[Struct]) -> None:
    """Make these classes and those of their fields dataclasses, in place. A value that no check reads is no field of theirs."""
    for struct in structs:
        _make_dataclass(struct)


def _make_dataclass(struct: type[Struct]) -> None:
    if is_dataclass(struct):
        return
    for name, entry in struct.FIELDS.items():
        component = find_struct(entry.kind)
        if component is not None:
            _make_dataclass(component)
        if not entry.kept:
            del struct.__annotations__[name]
    dataclass(frozen=True, init=False)(struct)
