# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The setter of each parameter: the other robots, each of which has a share of the memory for parameters.

It is a second tree with that of the parameters, with only the names at which another owner begins. So it is never larger than that
one, and empty if all is of this robot.
"""

from dataclasses import dataclass
from typing import Any, Dict, Iterator, Mapping, Optional, Sequence, Tuple, Union

Owner = Optional[str]  # another robot, None for this one
Node = Union[
    Owner, Dict[str, Any]
]  # the owner of all that is below, or a mapping: _OWNER, and the names that have others
_OWNER = ""  # no part of a name is empty


@dataclass
class Owners:
    """The owners of all parameters."""

    root: Node = None

    def set(self, parts: Sequence[str], owner: Owner) -> None:
        """All that is at a place has one owner from now on. `parts`: as of `find_place`."""
        self.root = _set(self.root, parts, owner)

    def delete(self, parts: Sequence[str]) -> None:
        """A parameter is deleted."""
        self.set(parts, owner_of(self.find(parts[:-1])))

    def find(self, parts: Sequence[str]) -> Node:
        """Return the owner, or owners, of the values at a name."""
        node = self.root
        for part in parts:
            node = inner(node, part)
        return node


def inner(node: Node, part: str) -> Node:
    """Return the owners of a member of a mapping that has these owners."""
    return node.get(part, node[_OWNER]) if isinstance(node, dict) else node


def owner_of(node: Node) -> Owner:
    """Return the owner of the value at a name, without the values below it that have another one."""
    found = node[_OWNER] if isinstance(node, dict) else node
    return None if found is None else str(found)


def list_owners(value: Any, node: Node) -> Iterator[Tuple[Owner, str, Any]]:
    """List the owner, the name and the value of each member, and of all that is in it if that has one owner.

    The value is {} for the mapping of a member with several owners: its members follow. The first name is "".
    """
    waiting = [("", value, node, owner_of(node))]
    while waiting:
        name, value, node, owner = waiting.pop()
        mixed = isinstance(node, dict) and isinstance(value, dict)
        yield owner, name, {} if mixed else value
        if mixed:
            for part, below in value.items():
                owners = inner(node, part) if part else owner_of(node)
                waiting.append((part, below, owners, owner_of(owners)))


def _set(node: Node, parts: Sequence[str], owner: Owner) -> Node:
    """Return the node with another owner at a name."""
    if not parts:
        return owner
    above = owner_of(node)
    child = _set(inner(node, parts[0]), parts[1:], owner)
    names: Dict[str, Any] = node if isinstance(node, dict) else {_OWNER: above}
    if not isinstance(child, dict) and child == above:
        names.pop(parts[0], None)
    else:
        names[parts[0]] = child
    return names if len(names) > 1 else above


def find_place(tree: Mapping[str, Any], parts: Sequence[str]) -> Sequence[str]:
    """Return the place in a tree that changes when a parameter is set: mappings above it may have to be made."""
    return parts[: descend(tree, parts)[1] + 1]


def descend(tree: Mapping[str, Any], parts: Sequence[str]) -> Tuple[Any, int]:
    """The innermost mapping on the way to a parameter, and the place of the part that is looked up in it."""
    for at, part in enumerate(parts[:-1]):
        below = tree.get(part)
        if not isinstance(below, dict):
            return tree, at
        tree = below
    return tree, len(parts) - 1
