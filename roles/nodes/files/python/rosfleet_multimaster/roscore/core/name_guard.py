# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Who gets the name of a node that two want.

rosmaster gives it to the newer one and shuts the older one down, on whichever robot that is. Here a node of another robot
(an import: master_sync registered it) never takes the name of an own one, and is never shut down. And who was replaced
does not come back under the old URI while it ends: roscpp registers once more then, and would end its successor.
"""

from typing import Dict, Iterable, NamedTuple, Set, Tuple

from ...protocol.plain_text import quote

REPLACED = 30.0  # seconds that a replaced node is refused; it is told to end at once
MOST = 1000  # replaced nodes that are remembered


class Verdict(NamedTuple):
    """The decision about a registration."""

    refused: str = ""  # why it is not made
    takes_over: bool = False  # it takes the name of another one,
    spared: bool = False  # which is not shut down
    import_lost: bool = False  # and was the node of another robot


GRANTED = Verdict()


class NameGuard:
    """Decides about registrations, one after the other."""

    def __init__(self) -> None:
        self._imports: Set[Tuple[str, str]] = set()
        self._foreign: Dict[
            str, str
        ] = {}  # name -> URI of an import that is registered, also when the record is without it
        self._replaced: Dict[Tuple[str, str], float] = {}  # name and URI -> until when it is refused

    def imports(self, nodes: Iterable[Tuple[str, str]]) -> None:
        """The record of imports: name and URI of each node that master_sync registers."""
        self._imports = set(nodes)

    def is_import(self, name: str, uri: str) -> bool:
        """True where this is a node of another robot."""
        return (name, uri) in self._imports or self._foreign.get(name) == uri

    def judge(self, name: str, held: str, uri: str, now: float) -> Verdict:
        """Decide about a registration by the node `name` at `uri`. `held`: the URI that has the name now, or ""."""
        foreign, other = self.is_import(name, uri), held not in ("", uri)
        if other:
            if foreign and not self.is_import(name, held):
                return Verdict(f"an own node at {quote(held)} has the name {quote(name)}")
            if self._replaced.get((name, uri), now) > now:
                return Verdict(f"a newer node at {quote(held)} has the name {quote(name)}")
        lost = other and self.is_import(name, held)
        if other:
            self._replace(name, held, now)
        if foreign:
            self._foreign[name] = uri
        else:
            self._foreign.pop(name, None)
        return Verdict(takes_over=True, spared=lost, import_lost=lost and not foreign) if other else GRANTED

    def gone(self, name: str) -> None:
        """Nobody has this name any more."""
        self._foreign.pop(name, None)

    def _replace(self, name: str, uri: str, now: float) -> None:
        if len(self._replaced) >= MOST:
            self._replaced = {key: until for key, until in self._replaced.items() if until > now}
        if len(self._replaced) < MOST:
            self._replaced[name, uri] = now + REPLACED
