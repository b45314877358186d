# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""One run of the module firewall, over the rules of every back end, its files at boot and the record.

The record names the files and the back ends before the first change. Our rules carry a mark of their own in each back end.
After a killed run, the next run finds them by this mark.
"""

import functools
import os
import re
import typing

from .._changes import files
from .._changes.deadman import UndoStep
from .._changes.module import Fields, ModuleRun
from .._changes.record import RECORDS
from .._changes.transaction import Data, Step, carry_out, intent, outcome
from .._module.difference import difference_of_lines
from .._module.plain_text import quote
from .._module.problem import Problem, unreadable
from . import access
from .backends.contract import BackEnd, Rules
from .backends.table import AUTO, BACKENDS, CHOICES
from .packet_filter import PacketFilter, read_options

OPTIONS: typing.Dict[str, typing.Any] = {
    "members": {"type": "list", "elements": "str", "required": True},
    "also": {"type": "list", "elements": "str", "default": []},
    "networks": {"type": "list", "elements": "str", "default": []},
    "open_ports": {"type": "list", "elements": "str", "default": []},
    "ssh_ports": {"type": "list", "elements": "int", "default": []},
    "backend": {"type": "str", "default": "auto", "choices": CHOICES},
    "records": {"type": "path", "default": RECORDS},
}

_WORDS = re.compile(r'[\s,{}"]+')


class Ruleset(typing.NamedTuple):
    """Our rules in one back end, before and after the run."""

    back_end: BackEnd
    before: Rules
    after: Rules
    packet_filter: typing.Optional[PacketFilter]  # None where the back end shall have no rule of ours

    @property
    def changes(self) -> bool:
        """True where the rules change at run time."""
        return self.before != self.after


def has_systemd() -> bool:
    """True where systemd runs on this computer."""
    return os.path.isdir("/run/systemd/system")


class Run(ModuleRun):
    """One run of the module: reads the machine and plans, then applies the plan or says what prevents it."""

    def __init__(self, options: typing.Mapping[str, typing.Any], memory: typing.Optional[Data] = None) -> None:
        """Read and plan; changes nothing. Raises Problem for options, rules or files that cannot be used."""
        self.access = access.read_access()
        self.packet_filter = read_options(options, self.access.ssh)
        back_ends = [kind(has_systemd()) for kind in BACKENDS.values()]
        self.back_end = self._choose_back_end(options["backend"], back_ends)
        try:
            self.rulesets = [self._plan_ruleset(back_end) for back_end in back_ends]
            own_files = self.back_end.plan_files(self.packet_filter) if self.back_end and self.packet_filter else []
            self.files = files.FileBundle("firewall", options["records"], own_files)
        except OSError as problem:
            raise Problem(f"{unreadable(problem)} Nothing was changed.") from problem
        self.record_after = self._plan_record()
        self.removed = [
            ruleset.back_end.name for ruleset in self.rulesets if ruleset.before and ruleset.packet_filter is None
        ]
        ready_for_boot = all(ruleset.back_end.is_ready_for_boot(ruleset.packet_filter) for ruleset in self.rulesets)
        self.changed = bool(
            self.runtime_changes
            or self.files.changed
            or not ready_for_boot
            or self.record_after != self.files.remembered
        )

    def _choose_back_end(self, name: str, back_ends: typing.Iterable[BackEnd]) -> typing.Optional[BackEnd]:
        """The back end for the rules, None where no packet filter is wanted. Raises Problem."""
        if self.packet_filter is None:
            return None
        if name == AUTO:
            return next(back_end for back_end in back_ends if back_end.is_active())
        back_end = next(back_end for back_end in back_ends if back_end.name == name)
        if not back_end.is_active():
            raise Problem(
                f"backend is {name}, which is not active here, expected it to filter packets: turn it on, or set backend to auto."
            )
        return back_end

    def _plan_ruleset(self, back_end: BackEnd) -> Ruleset:
        packet_filter = self.packet_filter if back_end is self.back_end else None
        after = back_end.plan_rules(packet_filter) if packet_filter else []
        return Ruleset(back_end, back_end.read_rules(), after, packet_filter)

    def _plan_record(self) -> Data:
        """The record after the run, empty where nothing of ours is left."""
        record = dict(self.files.plan.after, back_ends=[self.back_end.name] if self.back_end else [])
        return record if any(record.values()) else {}

    # For the shell of the modules

    @property
    def refusals(self) -> typing.List[str]:
        """The sentences that prevent the plan."""
        sentences = [self.access.refusal(self.packet_filter)] if self.packet_filter else []
        sentences += [ruleset.back_end.refusal() for ruleset in self.rulesets if ruleset.changes]
        return [sentence for sentence in sentences if sentence]

    @property
    def difference(self) -> typing.List[typing.Dict[str, str]]:
        """The rules at run time and the files that change, for `diff`."""
        differences = []
        for ruleset in self.rulesets:
            header = f"{ruleset.back_end.name} (our rules at run time)"
            differences += difference_of_lines(header, ruleset.before, ruleset.after)
        return differences + self.files.differences()

    def result(self) -> Fields:
        """The return values of the module."""
        members = self.packet_filter.members if self.packet_filter else ()
        networks = self.packet_filter.networks if self.packet_filter else ()
        return {
            "backend": self.back_end.name if self.back_end else None,
            "members": [self._describe_address(member) for member in members],
            "networks": [self._describe_address(network) for network in networks],
            "open_ports": [
                f"{port}/{name}" for name in ("tcp", "udp") for port in self.packet_filter.list_open_ports(name)
            ]
            if self.packet_filter
            else [],
            "removed": self.removed,
            "notes": self._notes(),
        }

    def _describe_address(self, address: str) -> Fields:
        """The result for an address. It is "ok" where our rules had the address before."""
        before = {
            word
            for ruleset in self.rulesets
            if ruleset.packet_filter
            for line in ruleset.before
            for word in _WORDS.split(line)
        }
        return {"address": address, "changed": address not in before, "state": "ok" if address in before else "changed"}

    def _notes(self) -> typing.List[str]:
        names = self.files.remembered.get("back_ends", [])
        lost = [
            ruleset.back_end.name
            for ruleset in self.rulesets
            if ruleset.packet_filter and not ruleset.before and ruleset.back_end.name in names
        ]
        return [f"Our rules in {name} had been removed by hand since." for name in lost] + self.files.plan.notes

    def summary(self, check_mode: bool) -> str:
        """The sentences of `msg`."""
        be = "would be" if check_mode else "were"
        sentences = [f"Our rules in {name} {be} removed." for name in self.removed]
        if self.back_end and self.packet_filter:
            state = f"{be} changed" if self.changed else "were right"
            sentences.append(
                f"The rules of {self.back_end.name} {state}: {len(self.packet_filter.members)} addresses are let in, "
                f"{len(self.packet_filter.networks)} networks behind this computer are protected."
            )
        return " ".join((sentences or ["No packet filter is ours."]) + self._notes())

    # For the dead-man's switch

    @property
    def runtime_changes(self) -> bool:
        """True where rules change at run time."""
        return any(ruleset.changes for ruleset in self.rulesets)

    @property
    def memory(self) -> Data:
        """The memory for the confirming run: it is empty, since our rules carry their mark."""
        return {}

    @property
    def _rulesets_to_change(self) -> typing.List[Ruleset]:
        """The rulesets that change, that of the chosen back end first."""
        return sorted(
            (ruleset for ruleset in self.rulesets if ruleset.changes), key=lambda ruleset: ruleset.packet_filter is None
        )

    def undo_steps(self) -> typing.List[UndoStep]:
        """The steps that restore the rules as this run found them."""
        return [step for ruleset in self._rulesets_to_change for step in ruleset.back_end.undo_steps(ruleset.before)]

    def apply_runtime(self) -> None:
        """Change the rules at run time alone. Raises Problem, with everything as it was before."""
        carry_out([self._rules_step(ruleset, ruleset.back_end.try_out) for ruleset in self._rulesets_to_change])

    # The change

    def apply(self) -> None:
        """Make everything as planned. Raises Problem, with everything as it was before."""
        record, remembered = self.files.record, self.files.remembered
        if not self.changed:
            if not remembered:
                record.tidy()
            return
        names = {*remembered.get("back_ends", []), *self.record_after.get("back_ends", [])}
        touched = [
            ruleset
            for ruleset in sorted(self.rulesets, key=lambda ruleset: ruleset.packet_filter is None)
            if ruleset.packet_filter or ruleset.changes or ruleset.back_end.name in remembered.get("back_ends", [])
        ]
        steps = [intent(record, dict(self.files.plan.intent, back_ends=sorted(names)), remembered)]
        # These steps do nothing. They are undone last, when the files are as before.
        steps += [self._rules_step(ruleset, lambda _filter: None) for ruleset in touched]
        for back_end, _before, _after, packet_filter in touched:
            steps.append(Step(back_end.name, functools.partial(back_end.prepare, packet_filter)))
        steps += files.steps(self.files.plan, self.files.machine)
        for ruleset in touched:
            steps.append(
                Step(f"the rules of {ruleset.back_end.name}", functools.partial(self._load_and_check, ruleset))
            )
        carry_out([*steps, outcome(record, self.record_after)])

    def _rules_step(self, ruleset: Ruleset, do: typing.Callable[[typing.Optional[PacketFilter]], None]) -> Step:
        name = f"the rules of {ruleset.back_end.name}"
        return Step(name, lambda: do(ruleset.packet_filter), lambda: ruleset.back_end.restore(ruleset.before))

    def _load_and_check(self, ruleset: Ruleset) -> None:
        """Load the rules, and check that the back end has them. Raises Problem."""
        ruleset.back_end.load(ruleset.packet_filter)
        now = ruleset.back_end.read_rules()
        if now != ruleset.after:
            differing = sorted(set(now) ^ set(ruleset.after))[:3]
            raise Problem(
                f"{ruleset.back_end.name} has other rules than were loaded ({'; '.join(map(quote, differing))}), expected the same: find "
                "out which program changes them."
            )
