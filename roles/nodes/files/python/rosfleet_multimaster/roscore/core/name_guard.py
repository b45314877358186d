# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The decision between two nodes that want one name.

rosmaster gives it to the newer node and shuts the older one down, on any robot. Here an import, a node of another robot that
master_sync registered, never takes the name of an own node, and is never shut down. A replaced node does not come back under
its old URI while it ends: roscpp registers once more then, and would end its successor.
"""

from typing import Dict, Iterable, NamedTuple, Set, Tuple

from ...protocol.plain_text import quote

REPLACED = 30.0  # seconds that a replaced node is refused; it is asked to end at once
MOST = 1000  # replaced nodes that are remembered


class Verdict(NamedTuple):
    """The decision about a registration."""

    refusal: str = ""  # why it is not made
    spared: bool = False  # the node that loses its name is not shut down
    import_lost: bool = False  # it is one of another robot, and its successor is not


class NameGuard:
    """Decides about registrations, one after the other."""

    def __init__(self) -> None:
        self._imports: Set[Tuple[str, str]] = set()
        # name -> URI of an import that is registered, also when the record is without it
        self._foreign: Dict[str, str] = {}
        self._replaced: Dict[Tuple[str, str], float] = {}  # name and URI -> until when it is refused

    def set_imports(self, nodes: Iterable[Tuple[str, str]]) -> None:
        """Take the record of imports: name and URI of each node that master_sync registers."""
        self._imports = set(nodes)

    def is_import(self, name: str, uri: str) -> bool:
        """True if this is a node of another robot."""
        return (name, uri) in self._imports or self._foreign.get(name) == uri

    def judge(self, name: str, holder: str, uri: str, now: float) -> Verdict:
        """Decide about a registration by the node `name` at `uri`. `holder`: the URI that has the name now, or ""."""
        foreign, lost = self.is_import(name, uri), False
        if holder not in ("", uri):
            lost = self.is_import(name, holder)
            if foreign and not lost:
                return Verdict(f"an own node at {quote(holder)} has the name {quote(name)}")
            if self._replaced.get((name, uri), now) > now:
                return Verdict(f"a newer node at {quote(holder)} has the name {quote(name)}")
            self._replace(name, holder, now)
        if foreign:
            self._foreign[name] = uri
        else:
            self._foreign.pop(name, None)
        return Verdict(spared=lost, import_lost=lost and not foreign)

    def forget(self, name: str) -> None:
        """Note that no node has this name any more."""
        self._foreign.pop(name, None)

    def _replace(self, name: str, uri: str, now: float) -> None:
        if len(self._replaced) >= MOST:
            self._replaced = {key: until for key, until in self._replaced.items() if until > now}
        if len(self._replaced) < MOST:
            self._replaced[name, uri] = now + REPLACED
