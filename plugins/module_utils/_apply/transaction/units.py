# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Units of systemd: their planned and present state, and the plan of the actions between them (pure).

Works with systemd 237 (Ubuntu 18.04) and later; the words are those of systemctl(1) and org.freedesktop.systemd1(5).
"""

import re
import typing

from ..._base.plain_text import quote
from ..._base.problem import Problem

RUNNING = ("active", "reloading", "refreshing", "activating")
UP = ("active", "reloading", "refreshing")
ENABLED = ("enabled", "enabled-runtime")
INPUTS = "ROSFLEET_INPUTS"  # the environment variable that holds a digest of all that a process was started with
_NAME = re.compile(r"[A-Za-z0-9:_.\\-]+(@[A-Za-z0-9:_.\\-]+)?\.(service|socket|timer|path|target)")
_INPUTS = re.compile(rf"^[ \t]*Environment[ \t]*=.*?\b{INPUTS}=([^\s\"']+)", re.MULTILINE)
# A file below /etc, as an argument of a program or behind EnvironmentFile=.
_FILE = re.compile(r"(?<![\w./])/etc/[^\s\"';]+")
_INSTALL = re.compile(r"^[ \t]*(WantedBy|RequiredBy|UpheldBy|Alias|Also)[ \t]*=[ \t]*\S", re.MULTILINE)
_TYPE = re.compile(r"^Type[ \t]*=[ \t]*(\S+)[ \t]*$", re.MULTILINE)
_READY_TYPES = ("notify", "notify-reload", "oneshot", "dbus")
# The settings that make systemd restart a unit together with another one (systemd.unit(5)).
_FOLLOWS = re.compile(r"^[ \t]*(?:PartOf|BindsTo|Requires|Requisite)[ \t]*=(.*)$", re.MULTILINE)


class Unit(typing.NamedTuple):
    """A planned unit."""

    name: str
    content: str
    enabled: bool
    started: bool


class UnitState(typing.NamedTuple):
    """The state of a unit, in the words of `systemctl show`, and the inputs of its running process. Unknown values are empty."""

    Id: str = ""
    LoadState: str = ""
    LoadError: str = ""
    ActiveState: str = ""
    SubState: str = ""
    UnitFileState: str = ""
    FragmentPath: str = ""
    NeedDaemonReload: str = ""
    MainPID: str = ""
    NRestarts: str = ""
    Result: str = ""
    ExecMainCode: str = ""
    ExecMainStatus: str = ""
    ActiveEnterTimestamp: str = ""
    InvocationID: str = ""
    inputs: str = ""


PROPERTIES = UnitState._fields[:-1]


class Action(typing.NamedTuple):
    """A change of the state of one unit, with the reason."""

    name: str
    switch: str  # enable, reenable, disable or ""
    run: str  # start, restart, follow (systemd restarts it together with another one), stop or ""
    why: str


def parse_units(units: typing.Iterable[typing.Dict[str, typing.Any]]) -> typing.List[Unit]:
    """Read the planned units from mappings of name, content, enabled and started. Raises Problem."""
    planned: typing.List[Unit] = []
    for entry in units:
        unit = Unit(entry["name"], entry["content"], entry["enabled"], entry["started"])
        if not _NAME.fullmatch(unit.name):
            raise Problem(
                f"The unit name {unit.name!r} is not usable; expected a name such as multimaster-sync.service, which "
                "ends in .service, .socket, .timer, .path or .target."
            )
        if unit.name in [other.name for other in planned]:
            raise Problem(f"The unit {unit.name} is listed twice in the units; list it once.")
        if unit.enabled and not _INSTALL.search(unit.content):
            raise Problem(
                f"The unit {unit.name} is to be enabled, but its content has no WantedBy= in a section [Install]; "
                "add one, for example WantedBy=multi-user.target, or set enabled: false."
            )
        planned.append(unit)
    return planned


def read_inputs(content: str) -> str:
    """The digest in the last line Environment=ROSFLEET_INPUTS=... of a unit's text, or an empty text."""
    digests = _INPUTS.findall(content)
    return digests[-1] if digests else ""


def files_read(content: str) -> typing.List[str]:
    """The files below /etc that a unit's text names."""
    lines = [line for line in content.splitlines() if not line.lstrip().startswith(("#", ";"))]
    return sorted({path for line in lines for path in _FILE.findall(line)})


def says_when_up(content: str) -> bool:
    """True if systemd waits for the unit's own word that it is up (Type=, systemd.service(5))."""
    types = _TYPE.findall(content)
    return bool(types) and types[-1] in _READY_TYPES


def restart_partners(content: str) -> typing.Set[str]:
    """The units with which systemd restarts the unit of this text."""
    return {name for names in _FOLLOWS.findall(content) for name in names.split()}


def check(units: typing.List[Unit], states: typing.Dict[str, UnitState], owned: typing.Container[str]) -> None:
    """Raise Problem, with a sentence per unit, if a planned unit is masked or has a file that is not owned; pure."""
    problems = []
    for unit in units:
        state = states[unit.name]
        if state.LoadState == "masked" or state.UnitFileState.startswith("masked"):
            problems.append(
                f"The unit {unit.name} is masked on this computer, so it cannot be started: "
                f"run 'systemctl unmask {unit.name}', or take it out of the units."
            )
        elif state.LoadState != "not-found" and state.FragmentPath not in owned:
            problems.append(
                f"There is a unit {unit.name} already that is not ours "
                f"({quote(state.FragmentPath) or 'a unit without a file'}, {state.ActiveState}): "
                "remove it or rename it, or choose another name."
            )
    if problems:
        raise Problem(" ".join(problems))


def plan_actions(
    units: typing.List[Unit],
    removed: typing.List[str],
    states: typing.Dict[str, UnitState],
    written: typing.Container[str],
    pending: typing.Container[str],
    newer_files: typing.Mapping[str, str],
) -> typing.List[Action]:
    """Plan the actions: those of the removed units, last first, then those of the planned units in their order; pure.

    `written` has the units whose file is about to be written. `pending` has the units that an earlier run
    had begun with and did not end, so that they may not have been restarted, or their links made. `newer_files` has the units
    of which a file that they read was written after they had started, and that file.
    """
    actions = [_removal(name, states[name], name in pending) for name in reversed(removed)]
    restarted: typing.Set[str] = set()
    for unit in units:
        state, text, unfinished = states[unit.name], unit.name in written, unit.name in pending
        run, why = _plan_run(unit, state, text, unfinished, newer_files.get(unit.name, ""), restarted)
        if run in ("restart", "follow"):
            restarted.add(unit.name)
        actions.append(Action(unit.name, _plan_switch(unit, state, text or unfinished), run, why))
    return actions


def _removal(name: str, state: UnitState, pending: bool) -> Action:
    """The action for a unit that is no longer listed."""
    run = "" if state.ActiveState in ("inactive", "failed") else "stop"
    # If a run was killed before systemd read its files again, systemd reports the state of before.
    switch = "disable" if state.UnitFileState in ENABLED or (pending and state.UnitFileState) else ""
    return Action(name, switch, run, "it is no longer listed")


def _plan_switch(unit: Unit, state: UnitState, due: bool) -> str:
    """The `switch` of the action for a planned unit; `due`: its links are to be made anew."""
    if unit.enabled and (due or state.UnitFileState != "enabled"):
        # A changed text may name other targets, so the links of the old one have to go.
        return "reenable" if state.UnitFileState == "enabled" else "enable"
    return "disable" if not unit.enabled and state.UnitFileState in ENABLED else ""


def _plan_run(
    unit: Unit, state: UnitState, text: bool, unfinished: bool, newer_file: str, restarted: typing.Set[str]
) -> typing.Tuple[str, str]:
    """The `run` and `why` of the action for a planned unit; `restarted` are the units before it that are restarted."""
    running = state.ActiveState in RUNNING
    if not unit.started:
        return ("stop", "it is planned to be stopped") if running else ("", "")
    if not running:
        return "start", f"it was {state.ActiveState}"
    if state.SubState.startswith("auto-restart"):
        return "restart", "it had ended and was waiting for another start"
    if text:
        return "restart", "its text changed"
    planned = read_inputs(unit.content)
    if planned and state.MainPID != "0" and planned != state.inputs:
        return "restart", f"it ran with the inputs {state.inputs[:12] or 'of nobody'}"
    if unfinished:
        return "restart", "an earlier run did not come to its end"
    if newer_file and state.MainPID != "0":
        return "restart", f"{newer_file} was written after its start"
    others = sorted(restart_partners(unit.content) & restarted)
    if others:
        return "follow", f"systemd restarts it with {others[0]}"
    if state.ActiveState == "activating":
        return "start", "it was starting"
    return "", ""
