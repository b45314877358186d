# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A finding, and the diagnosis that has it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field

from ..._base.sentences import shorten_list
from ..._faults.fault import CONTROLLER, INVENTORY, Advice, Advices
from ..checks.engine import FAILED, UNKNOWN_INVENTORY, InventorySource, Row
from ..components.component import Component
from ..trace.findings import SeenEnd
from .evidence import INFERRED, LOCATED, SEEN, Because

VARIABLE = re.compile(r"\bmultimaster_\w+")
NAMED = 4  # names, networks and the like that a finding names


@dataclass
class Finding:
    """A finding: a component that is broken, the observations that show it, and those that follow from it."""

    component: Component
    verdict: str = FAILED
    rivals: tuple[Component, ...] = ()  # that explain the same: it is one of these
    proof: list[Row] = field(default_factory=list)  # rows with a value that shows it
    rows: list[Row] = field(default_factory=list)  # rows that it explains
    also: tuple[Component, ...] = ()  # the same at the same place: other names, other networks

    passed: tuple[str, ...] = ()  # the checks that succeed in the same pairs, once for each
    followed: tuple[SeenEnd, ...] = ()  # the places where packets ended
    rule: str = ""  # the id of the row of rules.py that has made it
    because: Because | None = None
    since: str = ""  # empty if it is not known
    commands: Advices = ()  # against it, if values that were read give some
    #: values for the words of its advice, and of those of its rivals
    known: Mapping[Component, Mapping[str, str]] = field(default_factory=dict, compare=False)
    inventory: InventorySource = field(default=UNKNOWN_INVENTORY, compare=False)

    @property
    def sure(self) -> str:
        """The certainty of the finding: a value showed it, packets were seen to end there, or it explains most."""
        return SEEN if self.proof else LOCATED if self.followed else INFERRED

    @property
    def candidates(self) -> tuple[Component, ...]:
        """It is one of these."""
        return (self.component, *self.rivals)

    @property
    def subjects(self) -> str:
        """Name the details of the component: the first names or networks, and how many more. Of packets that end, the first."""
        if self.component.kind == "way":
            return self.component.what  # the report has all of `followed`
        return shorten_list(
            dict.fromkeys(component.what for component in (self.component, *self.also) if component.what), NAMED
        )

    def sentence(self) -> str:
        """Return the sentence of the fault."""
        return self.component._replace(what=self.subjects).sentence()

    @property
    def do(self) -> Advices:
        """Return the remedy: values that were read give the commands, and the row gives those that last. Nothing if it is only inferred."""
        if self.sure == INFERRED:
            return ()
        known = self.known.get(self.component, {})
        own = tuple(map(self._add_line, self.component.do(self.inventory.path, known)))
        if not self.commands:
            return own
        if (
            self.component.kind == "node"
        ):  # they name the starter of the node, of which the row can only name candidates
            return self.commands
        return (*self.commands, *(one for one in own if one.where in (CONTROLLER, INVENTORY)))

    def _add_line(self, one: Advice) -> Advice:
        """Add the places at which its variables are set now to a change of the inventory."""
        names = VARIABLE.findall(one.text) if one.where == INVENTORY else ()
        found = ((name, self.inventory.find_line(place, name)) for name in names for place in self.component.places)
        lines = dict.fromkeys(f"{name} is in {line}" for name, line in found if line)
        return one._replace(effect="; ".join(filter(None, (one.effect, *lines))))

    @property
    def look(self) -> Advices:
        """Return the commands to look with if that does not help, or to distinguish the candidates."""
        ways = (one for end in self.followed[:1] for one in end.look) if self.component.kind == "way" else ()
        return tuple(
            dict.fromkeys(
                (
                    *ways,
                    *(
                        one
                        for component in self.candidates
                        for one in component.look(self.inventory.path, self.known.get(component, {}))
                    ),
                )
            )
        )


@dataclass(frozen=True)
class Diagnosis:
    """The findings, the most important first, and the rows that no finding explains."""

    findings: tuple[Finding, ...] = ()
    unexplained: tuple[Row, ...] = ()
    looked_at: int = 0  # rows of them that were explained or tried
    total: int = 0  # all rows that are not ok
