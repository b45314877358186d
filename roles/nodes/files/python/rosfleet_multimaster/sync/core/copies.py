# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Parameters that cross: the offers of other robots and the state of the own roscore in, the difference to carry out.

The roscore has no owner of a parameter, so there is a record with them: the names that we set, and the digests of the values. A
value is ours as long as it has such a digest. A value that another program has set since, or had set before, is never changed.

The record is a parameter, too. So it lives exactly as long as the others, and outlives a killed master_sync. The managed roscore
lets only master_sync set it. Below another roscore any program may set it. That gains nothing: such a program can set each
parameter, and a forged entry is of no use without the digest of the value that is there.
"""

import json
from typing import AbstractSet, Any, Dict, List, Mapping, NamedTuple, Optional, Set, Tuple

from ...protocol import json_text
from ...protocol.parameters import problem_of_parameter
from .sync import RegistrationConflict

RECORD = "/rosfleet_multimaster/parameters"
MOST = 2000  # entries of a record
_SET = "here it has a value of its own, at {}; remove that one, or take the name out of multimaster_exports there"


class Copy(NamedTuple):
    """A parameter that we set: the name of its master, and the digests of the values that it may have."""

    master: str
    digests: Tuple[str, ...]


Record = Dict[str, Copy]  # by the names of the parameters


class OfferedParameter(NamedTuple):
    """A parameter of another robot that is to be here."""

    master: str
    value: Any
    digest: str


class Contents(NamedTuple):
    """The state of the own roscore: the names of all parameters that are no namespace, and the digests of some values."""

    leaves: AbstractSet[str]
    digests: Mapping[str, str]


class Todo(NamedTuple):
    """The difference to carry out in this order: the deletions, the record, and the new values."""

    delete: List[str]
    record: Record
    set: Dict[str, Any]
    refused: List[RegistrationConflict]


def plan_copies(offers: Mapping[str, OfferedParameter], keep: AbstractSet[str], record: Record, own: Contents) -> Todo:
    """Plan a pass. `keep`: names that stay as they are until their robot gives its values.

    A name is refused if a foreign value is there: a value at this name, below it, or in place of the
    namespace that it is in.
    """
    ours = {name: there for name, mine in record.items() if (there := _find_ours(name, mine, own))}
    delete = sorted(name for name in ours if name not in offers and name not in keep)
    foreign = _list_foreign(own.leaves, ours)
    after = {name: mine for name, mine in ours.items() if name not in delete}
    values: Dict[str, Any] = {}
    refused: List[RegistrationConflict] = []
    for name, offer in sorted(offers.items()):
        holder = "" if name in ours else _find_holder(name, foreign)
        if holder:
            refused.append(RegistrationConflict("parameter", name, offer.master, "", _SET.format(holder)))
            continue
        before = ours[name].digests if name in ours else ()
        after[name] = Copy(offer.master, tuple(dict.fromkeys((*before, offer.digest))))
        if before != (offer.digest,):
            values[name] = offer.value
    return Todo(delete, after, values, refused)


def _find_ours(name: str, mine: Copy, own: Contents) -> Optional[Copy]:
    """The entry of a parameter that has a value of ours, with the digest of that one; None if it has another value."""
    there = own.digests.get(name, "")
    return Copy(mine.master, (there,)) if there and there in mine.digests else None


def _list_foreign(leaves: AbstractSet[str], ours: Mapping[str, Copy]) -> Set[str]:
    """The parameters that are neither ours nor below one of ours."""
    return {leaf for leaf in leaves if not any(name in ours for name in (leaf, *_list_parents(leaf)))}


def _list_parents(name: str) -> List[str]:
    """The namespaces that a parameter is in, without the root."""
    parts = name.split("/")[1:]
    return ["/" + "/".join(parts[:count]) for count in range(1, len(parts))]


def _find_holder(name: str, foreign: AbstractSet[str]) -> str:
    """The foreign parameter that keeps a name from being set, "" if it is free."""
    above = next((place for place in (name, *_list_parents(name)) if place in foreign), "")
    return above or min((leaf for leaf in foreign if leaf.startswith(name + "/")), default="")


def settle(todo: Todo, failed: AbstractSet[str]) -> Record:
    """The record after a pass. A value that was set has one digest, the new one; `failed` could not be set, so it may have any."""
    return {
        name: Copy(mine.master, mine.digests[-1:]) if name in todo.set and name not in failed else mine
        for name, mine in todo.record.items()
    }


# The record as a text


def write(record: Record) -> str:
    """The text of a record."""
    return json.dumps({name: [mine.master, *mine.digests] for name, mine in sorted(record.items())})


def read(text: Any) -> Record:
    """The record in a value of the parameter server; an empty one if it is damaged. It has no name that never crosses."""
    try:
        found = json_text.from_json(text) if isinstance(text, str) else {}
        rows = list(found.items())[:MOST]
    except (AttributeError, ValueError):
        return {}
    return {
        name: Copy(row[0], tuple(row[1:]))
        for name, row in rows
        if not problem_of_parameter(name)
        and isinstance(row, list)
        and row
        and all(isinstance(part, str) for part in row)
    }
