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

from ..._base.difference import difference_of_lines
from ..._base.plain_text import quote
from ..._base.problem import Problem
from ..transaction import files, writable
from ..transaction.deadman import UndoStep
from ..transaction.module import Concern, Fields, ModuleRun
from ..transaction.network import state as network_state
from ..transaction.record import RECORDS
from ..transaction.transaction import Data, Step, carry_out, do_nothing, intent, outcome
from . import access
from .backends.contract import BackEnd
from .backends.table import AUTO, BACKENDS, CHOICES, GUARDING
from .packet_filter import Guard, PacketFilter, read_options

GUARD: typing.Dict[str, typing.Any] = {
    "networks": {"type": "list", "elements": "str", "required": True},
    "interface": {"type": "str", "required": True},
}
OPTIONS: typing.Dict[str, typing.Any] = {
    "members": {"type": "list", "elements": "str", "required": True},
    "also": {"type": "list", "elements": "str", "default": []},
    "networks": {"type": "list", "elements": "str", "default": []},
    "guards": {"type": "list", "elements": "dict", "default": [], "options": GUARD},
    "open_ports": {"type": "list", "elements": "str", "default": []},
    "ssh_ports": {"type": "list", "elements": "int", "default": []},
    "backend": {"type": "str", "default": "auto", "choices": CHOICES},
    "records": {"type": "path", "default": RECORDS},
}

_WORDS = re.compile(r'[\s,{}"]+')


def has_systemd() -> bool:
    """True if systemd runs on this computer."""
    return os.path.isdir("/run/systemd/system")


class FirewallRun(ModuleRun):
    """One run of the module: reads the machine and plans, then applies the plan or reports the obstacle."""

    def __init__(self, options: typing.Mapping[str, typing.Any]) -> None:
        """Read and plan; changes nothing. Raises OSError, and Problem for unusable options, rules or files."""
        self.access = access.read_access()
        self.packet_filter = read_options(options, self.access.ssh)
        chosen = self._choose_back_end(options["backend"])
        self.back_ends = [kind(has_systemd(), self._share(kind, chosen)) for kind in BACKENDS.values()]
        self.back_end = next((one for one in self.back_ends if chosen and isinstance(one, chosen)), None)
        # Those with rules come first, and of them the one with the guards.
        self.in_turn = sorted(
            self.back_ends, key=lambda back_end: (back_end.packet_filter is None, back_end.name != GUARDING)
        )
        own_files = [file for one in self.in_turn if one.packet_filter for file in one.plan_files(one.packet_filter)]
        self.files = files.FileBundle("files", "firewall", options["records"], own_files).make_plan()
        self.record_after = self._plan_record()
        self.removed = [one.name for one in self.back_ends if one.before and one.packet_filter is None]
        self.runtime_changes = any(back_end.changes for back_end in self.back_ends)
        self.watch = network_state.StateWatch(filtered=True)
        self.changed = bool(
            self.runtime_changes
            or self.files.changed
            or not self._is_ready_for_boot()
            or self.record_after != self.files.remembered
        )

    def _is_ready_for_boot(self) -> bool:
        """Return True if each back end has its rules again after a boot."""
        return all(one.is_ready_for_boot() for one in self.back_ends)

    def _choose_back_end(self, name: str) -> typing.Optional[typing.Type[BackEnd]]:
        """The back end for the rules, None if no packet filter is wanted. Raises Problem."""
        if self.packet_filter is None:
            return None
        if name == AUTO:
            return next(kind for kind in BACKENDS.values() if kind.is_active())
        if not BACKENDS[name].is_active():
            raise Problem(
                f"backend is {name}, which is not active here, expected it to filter packets: turn it on, or set backend to auto."
            )
        return BACKENDS[name]

    def _share(
        self, kind: typing.Type[BackEnd], chosen: typing.Optional[typing.Type[BackEnd]]
    ) -> typing.Optional[PacketFilter]:
        """The part of the filter that a back end has: all of it, only the guards with another one, or nothing."""
        if self.packet_filter is None or kind is chosen:
            return self.packet_filter
        guards = self.packet_filter.guards if kind.name == GUARDING else ()
        return PacketFilter((), (), (), guards=guards) if guards else None

    def _plan_record(self) -> Data:
        """The record after the run, empty if nothing of ours is left."""
        names = [back_end.name for back_end in self.back_ends if back_end.packet_filter]
        record = dict(self.files.after, back_ends=names)
        return record if any(record.values()) else {}

    # For the shell of the modules

    @property
    def refusals(self) -> typing.List[str]:
        """The sentences that prevent the plan: access that would be lost, foreign changes, and files that cannot be written."""
        sentences = [self.access.refusal(self.packet_filter)] if self.packet_filter else []
        sentences += [back_end.refusal() for back_end in self.back_ends if back_end.changes]
        sentences += writable.obstacles([*self.files.places, self.files.record.path]) if self.changed else []
        return [sentence for sentence in sentences if sentence]

    @property
    def difference(self) -> typing.List[typing.Dict[str, str]]:
        """The rules at run time and the files that change, for `diff`."""
        differences = []
        for back_end in self.back_ends:
            header = f"{back_end.name} (our rules at run time)"
            differences += difference_of_lines(header, back_end.before, back_end.after)
        return differences + self.files.differences()

    def result(self) -> Fields:
        """The return values of the module."""
        wanted = self.packet_filter or PacketFilter((), (), ())
        return {
            "backend": self.back_end.name if self.back_end else None,
            "members": [self._describe_address(member) for member in wanted.members],
            "networks": [self._describe_address(network) for network in wanted.networks],
            "guards": [self._describe_guard(guard) for guard in wanted.guards],
            "open_ports": [f"{port}/{name}" for name in ("tcp", "udp") for port in wanted.list_open_ports(name)],
            "removed": self.removed,
            "notes": self._notes(),
        }

    def _describe_address(self, address: str) -> Fields:
        """The result for an address. It is "ok" if our rules had the address before."""
        lines = self.back_end.before if self.back_end else []
        before = {word for line in lines for word in _WORDS.split(line)}
        return {"address": address, "changed": address not in before, "state": "ok" if address in before else "changed"}

    def _describe_guard(self, guard: Guard) -> Fields:
        """The result for a guard. It is "ok" if our rules do not change."""
        changed = next(back_end.changes for back_end in self.back_ends if back_end.name == GUARDING)
        fields = {"networks": list(guard.networks), "interface": guard.interface}
        return {**fields, "changed": changed, "state": "changed" if changed else "ok"}

    def _notes(self) -> typing.List[str]:
        had = self.files.remembered.get("back_ends", [])
        gone = [of.name for of in self.back_ends if of.packet_filter and not of.before and of.name in had]
        return [*(f"Our rules in {name} had been removed by hand since." for name in gone), *self.files.notes]

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

    # For the dead-man's switch. The confirming run needs no memory, since our rules carry their mark.

    def undo_steps(self) -> typing.List[UndoStep]:
        """The steps that restore the rules as this run found them."""
        return [step for back_end in self.in_turn if back_end.changes for step in back_end.undo_steps()]

    def apply_runtime(self) -> None:
        """Change only the rules at run time. Raises Problem, which lists rules that are not as they were before."""
        steps = [_make_step(back_end, back_end.try_out) for back_end in self.in_turn if back_end.changes]
        carry_out([*self.watch_steps(), *steps])

    # The change

    def apply(self) -> None:
        """Make everything as planned. Raises Problem, which lists rules that are not as they were before."""
        record, remembered = self.files.record, self.files.remembered
        if not self.changed:
            if not remembered:
                record.tidy()
            return
        names = {*remembered.get("back_ends", []), *self.record_after.get("back_ends", [])}
        touched = [
            back_end
            for back_end in self.in_turn
            if back_end.packet_filter or back_end.changes or back_end.name in remembered.get("back_ends", [])
        ]
        steps = [*self.watch_steps(), intent(record, dict(self.files.intent, back_ends=sorted(names)), remembered)]
        # These steps do nothing. They are undone last, when the files are as before.
        steps += [_make_step(back_end, do_nothing) for back_end in touched]
        steps += [Step(back_end.name, back_end.prepare) for back_end in touched]
        steps += self.files.steps()
        steps += [Step(back_end.name, functools.partial(_load_and_check, back_end)) for back_end in touched]
        carry_out([*steps, outcome(record, self.record_after)])


def _make_step(back_end: BackEnd, do: typing.Callable[[], None]) -> Step:
    return Step(f"the rules of {back_end.name}", do, back_end.restore)


def _load_and_check(back_end: BackEnd) -> None:
    """Load the rules, and check that the back end has them. Raises Problem."""
    back_end.load()
    now = back_end.read_rules()
    if now != back_end.after:
        differing = sorted(set(now) ^ set(back_end.after))[:3]
        raise Problem(
            f"{back_end.name} has other rules than were loaded ({'; '.join(map(quote, differing))}), expected the same: find "
            "out which program changes them."
        )


CONCERN = Concern("firewall", OPTIONS, lambda module, memory: FirewallRun(module.params), "packet filter rules")
