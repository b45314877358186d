# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The engine of the verification: it applies a table of checks to the observations of a fleet.

Pure: the plan and the observations in, one row for each result out. The cost grows with the number of observations. The
engine knows no check; table.py has them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

from ..._plan.model import FleetPlan
from ..context.check_context import CheckContext, FleetState
from ..context.needs import Components, make_components
from ..context.pairs import ALL, choose_pairs, number
from ..observe.observations import Observation
from ..observe.outcomes import Outcome

OK, WARNING, FAILED, UNKNOWN = "ok", "warning", "failed", "unknown"
VERDICTS = (OK, WARNING, FAILED, UNKNOWN)

# The scope of a check: the targets that each observer looks at, in the words of docs/operate/checks.md.
COMPUTER = "computer"  # the observer itself
ITSELF_TOO = "pair, itself too"  # every member, and the observer
MEMBER = "pair"  # every other member
MASTER = "to masters"  # every other master
MASTER_TOO = "to masters, its own too"  # every master, also the observer's own
ROSCORES = "pair of roscores"  # every other master, compared with the observer's own
MASTERS = (MASTER, MASTER_TOO, ROSCORES)


class Row(NamedTuple):  # there are millions in a large fleet, and a frozen dataclass is five times slower to make
    """The result of one check between an observer and a target; a check of one computer has it as both."""

    check: str
    observer: str
    target: str
    verdict: str
    expected: str
    found: str


class Judgement(NamedTuple):
    """Verdict, expected and found of one check, and the components of the fleet that it shows, if it is not ok.

    `broken` are components that a value shows to be broken; then no other component is suspected. `outcome` is that of the packets that the check has
    sent itself: an error leaves few components (errors.py).
    """

    verdict: str
    expected: str = ""
    found: str = ""
    broken: Components = frozenset()
    outcome: Outcome = Outcome.NOT_TRIED


def _find_nowhere(_place: str, _variable: str) -> str:
    return ""


class InventorySource(NamedTuple):
    """The inventory of a run: as a command has it, and the file and line of a variable of a computer or robot."""

    path: str = ""  # empty if it is not known
    find_line: Callable[[str, str], str] = _find_nowhere  # place, variable -> "file, line 3"; empty if it is not set


UNKNOWN_INVENTORY = InventorySource()


def judge_fault(verdict: str, expected: str, found: str, fine: str, broken: Components = frozenset()) -> Judgement:
    """Judge the found value: an empty text is no fault, and `fine` says so."""
    return Judgement(verdict, expected, found, broken) if found else Judgement(OK, expected, fine)


# robot of the observer, robot of the target, and the checks that passed -> number of pairs
Passed = Counter[tuple[str, str, tuple[str, ...]]]


Judge = Callable[[CheckContext], Judgement | None]


@dataclass(frozen=True)
class Check:
    """A check: its targets, its judge, and the meaning of its results for the components of the fleet. It decorates its judge.

    docs/operate/checks.md has the expected value of each check, and the place in the report.

    The judge is asked if `when` is true. It returns None if it finds nothing to judge, for example since a different check
    says it already. A check of values that site.yml sets (`of_site`) is unknown on a computer that a person set up by hand. A success
    needs the components of `needs`, so it clears them. A failure has its reason among `suspects`; without such a function it is
    among `needs`. If the judge names the components that are broken, no other is suspected.
    """

    title: str
    scope: str = COMPUTER
    when: Callable[[CheckContext], bool] | None = None
    of_site: bool = False
    needs: Callable[[CheckContext], Components] = lambda context: frozenset()
    suspects: Callable[[CheckContext], Components] | None = None
    carries: str = ""  # its packets, a word of packet_filters.TRAFFIC: a rule that drops them is evidence, too
    shown: bool = False  # good results have rows, too
    id: str = ""  # the name of the judge without `_judge_`
    judge: Judge = lambda context: None

    def look(self, context: CheckContext) -> Judgement | None:
        """Judge a computer or pair by its context; None if there is nothing to judge."""
        if self.when and not self.when(context):
            return None
        if self.of_site and context.is_set_up_by_hand:
            by_hand = make_components("set_up", context.observer.name, "by_hand")
            return Judgement(
                UNKNOWN, "the values that site.yml sets", "the collection has not set this computer up", by_hand
            )
        return self.judge(context)

    def __call__(self, judge: Judge) -> Check:
        """Return the check with its judge."""
        return replace(self, id=judge.__name__.removeprefix("_judge_"), judge=judge)


class Verification:
    """The checks, applied to the observations of a fleet; `observations` has an entry for each computer of the run.

    `pairs` chooses the pairs: `all`, or `auto`; see `pairs.choose_pairs`. `least` and `since_last` are those of FleetState.
    `inventory` is for the advice to people.
    """

    def __init__(
        self,
        checks: Sequence[Check],
        fleet: FleetPlan,
        observations: Mapping[str, Observation],
        pairs: str = ALL,
        least: float = 0.0,
        since_last: float = 0.0,
        inventory: InventorySource = UNKNOWN_INVENTORY,
    ) -> None:
        self.inventory = inventory
        self.checks = {check.id: check for check in checks}
        self.fleet = fleet
        self.state = FleetState(fleet, observations, least, since_last)
        self.ways, self.run = self.state.ways, self.state.run
        self.tried = choose_pairs(
            {member.name: str(member.network) for member in fleet.members},
            [name for name, plan in fleet.computers.items() if name in self.run and not plan.sealed],
            pairs,
        )

    def rows(self, passed: Passed | None = None) -> Iterator[Row]:
        """Apply every check to every computer of the run, and to every pair that one of them was to try.

        With `passed`, good results between two computers are only counted there: a million good rows help no reader.
        """
        for checks, context in self._contexts():
            counts, good = passed is not None and context.target != context.observer.name, []
            for check in checks:
                judgement = check.look(context)
                if judgement is None:
                    continue
                if counts and judgement.verdict == OK and not check.shown:
                    good.append(check.id)
                else:
                    texts = judgement.verdict, judgement.expected, judgement.found
                    yield Row(check.id, context.observer.name, context.target, *texts)
            if passed is not None and counts:
                own, its = context.robots
                passed[own or context.observer.name, its or context.target, tuple(good)] += 1

    def _contexts(self) -> Iterator[tuple[Sequence[Check], CheckContext]]:
        """Make each context, with the checks that look at it."""
        single, itself, others = self._select(COMPUTER), self._select(ITSELF_TOO), self._select(ITSELF_TOO, MEMBER)
        own_master, masters = self._select(MASTER_TOO), self._select(*MASTERS)
        for observer in self.run.values():
            name, targets = observer.name, self.tried[observer.name]
            yield single, CheckContext(self.state, observer, name)
            for target in self.ways.members:
                if target in targets or target == name:
                    yield itself if target == name else others, CheckContext(self.state, observer, target)
            for target, master in self.ways.master_at.items():
                yield own_master if target == name else masters, CheckContext(self.state, observer, target, master)

    def _select(self, *scopes: str) -> list[Check]:
        return [check for check in self.checks.values() if check.scope in scopes]

    @property
    def pairs(self) -> tuple[int, int]:
        """The number of pairs that the computers of the run were to try, and of all their pairs."""
        chosen = {name: self.tried[name] for name in self.run}
        return number(chosen), sum(len(self.ways.members.keys() - {name}) for name in self.run)

    def select_checks(self, observer: str, target: str) -> list[Check]:
        """Select the checks that look at one pair, if they have an observation of it."""
        if observer not in self.run:
            return []
        scopes = [COMPUTER] if observer == target else []
        if target in self.ways.members:
            scopes += [ITSELF_TOO] if observer == target else [ITSELF_TOO, MEMBER]
        if target in self.ways.master_at:
            scopes += [MASTER_TOO] if observer == target else MASTERS
        return self._select(*scopes)

    def make_context(self, check: Check, observer: str, target: str) -> CheckContext:
        """Make the context of one pair, as a check looks at it."""
        master = self.ways.master_at[target] if check.scope in MASTERS else None
        return CheckContext(self.state, self.run[observer], target, master)

    def list_suspects(self, row: Row) -> Components:
        """List the components that may be the reason of a row."""
        check = self.checks[row.check]
        return self.ways.seal((check.suspects or check.needs)(self.make_context(check, row.observer, row.target)))
