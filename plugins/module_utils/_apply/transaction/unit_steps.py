# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The steps that carry out a plan of units, around the steps of their files.

Units stop before their files change, and start after systemd has read the new ones. Undone, everything goes the other
way: new units stop, the files come back, systemd reads them, and the units run again that ran before.
"""

import os
import time
import typing

from ..._base.plain_text import LINE, quote
from ..._base.problem import Problem, sentence
from . import systemctl, units
from .files import RECORD_RESTORE_FAILURE, FileBundle
from .systemctl import Systemd
from .transaction import Data, Step, do_nothing, intent

SWITCHES = ("disable", "enable", "reenable")  # verbs of systemctl
SETTLE = 1.0  # seconds in which a service that dies at once does so, if it does not say when it is up


class UnitSteps:
    """The units of a bundle: their plan, with that of their files, its steps, and the facts that become known meanwhile."""

    def __init__(self, systemd: Systemd, bundle: FileBundle, wanted: typing.List[units.Unit]) -> None:
        """Ask systemd, and plan. Raises OSError, and Problem if something that is not ours is in the way."""
        self.systemd, self.wanted = systemd, wanted
        self.names = [unit.name for unit in wanted]
        self.former = [name for name in bundle.remembered.get("units", []) if name not in self.names]
        self.before = self.after = self._ask()  # `after`: the states that were read back
        units.check(wanted, self.before, bundle.owned)
        self.files = bundle.make_plan()
        # A former unit whose file an interrupted run never wrote may be another program's.
        self.removed = [name for name in self.former if self.before[name].FragmentPath in ("", *bundle.owned)]
        self.paths = {name: file.path for name, file in zip(self.names, bundle.wanted)}
        self.written = [name for name, file in zip(self.names, bundle.wanted) if file in self.files.writes]
        pending = set(bundle.remembered.get("pending", []))
        # Those with a text that did not run yet.
        self.fresh = [name for name in self.names if name in self.written or name in pending]
        self.actions = self._plan_actions(pending)
        self._removals = self.actions[: len(self.removed)]
        self._updates = self.actions[len(self.removed) :]
        self.memory = self._make_memory()
        self._all_names = self.removed + self.names  # units on which others depend come first
        self._new_directories: typing.Dict[str, typing.List[str]] = {}
        self._new_parents: typing.List[str] = []
        self._restarted = False  # this run has restarted a unit that others may follow

    def _ask(self) -> typing.Dict[str, units.UnitState]:
        """The states of the planned and the former units."""
        return {
            # systemd reports the state of before if a run was killed after it had removed the file.
            name: state if os.path.lexists(state.FragmentPath) else state._replace(UnitFileState="")
            for name, state in self.systemd.show(self.names + self.former).items()
        }

    @property
    def reload(self) -> bool:
        """True if systemd is to read the files of units again."""
        return self.files.changed or any(state.NeedDaemonReload == "yes" for state in self.before.values())

    @property
    def has_changes(self) -> bool:
        """True if a unit or a file changes, or the record of them."""
        return bool(self.reload or self.former or any(action.run or action.switch for action in self.actions))

    def _plan_actions(self, pending: typing.Set[str]) -> typing.List[units.Action]:
        newer = {unit.name: self.systemd.find_newer_file(unit.content, self.before[unit.name]) for unit in self.wanted}
        return units.plan_actions(self.wanted, self.removed, self.before, self.written, pending, newer)

    def _make_memory(self) -> Data:
        """The part of the record that is not of the files."""
        remembered = self.files.remembered
        switched = [action.name for action in self.actions if action.switch]
        return dict(
            units=self.former + self.names,
            pending=list(dict.fromkeys(self.fresh + switched)),
            directories=dict(remembered.get("directories", {})),
            parents=list(remembered.get("parents", [])),
        )

    def steps(self) -> typing.List[Step]:
        """All steps in their order, with the record and with those of the files."""
        return [
            Step("the units", do_nothing, self._bring_back),
            intent(self.files.record, self._data, self.files.remembered, RECORD_RESTORE_FAILURE),
            Step("the running units", self._stop),
            *self.files.steps(),
            Step("the new units", self._load, self._stop_new),
            Step("the started units", self._start),
            Step("the remains of removed units in systemd", self._clean),
            Step(self.files.record.path, self._settle),
        ]

    # The record

    @property
    def _data(self) -> Data:
        """The record while the run is at work."""
        return dict(self.files.intent, **self.memory)

    def _settle(self) -> None:
        self.files.record.save(dict(self.files.after, **dict(self.memory, units=self.names, pending=[])))

    # Do

    def _stop(self) -> None:
        """Stop the removed units, and the planned ones that shall not run, last first; and disable the removed ones."""
        for action in [*self._removals, *reversed(self._updates)]:
            if action.run == "stop":
                self.systemd.call("stop", "--", action.name)
        # Last: it stops nothing, so it can wait for all stops, and a stop that fails leaves every link. Not later:
        # systemctl needs the files, which go next.
        self._switch(self._removals)

    def _load(self) -> None:
        """Enable or disable the planned units, let systemd read all files once, and check before any start that it took them."""
        self._switch(self._updates)
        if self.reload or any(action.switch for action in self.actions):
            self.systemd.call("daemon-reload")
        if not self.fresh:
            return
        for name, state in self.systemd.show(self.fresh).items():
            if state.LoadState != "loaded":
                why = ": ".join(filter(None, [state.LoadState, quote(state.LoadError, LINE)]))
                raise Problem(
                    f"systemd does not accept the content of {name} ({why}); "
                    "correct it, systemd-analyze verify shows more."
                )
            path = self.paths[name]
            if os.path.realpath(state.FragmentPath) != os.path.realpath(path):
                raise Problem(
                    f"systemd reads the unit {name} from {quote(state.FragmentPath) or 'nowhere'}, expected from {path}; "
                    "remove that file."
                )
        self._remember_directories()

    def _remember_directories(self) -> None:
        """Save, before the start, which folders systemd is about to make: only those are removed with the unit."""
        directories = self.memory["directories"]
        owned = {path for paths in directories.values() for path in paths}
        blocks = self.systemd.properties(self.fresh, systemctl.DIRECTORY_PROPERTIES)
        for name, block in zip(self.fresh, blocks):
            paths, parents = systemctl.state_directories(block)
            new = [path for path in paths if path in owned or not os.path.lexists(path)]
            self._new_parents += [path for path in parents if not os.path.lexists(path)]
            self._new_directories[name] = [path for path in new if path not in owned]
            if new:
                directories[name] = sorted(set(directories.get(name, [])) | set(new))
        self.memory["parents"] = sorted(set(self.memory["parents"]) | set(self._new_parents))
        self.files.record.save(self._data)

    def _start(self) -> None:
        """Start and restart the planned units in their order, and look whether they stay up."""
        # Units that restart together end in reverse order before the first one does: a node that saw its roscore go
        # would end with an error instead of taking leave.
        later = [action.name for action in self.actions if action.run == "restart"][1:]
        for name in reversed(later):
            self.systemd.call("stop", "--", name)
        actions = [action for action in self.actions if action.run in ("start", "restart", "follow")]
        # A start limit that was hit would refuse the next start, and restarts of before would be taken for new ones.
        self.systemd.try_call("reset-failed", *[action.name for action in actions])
        for action in actions:
            if action.run == "restart" and action.name not in later:
                self._restart(action.name, self.before[action.name].InvocationID)
            else:
                self.systemd.bring("start", action.name)
        texts = {unit.name: unit.content for unit in self.wanted}
        if any(not units.says_when_up(texts[action.name]) for action in actions):
            time.sleep(SETTLE)
        self.after = self.systemd.show(self.names)
        self._check_up([action.name for action in actions])

    def _switch(self, actions: typing.Sequence[units.Action]) -> None:
        """Enable and disable units. That systemd reads all its files after each call is left to the one reload of `_load`."""
        for verb in SWITCHES:
            names = [action.name for action in actions if action.switch == verb]
            if names:
                self.systemd.call(verb, "--no-reload", "--", *names)

    def _restart(self, name: str, invocation: str) -> None:
        """Restart a unit whose present process is this invocation; only wait if systemd is already at it."""
        if self._restarted:
            # A start joins the restart that PartOf= and the like have begun; a second restart would repeat it.
            self.systemd.bring("start", name)
            if self.systemd.show([name])[name].InvocationID != invocation:
                return
        self.systemd.bring("restart", name)
        self._restarted = True

    def _check_up(self, names: typing.Container[str]) -> None:
        """Raise Problem if a unit that is planned to run does not, or one of those started now has ended since."""
        for unit in self.wanted:
            state = self.after[unit.name]
            if unit.started and state.ActiveState not in units.UP:
                raise Problem(f"The unit {unit.name} did not stay up{self.systemd.explain(unit.name)}")
            if unit.name in names and state.NRestarts not in ("", "0"):
                raise Problem(
                    f"The unit {unit.name} ended {state.NRestarts} times right after its start"
                    f"{self.systemd.explain(unit.name)}"
                )

    def _clean(self) -> None:
        """Remove the remains of the removed units in systemd: failures, and the folders that it made for them."""
        self.systemd.try_call("reset-failed", *self.removed)
        directories = self.memory["directories"]
        in_use = {path for name in self.names for path in directories.get(name, ())}
        for name in self.removed:
            systemctl.remove_trees(path for path in directories.pop(name, ()) if path not in in_use)
        parents = self.memory["parents"]
        systemctl.remove_parents(parents)
        self.memory["parents"] = [path for path in parents if self.wanted and os.path.isdir(path)]

    # Undo

    def _stop_new(self) -> None:
        """Stop and disable the units that did not run before."""
        for name in reversed(self._all_names):
            if self.before[name].ActiveState not in units.RUNNING:
                self.systemd.try_call("stop", name)
            if self.before[name].UnitFileState not in units.ENABLED:
                self.systemd.try_call("disable", name)

    def _bring_back(self) -> typing.List[str]:
        """Let systemd read the former files, and enable and run the units that were enabled and ran; returns the failures."""
        failures: typing.List[str] = []

        def attempt(function: typing.Callable[..., typing.Any], *arguments: typing.Any) -> typing.Any:
            try:
                return function(*arguments)
            except (OSError, Problem) as problem:
                failures.append(sentence(problem))
                return None

        attempt(self.systemd.call, "daemon-reload")
        self.systemd.try_call("reset-failed", *self._all_names)
        attempt(systemctl.remove_trees, [path for paths in self._new_directories.values() for path in paths])
        attempt(systemctl.remove_parents, self._new_parents)
        self._restarted = False
        names = []
        states = attempt(self.systemd.show, self._all_names) or {}
        for name in [name for name in self._all_names if name in states]:
            before, state = self.before[name], states[name]
            if before.UnitFileState in units.ENABLED:
                runtime = ("--runtime",) if before.UnitFileState == "enabled-runtime" else ()
                attempt(self.systemd.call, "reenable", *runtime, "--", name)
            untouched = state.ActiveState in units.UP and state.InvocationID == before.InvocationID
            if before.ActiveState in units.RUNNING and not untouched:
                names.append(name)
                attempt(self._restart, name, state.InvocationID)
        if names:
            attempt(self._remember_pending, names)
        return failures

    def _remember_pending(self, names: typing.Iterable[str]) -> None:
        """Save that the next run restarts these units.

        They run with their former text, but with environment and code that other modules may have changed already.
        """
        pending = set(self.files.remembered.get("pending", [])) | set(names)
        self.files.record.save(dict(self.files.record.load(), pending=sorted(pending)))
