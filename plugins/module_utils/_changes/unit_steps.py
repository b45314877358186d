# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The steps that carry out a plan of units, around the steps of their files.

Units stop before their files change, and start after systemd has read the new ones. Undone, everything goes the other
way: new units stop, the files come back, systemd reads them, and the units run again that ran before.
"""

import os
import time
import typing

from .._module.plain_text import LINE, quote
from .._module.problem import Problem, sentence
from . import systemctl, units
from .files import RECORD_RESTORE_FAILURE, FilePlan
from .record import Record
from .systemctl import Systemd
from .transaction import Data, Step, do_nothing, intent

SWITCHES = ("disable", "enable", "reenable")  # verbs of systemctl
SETTLE = 1.0  # seconds in which a service that dies at once does so, where it does not say when it is up


class UnitPlan(typing.NamedTuple):
    """A plan of units, as far as its steps depend on it."""

    wanted: typing.List[units.Unit]
    actions: typing.List[units.Action]  # of the removed units, last first, then of the planned ones in their order
    before: typing.Dict[str, units.State]  # of all these units
    paths: typing.Dict[str, str]  # planned unit -> its file
    fresh: typing.List[str]  # planned units with a text that did not run yet
    reload: bool  # systemd has to read unit files
    files: FilePlan

    @property
    def names(self) -> typing.List[str]:
        """The planned units."""
        return [unit.name for unit in self.wanted]

    @property
    def removals(self) -> typing.List[units.Action]:
        """The actions of the units that are no longer listed, last first."""
        return [action for action in self.actions if action.name not in self.paths]

    @property
    def updates(self) -> typing.List[units.Action]:
        """The actions of the planned units in their order."""
        return [action for action in self.actions if action.name in self.paths]


class UnitSteps:
    """The steps, and what becomes known while they are carried out.

    `memory` is the part of the record that is not of the files: units, pending, directories, parents.
    """

    def __init__(self, systemd: Systemd, plan: UnitPlan, record: Record, remembered: Data, memory: Data) -> None:
        self.systemd = systemd
        self.plan = plan
        self.record = record
        self.remembered = remembered
        self.memory = memory
        self.after: typing.Dict[str, units.State] = {}  # the states that were read back
        self._new_directories: typing.Dict[str, typing.List[str]] = {}
        self._new_parents: typing.List[str] = []
        self._restarted = False  # this run has restarted a unit that others may follow
        self._later: typing.List[str] = []  # units that were stopped, to start after what they depend on

    def steps(self, files: typing.Iterable[Step]) -> typing.List[Step]:
        """All steps in their order, with the record and with these steps of the files."""
        return [
            Step("the units", do_nothing, self._bring_back),
            intent(self.record, self._data, self.remembered, RECORD_RESTORE_FAILURE),
            Step("the running units", self._stop),
            *files,
            Step("the new units", self._load, self._stop_new),
            Step("the started units", self._start),
            Step("what systemd keeps of removed units", self._clean),
            Step(self.record.path, self._settle),
        ]

    # The record

    @property
    def _data(self) -> Data:
        """The record while the run is at work."""
        return dict(self.plan.files.intent, **self.memory)

    def _settle(self) -> None:
        after = dict(self.plan.files.after, **dict(self.memory, units=self.plan.names, pending=[]))
        self.record.save(after if any(after.values()) else {})

    # Do

    def _stop(self) -> None:
        """Stop and disable the removed units, and stop the planned units that shall not run, last first."""
        for action in self.plan.removals:
            if action.run:
                self.systemd.call(action.run, "--", action.name)
        self._switch(self.plan.removals)
        for action in reversed(self.plan.updates):
            if action.run == "stop":
                self.systemd.call("stop", "--", action.name)

    def _load(self) -> None:
        """Enable or disable the planned units, let systemd read all files once, and check before any start what it took."""
        self._switch(self.plan.updates)
        if self.plan.reload or any(action.switch for action in self.plan.actions):
            self.systemd.call("daemon-reload")
        if not self.plan.fresh:
            return
        for name, state in self.systemd.show(self.plan.fresh).items():
            if state["LoadState"] != "loaded":
                why = (
                    f"{state['LoadState']}: {quote(state['LoadError'], LINE)}"
                    if state["LoadError"]
                    else state["LoadState"]
                )
                raise Problem(
                    f"systemd does not accept the content of {name} ({why}); "
                    "correct it, systemd-analyze verify tells more."
                )
            path = self.plan.paths[name]
            if os.path.realpath(state["FragmentPath"]) != os.path.realpath(path):
                raise Problem(
                    f"systemd reads the unit {name} from {quote(state['FragmentPath']) or 'nowhere'}, expected from {path}; "
                    "remove that file."
                )
        self._remember_directories()

    def _remember_directories(self) -> None:
        """Save, before the start, which folders systemd is about to make: only those are removed with the unit."""
        directories = self.memory["directories"]
        owned = {path for paths in directories.values() for path in paths}
        blocks = self.systemd.properties(self.plan.fresh, systemctl.DIRECTORY_PROPERTIES)
        for name, block in zip(self.plan.fresh, blocks):
            paths, parents = systemctl.state_directories(block)
            new = [path for path in paths if path in owned or not os.path.lexists(path)]
            self._new_parents += [path for path in parents if not os.path.lexists(path)]
            self._new_directories[name] = [path for path in new if path not in owned]
            if new:
                directories[name] = sorted(set(directories.get(name, [])) | set(new))
        self.memory["parents"] = sorted(set(self.memory["parents"]) | set(self._new_parents))
        self.record.save(self._data)

    def _start(self) -> None:
        """Start and restart the planned units in their order, and look whether they stay up."""
        # Units that restart together end in reverse order before the first one does: a node that saw its roscore go
        # would end with an error instead of taking leave.
        self._later = [action.name for action in self.plan.actions if action.run == "restart"][1:]
        for name in reversed(self._later):
            self.systemd.call("stop", "--", name)
        actions = [action for action in self.plan.actions if action.run in ("start", "restart", "follow")]
        # A start limit that was hit would refuse the next start, and restarts of before would be taken for new ones.
        self.systemd.try_call("reset-failed", *[action.name for action in actions])
        for action in actions:
            if action.run == "restart" and action.name not in self._later:
                self._restart(action.name, self.plan.before[action.name]["InvocationID"])
            else:
                self.systemd.bring("start", action.name)
        texts = {unit.name: unit.content for unit in self.plan.wanted}
        if any(not units.says_when_up(texts[action.name]) for action in actions):
            time.sleep(SETTLE)
        self.after = self.systemd.show(self.plan.names)
        self._check_up([action.name for action in actions])

    def _switch(self, actions: typing.Sequence[units.Action]) -> None:
        """Enable and disable units. That systemd reads all its files after each call is left to the one reload of `_load`."""
        for verb in SWITCHES:
            names = [action.name for action in actions if action.switch == verb]
            if names:
                self.systemd.call(verb, "--no-reload", "--", *names)

    def _restart(self, name: str, invocation: str) -> None:
        """Restart a unit whose present process is this invocation; only wait where systemd is already at it."""
        if self._restarted:
            # A start joins the restart that PartOf= and the like have begun; a second restart would repeat it.
            self.systemd.bring("start", name)
            if self.systemd.show([name])[name]["InvocationID"] != invocation:
                return
        self.systemd.bring("restart", name)
        self._restarted = True

    def _check_up(self, names: typing.Container[str]) -> None:
        """Raise Problem where a unit that is planned to run does not, or one of those started now has ended since."""
        for unit in self.plan.wanted:
            state = self.after[unit.name]
            if unit.started and state["ActiveState"] not in units.UP:
                raise Problem(f"The unit {unit.name} did not stay up{self.systemd.explain(unit.name)}")
            if unit.name in names and state["NRestarts"] not in ("", "0"):
                raise Problem(
                    f"The unit {unit.name} ended {state['NRestarts']} times right after its start"
                    f"{self.systemd.explain(unit.name)}"
                )

    def _clean(self) -> None:
        """Remove what systemd keeps of the removed units: failures, and the folders that it made for them."""
        removed = [action.name for action in self.plan.removals]
        self.systemd.try_call("reset-failed", *removed)
        directories = self.memory["directories"]
        in_use = {path for name in self.plan.names for path in directories.get(name, ())}
        for name in removed:
            systemctl.remove_trees(path for path in directories.pop(name, ()) if path not in in_use)
        parents = self.memory["parents"]
        systemctl.remove_parents(parents)
        self.memory["parents"] = [path for path in parents if self.plan.wanted and os.path.isdir(path)]

    # Undo

    @property
    def _unit_names(self) -> typing.List[str]:
        """Removed and planned units, what others depend on first."""
        return [action.name for action in reversed(self.plan.removals)] + self.plan.names

    def _stop_new(self) -> None:
        """Stop and disable the units that did not run before."""
        for name in reversed(self._unit_names):
            if self.plan.before[name]["ActiveState"] not in units.RUNNING:
                self.systemd.try_call("stop", name)
            if self.plan.before[name]["UnitFileState"] not in units.ENABLED:
                self.systemd.try_call("disable", name)

    def _bring_back(self) -> typing.List[str]:
        """Let systemd read the former files, and enable and run what was enabled and ran; returns the failures."""
        failures: typing.List[str] = []

        def attempt(function: typing.Callable[..., typing.Any], *arguments: typing.Any) -> typing.Any:
            try:
                return function(*arguments)
            except (OSError, Problem) as problem:
                failures.append(str(problem))
                return None

        attempt(self.systemd.call, "daemon-reload")
        self.systemd.try_call("reset-failed", *self._unit_names)
        attempt(systemctl.remove_trees, [path for paths in self._new_directories.values() for path in paths])
        attempt(systemctl.remove_parents, self._new_parents)
        self._restarted = False
        names = []
        states = attempt(self.systemd.show, self._unit_names) or {}
        for name in [name for name in self._unit_names if name in states]:
            before, state = self.plan.before[name], states[name]
            if before["UnitFileState"] in units.ENABLED:
                runtime = ("--runtime",) if before["UnitFileState"] == "enabled-runtime" else ()
                attempt(self.systemd.call, "reenable", *runtime, "--", name)
            untouched = state["ActiveState"] in units.UP and state["InvocationID"] == before["InvocationID"]
            if before["ActiveState"] in units.RUNNING and not untouched:
                names.append(name)
                attempt(self._restart, name, state["InvocationID"])
        if names:
            try:
                self._remember_pending(names)
            except (OSError, Problem) as problem:
                failures.append(sentence(problem))
        return failures

    def _remember_pending(self, names: typing.Iterable[str]) -> None:
        """Save that the next run restarts these units.

        They run with their former text, but with environment and code that other modules may have changed already.
        """
        pending = set(self.remembered.get("pending", [])) | set(names)
        self.record.save(dict(self.record.load(), pending=sorted(pending)))
