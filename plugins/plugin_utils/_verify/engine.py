# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The engine of the verification: it applies a table of checks to the observations of a fleet.

Pure: the plan and the observations in, one row for each result out. Every observation is looked at once, so the cost grows
with the number of observations. The engine knows no check; the package `checks` has the table.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import FleetPlan, Master
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.case import (
    Case,
    Everything,
    Participant,
    usual_mtus,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.exchange import Exchanges
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.needs import NONE, Parts
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observations import Observation
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.pairs import ALL, number, tried
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.ways import Ways

OK, WARNING, FAILED, UNKNOWN = "ok", "warning", "failed", "unknown"
VERDICTS = (OK, WARNING, FAILED, UNKNOWN)

# The scope of a check: the targets that each observer looks at.
COMPUTER = "computer"  # the observer itself
ITSELF_TOO = "itself too"  # every member, and the observer
MEMBER = "member"  # every other member
MASTER = "master"  # every other master
MASTER_TOO = "master too"  # every master, also the observer's own


class Row(NamedTuple):  # there are millions in a large fleet, and a frozen dataclass is five times slower to make
    """The result of one check between an observer and a target; a check of one computer has it as both."""

    check: str
    observer: str
    target: str
    verdict: str
    expected: str
    found: str


class Judgement(NamedTuple):
    """Verdict, expected and found of one check."""

    verdict: str
    expected: str = ""
    found: str = ""


class Documented(NamedTuple):
    """A row of the table in docs/verification.md: the targets, what is expected, and where the report has it."""

    scope: str
    expected: str
    report: str = ""


def _nothing(_case: Case) -> Parts:
    return NONE


@dataclass(frozen=True)
class Check:
    """A check: its targets, its judge, and what its results say about the parts of the fleet.

    The judge returns None where there is nothing to judge, because another check says so already. A success needs the parts
    of `needs`, so it clears them. A failure has its reason among `suspects`, or where there is no such function among the
    same parts. `evidence` are parts that a value shows to be broken; then nobody is suspected.
    """

    id: str
    title: str
    scope: str
    judge: Callable[[Case], Judgement | None]
    documented: Documented
    needs: Callable[[Case], Parts] = _nothing
    suspects: Callable[[Case], Parts] | None = None
    evidence: Callable[[Case], Parts] = _nothing


class Verification:
    """The checks, applied to the observations of a fleet; `observations` has an entry for each computer of the run.

    `pairs` says who was to look at whom: `all`, or `auto`; see `pairs.tried`. `least` are the Mbit/s that are expected.
    """

    def __init__(
        self,
        checks: Sequence[Check],
        fleet: FleetPlan,
        observations: Mapping[str, Observation],
        pairs: str = ALL,
        least: float = 0.0,
    ) -> None:
        self.checks = checks
        self.fleet = fleet
        self.ways = ways = Ways(fleet)
        self.run = {
            name: Participant.of(name, plan, observations[name])
            for name, plan in fleet.computers.items()
            if name in observations
        }
        self.tried = tried({member.name: str(member.network) for member in fleet.members}, fleet.computers, pairs)
        exchanges = Exchanges(
            fleet,
            {
                computer.plan.robot: computer.seen.probe.exchange
                for computer in self.run.values()
                if computer.plan.is_master and computer.seen.probe and not computer.seen.probe.exchange.error
            },
        )
        self.everything = Everything(fleet, ways, self.run, exchanges, usual_mtus(self.run.values(), ways), least)

    def rows(self, passed: Counter[str] | None = None) -> Iterator[Row]:
        """Apply every check to every computer of the run, and to every pair that was to be tried by one of them.

        With `passed`, what is ok is only counted there, by check: nobody reads a million good rows.
        """
        alone, itself, others = self._of(COMPUTER), self._of(ITSELF_TOO), self._of(ITSELF_TOO, MEMBER)
        own_master, masters = self._of(MASTER_TOO), self._of(MASTER, MASTER_TOO)
        addresses = [(master, master.computer, str(master.address)) for master in self.fleet.masters]
        for observer in self.run.values():
            name, targets = observer.name, self.tried[observer.name]
            yield from _judged(alone, self._case(observer, name, str(observer.plan.address)), passed)
            for target, address in self.ways.addresses.items():
                if target in targets or target == name:
                    checks = itself if target == name else others
                    yield from _judged(checks, self._case(observer, target, address), passed)
            for master, target, address in addresses:
                checks = own_master if target == name else masters
                yield from _judged(checks, self._case(observer, target, address, master), passed)

    @property
    def pairs(self) -> tuple[int, int]:
        """The number of pairs that the computers of the run were to try, and of all that there are."""
        chosen = {name: self.tried[name] for name in self.run}
        return number(chosen), sum(len(self.ways.members.keys() - {name}) for name in self.run)

    def case(self, check: Check, observer: str, target: str) -> Case | None:
        """Make the case of one pair; None where the check has none."""
        if observer not in self.run or (observer != target) < (check.scope in (MEMBER, MASTER)):
            return None
        computer = self.run[observer]
        if check.scope in (MASTER, MASTER_TOO):
            master = self.ways.master_at.get(target)
            return self._case(computer, target, str(master.address), master) if master else None
        if check.scope == COMPUTER:
            return self._case(computer, target, str(computer.plan.address)) if observer == target else None
        address = self.ways.addresses.get(target)
        return self._case(computer, target, address) if address else None

    def _case(self, observer: Participant, target: str, address: str, master: Master | None = None) -> Case:
        return Case(self.everything, observer, target, address, master)

    def _of(self, *scopes: str) -> list[Check]:
        return [check for check in self.checks if check.scope in scopes]


def _judged(checks: Iterable[Check], case: Case, passed: Counter[str] | None) -> Iterable[Row]:
    rows = []
    for check in checks:
        judgement = check.judge(case)
        if judgement is None:
            continue
        if passed is not None and judgement[0] == OK:
            passed[check.id] += 1
        else:
            rows.append(Row(check.id, case.observer.name, case.target, *judgement))
    return rows


def evaluate(checks: Sequence[Check], fleet: FleetPlan, observations: Mapping[str, Observation]) -> Iterator[Row]:
    """Judge everything, row by row."""
    return Verification(checks, fleet, observations).rows()
