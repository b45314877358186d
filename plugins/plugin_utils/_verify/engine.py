# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The engine of the verification: it applies a table of checks to the observations of a fleet.

Pure: the plan and the observations in, findings out. Every observation is looked at once, so the cost grows with the
number of observations. The engine knows no check; the package `checks` has the table.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from ipaddress import IPv4Address
from typing import NamedTuple

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import FleetPlan, Master
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.case import Case, Participant
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.exchange import Exchanges
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observations import Observation
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.ways import Ways

OK, WARNING, FAILED, UNKNOWN = "ok", "warning", "failed", "unknown"
VERDICTS = (OK, WARNING, FAILED, UNKNOWN)

# The scope of a check: the targets that each observer looks at.
COMPUTER = "computer"  # the observer itself
ITSELF_TOO = "itself too"  # every member, and the observer
MEMBER = "member"  # every other member
MASTER = "master"  # every other master
MASTER_TOO = "master too"  # every master, also the observer's own


class Finding(NamedTuple):  # there are millions in a large fleet, and a frozen dataclass is five times slower to make
    """The result of one check between an observer and a target; a check of one computer has it as both.

    `because` is the check whose failure explains this one, or empty.
    """

    check: str
    observer: str
    target: str
    verdict: str
    expected: str
    found: str
    cause: str = ""
    remedy: str = ""
    because: str = ""


class Judgement(NamedTuple):
    """Verdict, expected and found of one check."""

    verdict: str
    expected: str = ""
    found: str = ""


@dataclass(frozen=True)
class Cause:
    """A cause of a failed check, what to do, and the predicate that recognises it; None is the default.

    Texts may have {observer}, {target}, {address}, {port} and {group}, {gateway} and {its_gateway} for the gateways of the
    observer's and the target's network, {master} and {its_master} for the computers with the two roscores.
    """

    cause: str
    remedy: str
    when: Callable[[Case], bool] | None = None

    def applies(self, case: Case) -> bool:
        """Say if this is the cause in a case."""
        return self.when is None or self.when(case)


class Documented(NamedTuple):
    """A row of the table in docs/verification.md: the targets, what is expected, and where the report has it."""

    scope: str
    expected: str
    report: str = ""


@dataclass(frozen=True)
class Check:
    """A check: its targets, its judge, the checks whose failure explains a failure of this one, its causes in order.

    The judge returns None where there is nothing to judge, because another check says so already. `explained_by` names
    checks of the same pair, or of another one: a side of `case.SIDES` and a colon stand before those ("target:services").
    """

    id: str
    title: str
    scope: str
    judge: Callable[[Case], Judgement | None]
    documented: Documented
    explained_by: Sequence[str] = ()
    causes: Sequence[Cause] = ()


def evaluate(checks: Sequence[Check], fleet: FleetPlan, observations: Mapping[str, Observation]) -> Iterator[Finding]:
    """Apply every check to every computer of the run, and to every pair whose observer is in the run, check by check.

    `observations` has an entry for each computer of the run.
    """
    run = {
        name: Participant.of(name, plan, observations[name])
        for name, plan in fleet.computers.items()
        if name in observations
    }
    ways = Ways(fleet)
    exchanges = Exchanges(
        fleet,
        {
            computer.plan.robot: computer.seen.probe.exchange
            for computer in run.values()
            if computer.plan.is_master and computer.seen.probe and not computer.seen.probe.exchange.error
        },
    )
    # Gateways first, since what happens there explains what happens behind them.
    computers = sorted(run.values(), key=lambda computer: not computer.plan.is_gateway)
    failed: set[tuple[str, str, str]] = set()  # (check, observer, target)
    for check in checks:
        for computer in computers:
            for target, address, master in _targets(check, computer, ways, fleet.masters):
                if target == computer.name and check.scope in (MEMBER, MASTER):
                    continue
                finding = _finding(check, Case(fleet, ways, computer, target, address, master, run, exchanges), failed)
                if finding is not None:
                    if finding.verdict == FAILED:
                        failed.add((check.id, finding.observer, finding.target))
                    yield finding


def _targets(
    check: Check, computer: Participant, ways: Ways, masters: Sequence[Master]
) -> Iterable[tuple[str, IPv4Address, Master | None]]:
    """List the targets of a computer in a check: (name, address, master or None)."""
    if check.scope == COMPUTER:
        return [(computer.name, computer.plan.address, None)]
    if check.scope in (MASTER, MASTER_TOO):
        return ((master.computer, master.address, master) for master in masters)
    return ((name, ways.members[name].address, None) for name in ways.order(computer.plan.robot))


def _finding(check: Check, case: Case, failed: set[tuple[str, str, str]]) -> Finding | None:
    judgement = check.judge(case)
    if judgement is None:
        return None
    verdict, expected, found = judgement
    observer, target = case.observer.name, case.target
    if verdict == OK:
        return Finding(check.id, observer, target, OK, expected, found)
    sides = case.sides()
    because = next((other for other in check.explained_by if _reference(other, sides) in failed), "")
    # A failure that another one explains has that one's cause.
    cause = None if because else next((cause for cause in check.causes if cause.applies(case)), None)
    words = _words(case)
    return Finding(
        check=check.id,
        observer=observer,
        target=target,
        verdict=verdict,
        expected=expected,
        found=found,
        cause=cause.cause.format(**words) if cause else "",
        remedy=cause.remedy.format(**words) if cause else "",
        because=because.rpartition(":")[2],
    )


def _words(case: Case) -> dict[str, object]:
    """Fill in what the texts of a cause may have in braces."""
    own_gateway, its_gateway = (gateway.title if gateway else "the gateway" for gateway in case.gateways)
    return {
        "observer": case.observer.name,
        "target": case.target,
        "address": case.address,
        "port": case.target_master.rpc_port if case.target_master else case.fleet.multicast_port,
        "group": case.fleet.multicast_group,
        "gateway": own_gateway,
        "its_gateway": its_gateway,
        "master": case.masters[0],
        "its_master": case.masters[1],
    }


def _reference(text: str, sides: Mapping[str, tuple[str, str]]) -> tuple[str, str, str]:
    """Resolve an entry of `explained_by`, such as "target:services", to (check, observer, target)."""
    side, _separator, check = text.rpartition(":")
    return (check, *sides[side])
