# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The form of a row in the table of faults, and what an optional feature adds to that table."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

READ, ALWAYS = "where it was looked at", "always"


class Fault(NamedTuple):
    """How a part of a kind may be broken: in a sentence, what to do, and the command that shows it.

    Texts have {place} and {what}. A deed that can be pasted is `run site.yml` or `on {place}: <command>`. A command behind
    `see` only shows the fault. So does `decide`, with which alone an inferred fault is told. A deed that ends with `see` goes on
    with it. A command made from an observation stands before the remedy (commands.py).
    `cost` says how rare it is: of two parts that explain the same, the cheaper one is named.
    A `hard` fault lets nothing pass, so a success that needs the part clears it. Of other faults a success says little.
    A fault that is `read` is not concluded, since a value on the machine shows it: READ is for places with an observation.
    """

    sentence: str
    deed: str
    decide: str = ""  # empty: the deed shows it, too
    cost: float = 3.0
    hard: bool = True
    read: str = ""
    what: str = ""  # stands for a part's `what` where it has none

    @property
    def remedy(self) -> str:
        """The remedy, with the command that shows the fault."""
        return f"{self.deed} {self.decide}" if self.deed.endswith(" see") else self.deed

    @property
    def example(self) -> str:
        """The placeholder for `what` in a command."""
        return f"<{self.what}>" if " " in self.what else self.what


SITE = "run site.yml"
ROUTES = "on {place}: ip rule; ip route"


@dataclass(frozen=True)
class ComponentHooks:
    """The rows of a feature: (kind, mode) -> its fault, and other faults that it may be the cause of, at the same place."""

    faults: Mapping[tuple[str, str], Fault]
    #: fault, also one of the core -> faults of the feature that it may follow from
    causes: Mapping[tuple[str, str], tuple[tuple[str, str], ...]] = field(default_factory=dict)
