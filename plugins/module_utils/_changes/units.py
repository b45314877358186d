# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Units of systemd: what they are and should be, the steps between (pure), and systemctl.

Works with systemd 237 (Ubuntu 18.04) and later; the words are those of systemctl(1) and org.freedesktop.systemd1(5).
"""

import os
import re
import shutil
import time
import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._changes import atomic
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import commands
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.problem import Problem

RUNNING = ("active", "reloading", "refreshing", "activating")
UP = ("active", "reloading", "refreshing")
_ENABLED = ("enabled", "enabled-runtime")
_JOURNAL_LINES = 15
_QUICK = 60.0  # seconds; calls that start nothing
_SETTLE = 1.0  # seconds in which a service that dies at once does so
_NAME = re.compile(r"[A-Za-z0-9:_.\\-]+(@[A-Za-z0-9:_.\\-]+)?\.(service|socket|timer|path|target)")
_INPUTS = re.compile(r"^[ \t]*Environment[ \t]*=.*?\bROSFLEET_INPUTS=([^\s\"']+)", re.MULTILINE)
_INSTALL = re.compile(r"^[ \t]*(WantedBy|RequiredBy|UpheldBy|Alias|Also)[ \t]*=[ \t]*\S", re.MULTILINE)
# What makes systemd restart a unit together with another one (systemd.unit(5)).
_FOLLOWS = re.compile(r"^[ \t]*(?:PartOf|BindsTo|Requires|Requisite)[ \t]*=(.*)$", re.MULTILINE)

# The folders that systemd makes for a unit (systemd.exec(5)): property, and below which folder.
_DIRECTORIES = (
    ("RuntimeDirectory", "/run"),
    ("StateDirectory", "/var/lib"),
    ("CacheDirectory", "/var/cache"),
    ("LogsDirectory", "/var/log"),
    ("ConfigurationDirectory", "/etc"),
)

Unit = typing.NamedTuple("Unit", [("name", str), ("content", str), ("enabled", bool), ("started", bool)])
# A unit as systemd knows it: field, property of `systemctl show`.
_PROPERTIES = (
    ("name", "Id"),
    ("load", "LoadState"),
    ("load_error", "LoadError"),
    ("active", "ActiveState"),
    ("sub", "SubState"),
    ("file_state", "UnitFileState"),
    ("fragment", "FragmentPath"),
    ("reload", "NeedDaemonReload"),
    ("pid", "MainPID"),
    ("restarts", "NRestarts"),
    ("result", "Result"),
    ("exit_code", "ExecMainCode"),
    ("exit_status", "ExecMainStatus"),
    ("since", "ActiveEnterTimestamp"),
    ("invocation", "InvocationID"),
)
State = typing.NamedTuple("State", [(field, str) for field, _prop in _PROPERTIES] + [("inputs", str)])  # type: ignore
# What is to be done with one unit, and why: switch is "enable", "reenable", "disable" or "", run is "start",
# "restart", "follow" (systemd restarts it together with another one), "stop" or "".
Step = typing.NamedTuple("Step", [("name", str), ("switch", str), ("run", str), ("why", str)])


def wanted_units(units: typing.Iterable[typing.Dict[str, typing.Any]]) -> typing.List[Unit]:
    """The planned units out of mappings of name, content, enabled and started. Raises Problem."""
    wanted: typing.List[Unit] = []
    for entry in units:
        unit = Unit(entry["name"], entry["content"], entry["enabled"], entry["started"])
        if not _NAME.fullmatch(unit.name):
            raise Problem(
                "The unit name %r is not usable; expected a name such as multimaster-sync.service, which ends in "
                ".service, .socket, .timer, .path or .target." % unit.name
            )
        if unit.name in [other.name for other in wanted]:
            raise Problem("The unit %s is listed twice in the units; list it once." % unit.name)
        if unit.enabled and not _INSTALL.search(unit.content):
            raise Problem(
                "The unit %s is to be enabled, but its content has no WantedBy= in a section [Install]; "
                "add one, for example WantedBy=multi-user.target, or set enabled: false." % unit.name
            )
        wanted.append(unit)
    return wanted


def planned_inputs(content: str) -> str:
    """The digest in the last line Environment=ROSFLEET_INPUTS=... of a unit's text, or an empty text."""
    found = _INPUTS.findall(content)
    return found[-1] if found else ""


def followed(content: str) -> typing.Set[str]:
    """The units with which systemd restarts the unit of this text."""
    return {name for names in _FOLLOWS.findall(content) for name in names.split()}


def check(units: typing.List[Unit], states: typing.Dict[str, State], owned: typing.Container[str]) -> None:
    """Raises Problem, a sentence per unit, where a planned unit is masked or somebody else's; pure."""
    problems = []
    for unit in units:
        state = states[unit.name]
        if state.load == "masked" or state.file_state.startswith("masked"):
            problems.append(
                "The unit %s is masked on this computer, so it cannot be started: "
                "run 'systemctl unmask %s', or take it out of the units." % (unit.name, unit.name)
            )
        elif state.load != "not-found" and state.fragment not in owned:
            problems.append(
                "There is a unit %s already that is not ours (%s, %s): "
                "remove it or rename it, or choose another name."
                % (unit.name, state.fragment or "a unit without a file", state.active)
            )
    if problems:
        raise Problem(" ".join(problems))


def plan(
    units: typing.List[Unit],
    removed: typing.List[str],
    states: typing.Dict[str, State],
    texts: typing.Dict[str, str],
    pending: typing.Container[str],
) -> typing.List[Step]:
    """The steps: stops of the removed units, last first, then the planned units in their order; pure.

    `texts` tells whose file is about to be written ("new", "changed"), `pending` who was not restarted after an
    earlier run had written its file.
    """
    steps = []
    for name in reversed(removed):
        run = "" if states[name].active in ("inactive", "failed") else "stop"
        switch = "disable" if states[name].file_state in _ENABLED else ""
        steps.append(Step(name, switch, run, "it is no longer listed"))
    restarted: typing.Set[str] = set()
    for unit in units:
        state, text = states[unit.name], texts.get(unit.name, "")
        switch = ""
        if unit.enabled and (text or state.file_state != "enabled"):
            # A changed text may name other targets, so the links of the old one have to go.
            switch = "reenable" if state.file_state == "enabled" else "enable"
        elif not unit.enabled and state.file_state in _ENABLED:
            switch = "disable"
        run, why = _run(unit, state, text, unit.name in pending, restarted)
        if run in ("restart", "follow"):
            restarted.add(unit.name)
        steps.append(Step(unit.name, switch, run, why))
    return steps


def _run(unit: Unit, state: State, text: str, pending: bool, restarted: typing.Set[str]) -> typing.Tuple[str, str]:
    """What is to be done with the process of a unit, and why."""
    running = state.active in RUNNING
    if not unit.started:
        return ("stop", "it is planned to be stopped") if running else ("", "")
    if not running:
        return "start", "it was %s" % state.active
    if state.sub.startswith("auto-restart"):
        return "restart", "it had ended and was waiting for another start"
    if text:
        return "restart", "its text changed"
    planned = planned_inputs(unit.content)
    if planned and state.pid != "0" and planned != state.inputs:
        return "restart", "it ran with the inputs %s" % (state.inputs[:12] or "of nobody")
    if pending:
        return "restart", "an earlier run did not come to its end"
    others = sorted(followed(unit.content) & restarted)
    if others:
        return "follow", "systemd restarts it with %s" % others[0]
    if state.active == "activating":
        return "start", "it was starting"
    return "", ""


def parse_show(text: str, names: typing.Sequence[str]) -> typing.List[typing.Dict[str, str]]:
    """The properties of each unit in the output of `systemctl show`; raises Problem if it is not one block for each."""
    blocks = [block for block in text.strip("\n").split("\n\n") if block]
    if len(blocks) != len(names):
        raise Problem(
            "systemctl show told of %d units, expected %d (%s); look at what it says for them."
            % (len(blocks), len(names), " ".join(names))
        )
    return [dict(line.partition("=")[::2] for line in block.splitlines() if "=" in line) for block in blocks]


class Systemd:
    """The systemd of this computer, by systemctl and journalctl."""

    def __init__(self, timeout: float) -> None:
        self.timeout = timeout

    def properties(
        self, names: typing.Sequence[str], wanted: typing.Sequence[str]
    ) -> typing.List[typing.Dict[str, str]]:
        """These properties of these units, in one call."""
        if not names:
            return []
        answer = self._ask("show", "--property=" + ",".join(wanted), "--", *names)
        return parse_show(answer, names)

    def show(self, names: typing.Sequence[str]) -> typing.Dict[str, State]:
        """The state of these units, with the inputs of their running processes."""
        blocks = self.properties(names, [prop for _field, prop in _PROPERTIES])
        return {
            name: State(*[block.get(prop, "") for _field, prop in _PROPERTIES] + [_inputs_of(block.get("MainPID"))])
            for name, block in zip(names, blocks)
        }

    def unit_path(self) -> typing.List[str]:
        """The folders that systemd reads units from."""
        return self._ask("show", "--property=UnitPath").partition("=")[2].split()

    def call(self, verb: str, *names: str) -> None:
        """Run systemctl; raises Problem with what it said."""
        self._ask(verb, *names)

    def try_call(self, verb: str, *names: str) -> None:
        """Run systemctl where a failure means that there was nothing to do."""
        if names:
            commands.run(("systemctl", verb, "--") + names, limit=_QUICK)

    def bring(self, verb: str, name: str) -> None:
        """Start or restart a unit and wait until it is there; raises Problem with its state and its journal."""
        answer = commands.run(("systemctl", verb, "--", name), limit=self.timeout)
        if answer.status != 0:
            late = " within %g s" % self.timeout if answer.status == -1 else ""
            raise Problem("The unit %s did not %s%s%s" % (name, verb, late, self.explain(name)))

    def explain(self, name: str) -> str:
        """What became of a unit: its state, its exit status, and the last lines of its journal."""
        state = self.show([name])[name]
        ended = ""
        if state.exit_code == "1":  # CLD_EXITED, sigaction(2)
            ended = ", exit status %s" % state.exit_status
        elif state.exit_code in ("2", "3"):  # CLD_KILLED, CLD_DUMPED
            ended = ", killed by signal %s" % state.exit_status
        lines = self._journal(name, state.invocation)
        return ": it is %s (%s)%s%s.%s" % (
            state.active,
            state.sub,
            ", result " + state.result if state.result not in ("", "success") else "",
            ended,
            " The end of its journal:\n  " + "\n  ".join(lines) + "\n" if lines else " Its journal is empty.",
        )

    def _journal(self, name: str, invocation: str) -> typing.List[str]:
        """The last lines of this start; of the unit, where this start has written nothing yet."""
        commands.run(("journalctl", "--sync"), limit=_QUICK)
        # journalctl --invocation is of systemd 257; the fields are older than all that we support.
        this_start = ("_SYSTEMD_INVOCATION_ID=" + invocation, "+", "INVOCATION_ID=" + invocation)
        for selection in (this_start if invocation else (), ("--unit=" + name,)):
            command = ("journalctl", "--quiet", "--no-pager", "--output=cat", "--lines=%d" % _JOURNAL_LINES)
            answer = commands.run(command + selection, limit=_QUICK) if selection else None
            if answer and answer.status == 0 and answer.output.strip():
                return answer.output.decode("utf-8", "replace").splitlines()
        return []

    def _ask(self, verb: str, *arguments: str) -> str:
        limit = _QUICK if verb == "show" else max(_QUICK, self.timeout)
        answer = commands.run(("systemctl", verb) + arguments, limit=limit)
        if answer.status != 0:
            raise Problem(
                "'systemctl %s' failed: %s."
                % (" ".join((verb,) + arguments), answer.error.rstrip(".") or answer.status)
            )
        return answer.output.decode("utf-8", "replace")


class Applier:
    """Takes the steps of a plan on the machine, and takes them back."""

    def __init__(
        self,
        systemd: Systemd,
        units: typing.List[Unit],
        steps: typing.List[Step],
        before: typing.Dict[str, State],
        transaction: typing.Any,
        memory: typing.Dict,
    ) -> None:
        self.systemd = systemd
        self.units = units
        self.steps = steps
        self.before = before
        self.transaction = transaction
        self.memory = memory  # what the record holds beside the files: units, pending, directories, parents
        self.new_directories: typing.Dict[str, typing.List[str]] = {}
        self.new_parents: typing.List[str] = []
        self.restarted = False  # whether this run has restarted a unit that others may follow
        self.later: typing.List[str] = []  # units that were stopped, to start after what they depend on
        self.brought_back: typing.List[str] = []  # units that `restore` has restarted

    def apply(self, reload: bool, fresh: typing.List[str], paths: typing.Dict[str, str]) -> typing.Dict[str, State]:
        """Take all steps and return the states read back; `fresh` units have a text that did not run yet.

        Raises Problem or OSError; then `restore` is due.
        """
        names = [unit.name for unit in self.units]
        self.transaction.begin(self.memory)
        wanted = set(names)
        for step in self.steps:
            if step.name not in wanted:
                self._stop_and_switch(step)
        for step in reversed(self.steps):
            if step.name in wanted and step.run == "stop":
                self.systemd.call("stop", "--", step.name)
        self.transaction.apply()
        if reload:
            self.systemd.call("daemon-reload")
        if fresh:
            self._check_loaded(fresh, paths)
            self._remember_directories(fresh)
        for step in self.steps:
            if step.name in wanted and step.switch:
                self.systemd.call(step.switch, "--", step.name)
        # Units that restart together end in reverse order before the first one does: a node that saw its roscore go
        # would end with an error instead of taking leave.
        self.later = [step.name for step in self.steps if step.run == "restart"][1:]
        for name in reversed(self.later):
            self.systemd.call("stop", "--", name)
        begun = [step for step in self.steps if step.run in ("start", "restart", "follow")]
        # A start limit that was hit would refuse the next start, and restarts of before would be taken for new ones.
        self.systemd.try_call("reset-failed", *[step.name for step in begun])
        for step in begun:
            self._bring_up(step)
        if begun:
            time.sleep(_SETTLE)
        after = self.systemd.show(names)
        self._check_up(after)
        return after

    def clean(self) -> None:
        """What systemd keeps of the removed units: failures, and the folders that it made for them."""
        wanted = [unit.name for unit in self.units]
        removed = [step.name for step in self.steps if step.name not in wanted]
        self.systemd.try_call("reset-failed", *removed)
        directories = self.memory["directories"]
        in_use = {path for name in wanted for path in directories.get(name, ())}
        for name in removed:
            remove_trees(path for path in directories.pop(name, ()) if path not in in_use)
        remove_parents(self.memory["parents"])
        self.memory["parents"] = [path for path in self.memory["parents"] if wanted and os.path.isdir(path)]

    def restore(self) -> typing.List[str]:
        """Bring files, links and processes back to what they were; returns a sentence for each failure."""
        left: typing.List[str] = []

        def attempt(function: typing.Callable[..., typing.Any], *arguments: typing.Any) -> typing.Any:
            try:
                return function(*arguments)
            except (OSError, Problem) as problem:
                left.append(str(problem))
                return None

        wanted = [unit.name for unit in self.units]
        names = [step.name for step in self.steps if step.name not in wanted][::-1] + wanted
        for name in reversed(names):
            if self.before[name].active not in RUNNING:
                self.systemd.try_call("stop", name)
            if self.before[name].file_state not in _ENABLED:
                self.systemd.try_call("disable", name)
        left.extend(self.transaction.take_back())
        attempt(self.systemd.call, "daemon-reload")
        self.systemd.try_call("reset-failed", *names)
        remove_trees(path for paths in self.new_directories.values() for path in paths)
        remove_parents(self.new_parents)

        self.restarted = False
        now = attempt(self.systemd.show, names) or {}
        for name, state in ((name, now[name]) for name in names if name in now):
            before = self.before[name]
            if before.file_state in _ENABLED:
                runtime = ("--runtime",) if before.file_state == "enabled-runtime" else ()
                attempt(self.systemd.call, "reenable", *(runtime + ("--", name)))
            untouched = state.active in UP and state.invocation == before.invocation
            if before.active in RUNNING and not untouched:
                self.brought_back.append(name)
                attempt(self._restart, name, state.invocation)
        return left

    def _stop_and_switch(self, step: Step) -> None:
        if step.run:
            self.systemd.call(step.run, "--", step.name)
        if step.switch:
            self.systemd.call(step.switch, "--", step.name)

    def _bring_up(self, step: Step) -> None:
        if step.run == "restart" and step.name not in self.later:
            self._restart(step.name, self.before[step.name].invocation)
        else:
            self.systemd.bring("start", step.name)

    def _restart(self, name: str, invocation: str) -> None:
        """Restart a unit whose present process is this invocation; only wait where systemd is already at it."""
        if self.restarted:
            # A start joins the restart that PartOf= and the like have begun; a second restart would repeat it.
            self.systemd.bring("start", name)
            if self.systemd.show([name])[name].invocation != invocation:
                return
        self.systemd.bring("restart", name)
        self.restarted = True

    def _check_loaded(self, fresh: typing.List[str], paths: typing.Dict[str, str]) -> None:
        """Before anything is started: systemd has read our files, and takes no others for these names."""
        for name, state in self.systemd.show(fresh).items():
            if state.load != "loaded":
                raise Problem(
                    "systemd does not accept the content of %s (%s%s); correct it, systemd-analyze verify tells more."
                    % (name, state.load, ": " + state.load_error if state.load_error else "")
                )
            if os.path.realpath(state.fragment) != os.path.realpath(paths[name]):
                raise Problem(
                    "systemd reads the unit %s from %s, expected from %s; remove that file."
                    % (name, state.fragment or "nowhere", paths[name])
                )

    def _remember_directories(self, fresh: typing.List[str]) -> None:
        """Remember, before the start, which folders systemd is about to make: only those are removed with the unit."""
        asked = ["DynamicUser", "RuntimeDirectoryPreserve"] + [prop for prop, _base in _DIRECTORIES]
        ours = {path for paths in self.memory["directories"].values() for path in paths}
        for name, block in zip(fresh, self.systemd.properties(fresh, asked)):
            paths, parents = state_directories(block)
            new = [path for path in paths if path in ours or not os.path.lexists(path)]
            self.new_parents += [path for path in parents if not os.path.lexists(path)]
            known = self.memory["directories"].get(name, [])
            self.new_directories[name] = [path for path in new if path not in ours]
            if new:
                self.memory["directories"][name] = sorted(set(known) | set(new))
        self.memory["parents"] = sorted(set(self.memory["parents"]) | set(self.new_parents))
        self.transaction.begin(self.memory)

    def _check_up(self, states: typing.Dict[str, State]) -> None:
        """Every unit that is planned to run does, and those that were started now did not end in between."""
        begun = [step.name for step in self.steps if step.run in ("start", "restart", "follow")]
        for unit in self.units:
            state = states[unit.name]
            if unit.started and state.active not in UP:
                raise Problem("The unit %s did not stay up%s" % (unit.name, self.systemd.explain(unit.name)))
            if unit.name in begun and state.restarts not in ("", "0"):
                raise Problem(
                    "The unit %s ended %s times right after its start%s"
                    % (unit.name, state.restarts, self.systemd.explain(unit.name))
                )


def state_directories(properties: typing.Dict[str, str]) -> typing.Tuple[typing.List[str], typing.List[str]]:
    """The folders that systemd makes for a unit with these properties, and the parents it may make for them; pure.

    With DynamicUser= the folder stands below `private`, with a symbolic link to it at its usual place.
    """
    paths, parents = [], set()
    for prop, base in _DIRECTORIES:
        if prop == "RuntimeDirectory" and properties.get("RuntimeDirectoryPreserve", "no") == "no":
            continue  # systemd removes it itself
        for name in properties.get(prop, "").split():
            name = name.partition(":")[0]
            places = [base]
            if properties.get("DynamicUser") == "yes" and prop != "ConfigurationDirectory":
                places.append(os.path.join(base, "private"))
                parents.add(places[-1])
            for place in places:
                paths.append(os.path.join(place, name))
                parent = os.path.dirname(paths[-1])
                while parent != place:
                    parents.add(parent)
                    parent = os.path.dirname(parent)
    return paths, sorted(parents)


def remove_trees(paths: typing.Iterable[str]) -> None:
    """Remove folders with all they hold, and symbolic links to them; missing ones are no error."""
    for path in paths:
        if os.path.islink(path):
            atomic.remove(path)
        elif os.path.isdir(path):
            shutil.rmtree(path)


def remove_parents(paths: typing.Iterable[str]) -> None:
    """Remove those of these folders that are empty, innermost first."""
    for path in sorted(paths, reverse=True):
        atomic.remove_folder_if_empty(path)


def _inputs_of(pid: typing.Optional[str]) -> str:
    """ROSFLEET_INPUTS in the environment of a running process (proc(5)), or an empty text."""
    environment = atomic.read_bytes("/proc/%s/environ" % pid) if pid and pid != "0" else None
    for variable in (environment or b"").split(b"\0"):
        if variable.startswith(b"ROSFLEET_INPUTS="):
            return variable.partition(b"=")[2].decode("utf-8", "replace")
    return ""
