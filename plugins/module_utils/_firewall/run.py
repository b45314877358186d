# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""One run of the module firewall, over the rules of every back end, its files at boot and the record.

The record names the files and the back ends before the first change. Our rules carry a mark of their own in each back end,
so after a killed run the next one finds them by it.
"""

import os
import re
import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._changes import files
from ansible_collections.rosfleet.multimaster.plugins.module_utils._changes.module import Fields, ModuleRun
from ansible_collections.rosfleet.multimaster.plugins.module_utils._changes.record import RECORDS
from ansible_collections.rosfleet.multimaster.plugins.module_utils._changes.transaction import (
    Data,
    Step,
    carry_out,
    do_nothing,
    intent,
    outcome,
)
from ansible_collections.rosfleet.multimaster.plugins.module_utils._firewall import access, wanted
from ansible_collections.rosfleet.multimaster.plugins.module_utils._firewall.backends.contract import BackEnd, Rules
from ansible_collections.rosfleet.multimaster.plugins.module_utils._firewall.backends.table import (
    AUTO,
    BACKENDS,
    CHOICES,
)
from ansible_collections.rosfleet.multimaster.plugins.module_utils._module.difference import difference
from ansible_collections.rosfleet.multimaster.plugins.module_utils._module.plain_text import quote
from ansible_collections.rosfleet.multimaster.plugins.module_utils._module.problem import Problem, unreadable

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


class End(typing.NamedTuple):
    """A back end, with our rules in it before and after the run."""

    back_end: BackEnd
    before: Rules
    after: Rules
    wanted: typing.Optional[wanted.Wanted]  # None where nothing of ours is to be there

    @property
    def loads(self) -> bool:
        """True where the run time changes."""
        return self.before != self.after


def booted() -> bool:
    """True where systemd runs this computer."""
    return os.path.isdir("/run/systemd/system")


class Run(ModuleRun):
    """One run of the module: reads the machine and plans, then applies the plan or says what prevents it."""

    def __init__(self, options: typing.Mapping[str, typing.Any], memory: typing.Optional[Data] = None) -> None:
        """Read and plan; changes nothing. Raises Problem for options, rules or files that cannot be used."""
        self.access = access.look()
        self.wanted = wanted.read(options, self.access.ssh)
        back_ends = [kind(booted()) for kind in BACKENDS.values()]
        self.chosen = self._choose(options["backend"], back_ends)
        try:
            self.ends = [self._end(back_end) for back_end in back_ends]
            self.record = files.record_of("files", "firewall", options["records"])
            self.remembered = self.record.load()
            listed = self.chosen.files(self.wanted) if self.chosen and self.wanted else []
            self.listed = files.parse_files(listed)
            self.machine = files.read(self.listed, self.remembered, self.record)
            self.plan = files.plan_files(self.listed, self.remembered, self.machine)
        except OSError as problem:
            raise Problem(f"{unreadable(problem)} Nothing was changed.") from problem
        self.after = self._after()
        self.disordered = not all(end.back_end.in_order(end.wanted) for end in self.ends)
        self.changed = bool(
            self.runtime_changes or files.changes(self.plan) or self.disordered or self.after != self.remembered
        )

    def _choose(self, name: str, back_ends: typing.Iterable[BackEnd]) -> typing.Optional[BackEnd]:
        """The back end that has the rules, None where none are wanted. Raises Problem."""
        if self.wanted is None:
            return None
        if name == AUTO:
            return next(back_end for back_end in back_ends if back_end.active())
        chosen = next(back_end for back_end in back_ends if back_end.name == name)
        if not chosen.active():
            raise Problem(
                f"backend is {name}, which is not active here, expected it to filter packets: turn it on, or set backend to auto."
            )
        return chosen

    def _end(self, back_end: BackEnd) -> End:
        mine = self.wanted if back_end is self.chosen else None
        return End(back_end, back_end.read(), back_end.rules(mine) if mine else [], mine)

    def _after(self) -> Data:
        """The record after the run, empty where nothing is ours any more."""
        names = [self.chosen.name] if self.chosen else []
        after = dict(self.plan.after, back_ends=names)
        return after if any(after.values()) else {}

    # For the shell of the modules

    @property
    def refusals(self) -> typing.List[str]:
        """The sentences that prevent the plan."""
        found = [self.access.refusal(self.wanted)] if self.wanted else []
        found += [end.back_end.refusal() for end in self.ends if end.loads]
        return [sentence for sentence in found if sentence]

    @property
    def difference(self) -> typing.List[typing.Dict[str, str]]:
        """The rules at run time and the files that change, for `diff`."""
        found = []
        for end in self.ends:
            if end.loads:
                texts = [("".join(f"{line}\n" for line in lines)).encode("utf-8") for lines in (end.before, end.after)]
                found.append(difference(f"{end.back_end.name} (our rules at run time)", texts[0], texts[1]))
        return found + files.differences(self.plan, self.machine)

    def result(self) -> Fields:
        """The return values of the module."""
        members = self.wanted.members if self.wanted else ()
        networks = self.wanted.networks if self.wanted else ()
        return {
            "backend": self.chosen.name if self.chosen else None,
            "members": [self._item(member) for member in members],
            "networks": [self._item(network) for network in networks],
            "open_ports": [f"{port}/{name}" for name in ("tcp", "udp") for port in self.wanted.open(name)]
            if self.wanted
            else [],
            "removed": [end.back_end.name for end in self.ends if end.before and end.wanted is None],
            "notes": self._notes(),
        }

    def _item(self, address: str) -> Fields:
        """The result for an address: whether our rules had it before."""
        before = {word for end in self.ends if end.wanted for line in end.before for word in _WORDS.split(line)}
        return {"address": address, "changed": address not in before, "state": "ok" if address in before else "changed"}

    def _notes(self) -> typing.List[str]:
        names = self.remembered.get("back_ends", [])
        lost = [end.back_end.name for end in self.ends if end.wanted and not end.before and end.back_end.name in names]
        return [f"Our rules in {name} had been removed by hand since." for name in lost] + self.plan.notes

    def failure(self, problem: Problem) -> Fields:
        """The return values beside the sentence: those of a success."""
        return self.result()

    def summary(self, check_mode: bool) -> str:
        """The sentences of `msg`."""
        be = "would be" if check_mode else "were"
        sentences = [
            f"Our rules in {end.back_end.name} {be} removed." for end in self.ends if end.before and end.wanted is None
        ]
        if self.chosen and self.wanted:
            state = f"{be} changed" if self.changed else "were right"
            sentences.append(
                f"The rules of {self.chosen.name} {state}: {len(self.wanted.members)} addresses are let in, "
                f"{len(self.wanted.networks)} networks behind this computer are protected."
            )
        return " ".join((sentences or ["No packet filter is ours."]) + self._notes())

    # For the dead-man's switch

    @property
    def runtime_changes(self) -> bool:
        """True where rules change at run time."""
        return any(end.loads for end in self.ends)

    @property
    def memory(self) -> Data:
        """What the confirming run has to know: nothing, since our rules carry their mark."""
        return {}

    @property
    def _changing(self) -> typing.List[End]:
        """The back ends whose rules change, the one that gets them first."""
        return sorted((end for end in self.ends if end.loads), key=lambda end: end.wanted is None)

    def undo_commands(self) -> typing.List[typing.List[str]]:
        """The commands that restore the rules as this run found them."""
        return [command for end in self._changing for command in end.back_end.undo_commands(end.before)]

    def undo_files(self) -> typing.List[typing.Tuple[str, typing.Optional[bytes]]]:
        """The files to restore with them."""
        return [file for end in self._changing for file in end.back_end.undo_files()]

    def undo_last(self) -> typing.List[typing.List[str]]:
        """The commands after that."""
        return [command for end in self._changing for command in end.back_end.undo_last()]

    def apply_runtime(self) -> None:
        """Change the rules at run time alone. Raises Problem, with everything as it was before."""
        carry_out([self._step(end, end.back_end.try_out) for end in self._changing])

    # The change

    def apply(self) -> None:
        """Make everything as planned. Raises Problem, with everything as it was before."""
        if not self.changed:
            if not self.remembered:
                self.record.tidy()
            return
        names = {*self.remembered.get("back_ends", []), *self.after.get("back_ends", [])}
        steps = [intent(self.record, dict(self.plan.intent, back_ends=sorted(names)), self.remembered)]
        # Undone last, when the files are as before; done after them.
        steps += [self._step(end, lambda _wanted: None) for end in self._touched]
        steps += [self._prepare(end) for end in self._touched]
        steps += files.steps(self.plan, self.machine)
        steps += [self._load(end) for end in self._touched]
        carry_out([*steps, outcome(self.record, self.after)])

    @property
    def _touched(self) -> typing.List[End]:
        """The back ends with something to do: the one that has the rules first."""
        names = self.remembered.get("back_ends", [])
        found = [end for end in self.ends if end.wanted or end.loads or end.back_end.name in names]
        return sorted(found, key=lambda end: end.wanted is None)

    def _step(self, end: End, do: typing.Callable[[typing.Optional[wanted.Wanted]], None]) -> Step:
        what = f"the rules of {end.back_end.name}"
        return Step(what, lambda: do(end.wanted), lambda: end.back_end.restore(end.before))

    def _prepare(self, end: End) -> Step:
        return Step(end.back_end.name, lambda: end.back_end.prepare(end.wanted), do_nothing)

    def _load(self, end: End) -> Step:
        return Step(f"the rules of {end.back_end.name}", lambda: self._loaded(end), do_nothing)

    def _loaded(self, end: End) -> None:
        """Load the rules, and see that they are there. Raises Problem."""
        end.back_end.load(end.wanted)
        now = end.back_end.read()
        if now != end.after:
            differing = sorted(set(now) ^ set(end.after))[:3]
            raise Problem(
                f"{end.back_end.name} holds other rules than it was given ({'; '.join(map(quote, differing))}), expected the same: see what "
                "else changes them."
            )
