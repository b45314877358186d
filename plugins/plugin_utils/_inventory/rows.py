# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The form of a variable of the fleet: a field of a dataclass, with the function that reads it and its default."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeVar

from .._base.features import FeaturePart
from . import kinds

T = TypeVar("T")

PREFIX = "multimaster_"


@dataclass(frozen=True)
class Variable:
    """One variable of the fleet."""

    name: str
    read: Callable[[Any], Any]
    default: Any  # None: computed, required or not set
    example: str  # of a variable that is required, for the sentence that asks for it


_FIELD = partial(field)  # pylint takes a plain call next to a dataclass for a mistake


def row(read: Callable[[Any], Any], default: Any = None, example: str = "") -> Any:
    """Return the field of a variable. `default` is a value as an inventory would have it. With an example it is required."""
    return _FIELD(metadata={"row": (read, default, example)})


def word(*choices: str) -> Any:
    """Return the field of a variable that is one of some words. The first is the default."""
    return row(kinds.choice(*choices), choices[0])


def list_rows(kind: type) -> tuple[Variable, ...]:
    """Return the variables of a class whose fields are made by `row` and `word`."""
    own = (entry for entry in dataclasses.fields(kind) if "row" in entry.metadata)
    return tuple(Variable(PREFIX + entry.name, *entry.metadata["row"]) for entry in own)


def make_rows(kind: type[T], values: Mapping[str, Any], **others: Any) -> T:
    """Make such a class of values by the names of their variables. One without a value is None."""
    own = (entry for entry in dataclasses.fields(kind) if "row" in entry.metadata)  # type: ignore[arg-type]  # a dataclass
    return kind(**{entry.name: values.get(PREFIX + entry.name) for entry in own}, **others)


@dataclass(frozen=True)
class VariableHooks:
    """The variables of a feature, as classes of such fields: those of the fleet, and those of each computer."""

    of_fleet: type[FeaturePart] | None = None
    of_computer: type[FeaturePart] | None = None
