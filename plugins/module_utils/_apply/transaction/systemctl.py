# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The systemd of this computer, asked and changed by systemctl(1) and journalctl(1); folders that it makes for units."""

import os
import shutil
import stat
import time
import typing

from ..._base import commands, deadlines, processes
from ..._base.plain_text import LINE, quote
from ..._base.problem import Problem
from ..._machine import systemd
from . import atomic, units

_JOURNAL_LINES = 15
_QUICK = 60.0  # seconds; calls that start nothing
_LONGER = 210.0  # seconds that a start gets more on a slow or busy computer, at most
_SOON = 5.0  # seconds; a file of that time may have been read, and clocks are set

# The folders that systemd makes for a unit (systemd.exec(5)): property, and below which folder.
_DIRECTORIES = (
    ("RuntimeDirectory", "/run"),
    ("StateDirectory", "/var/lib"),
    ("CacheDirectory", "/var/cache"),
    ("LogsDirectory", "/var/log"),
    ("ConfigurationDirectory", "/etc"),
)
#: the properties that state_directories() needs
DIRECTORY_PROPERTIES = ("DynamicUser", "RuntimeDirectoryPreserve") + tuple(prop for prop, base in _DIRECTORIES)


class Systemd:
    """The systemd of this computer; `timeout` in seconds is that of a start on an idle computer."""

    def __init__(self, timeout: float) -> None:
        self.timeout = timeout

    def runs(self) -> bool:
        """True if this computer was booted with systemd (sd_booted(3))."""
        return os.path.isdir("/run/systemd/system")

    def properties(self, names: typing.Sequence[str], wanted: typing.Sequence[str]) -> typing.List[systemd.Properties]:
        """Ask for properties of units, in one call; raises Problem."""
        if not names:
            return []
        shown = systemd.show(names, wanted, limit=_QUICK)
        if shown.error:
            raise _failure(("show", f"--property={','.join(wanted)}", "--", *names), shown.error)
        if len(shown.units) != len(names):
            raise Problem(
                f"systemctl show listed {len(shown.units)} units, expected {len(names)} ({' '.join(names)}); "
                "look at its lines for them."
            )
        return shown.units

    def show(self, names: typing.Sequence[str]) -> typing.Dict[str, units.UnitState]:
        """Ask for the state of units, with the inputs of their running processes; raises Problem or OSError."""
        blocks = self.properties(names, units.PROPERTIES)
        states = {}
        for name, block in zip(names, blocks):
            shown_properties = {prop: block.get(prop, "") for prop in units.PROPERTIES}
            states[name] = units.UnitState(**shown_properties, inputs=_inputs_of(shown_properties["MainPID"]))
        return states

    def find_newer_file(self, content: str, state: units.UnitState) -> str:
        """Name a file that a unit's text names, and that was written after its process had started; raises OSError."""
        paths = units.files_read(content) if state.MainPID not in ("", "0") else []
        start = processes.start_time(state.MainPID) if paths else None
        return next((path for path in paths if start is not None and _is_newer(path, start)), "")

    def unit_path(self) -> typing.List[str]:
        """Ask for the folders that systemd reads units from; raises Problem."""
        shown = systemd.show([], ["UnitPath"], limit=_QUICK)
        if shown.error:
            raise _failure(("show", "--property=UnitPath"), shown.error)
        return [folder for block in shown.units for folder in block.get("UnitPath", "").split()]

    def call(self, verb: str, *arguments: str) -> None:
        """Run systemctl; raises Problem with its error."""
        answer = commands.run(("systemctl", verb) + arguments, limit=max(_QUICK, self.timeout))
        if answer.status != 0:
            raise _failure((verb,) + arguments, answer.error or str(answer.status))

    def try_call(self, verb: str, *names: str) -> None:
        """Run systemctl; a failure means that there was nothing to do."""
        if names:
            commands.run(("systemctl", verb, "--") + names, limit=_QUICK)

    def bring(self, verb: str, name: str) -> None:
        """Start or restart a unit and wait until it is there; raises Problem with its state and its journal."""
        deadlines.measure_pace()
        limit = deadlines.stretch(self.timeout, longest=_LONGER)
        answer = commands.run(("systemctl", verb, "--", name), limit=limit)
        if answer.status != 0:
            late = f" within {limit:.3g} s (timeout; of the role: services_timeout)" if answer.status == -1 else ""
            raise Problem(f"The unit {name} did not {verb}{late}{self.explain(name)}")

    def explain(self, name: str) -> str:
        """Describe the end of a unit: its state, its exit status, and the last lines of its journal."""
        state = self.show([name])[name]
        ended = ""
        if state.ExecMainCode == "1":  # CLD_EXITED, sigaction(2)
            ended = f", exit status {state.ExecMainStatus}"
        elif state.ExecMainCode in ("2", "3"):  # CLD_KILLED, CLD_DUMPED
            ended = f", killed by signal {state.ExecMainStatus}"
        result = f", result {state.Result}" if state.Result not in ("", "success") else ""
        lines = " ".join(quote(line, LINE) for line in self._journal(name, state.InvocationID))
        journal = f" The end of its journal: {lines}" if lines else " Its journal is empty."
        return f": it is {state.ActiveState} ({state.SubState}){result}{ended}.{journal}"

    def _journal(self, name: str, invocation: str) -> typing.List[str]:
        """The last lines of this start; of the unit, if this start has written nothing yet."""
        commands.run(("journalctl", "--sync"), limit=_QUICK)
        # journalctl --invocation is of systemd 257; the fields are older than all that we support.
        this_start = (f"_SYSTEMD_INVOCATION_ID={invocation}", "+", f"INVOCATION_ID={invocation}")
        for selection in (this_start if invocation else (), (f"--unit={name}",)):
            command = ("journalctl", "--quiet", "--no-pager", "--output=cat", f"--lines={_JOURNAL_LINES}")
            answer = commands.run(command + selection, limit=_QUICK) if selection else None
            if answer and answer.status == 0 and answer.output.strip():
                return answer.output.decode("utf-8", "replace").splitlines()
        return []


def _failure(arguments: typing.Iterable[str], error: str) -> Problem:
    return Problem(f"'systemctl {' '.join(arguments)}' failed: {quote(error.rstrip('.'), LINE)}.")


def _inputs_of(pid: str) -> str:
    """The inputs in the environment of a running process, or an empty text."""
    if pid in ("", "0"):
        return ""
    try:
        inputs = processes.environment(pid).get(units.INPUTS, "")
    except (FileNotFoundError, NotADirectoryError, ProcessLookupError):  # it has ended since
        return ""
    return inputs.encode("utf-8", "surrogateescape").decode("utf-8", "replace")  # it goes into results


def _is_newer(path: str, start: float) -> bool:
    """True for a file written after this time. A time in the future is of another clock and does not count."""
    try:
        status = os.stat(path)
    except (FileNotFoundError, NotADirectoryError):
        return False
    return stat.S_ISREG(status.st_mode) and start + _SOON < status.st_mtime <= time.time()


# The folders of a unit


def state_directories(properties: systemd.Properties) -> typing.Tuple[typing.List[str], typing.List[str]]:
    """The folders that systemd makes for a unit with these properties, and the parents it may make for them; pure.

    With DynamicUser= the folder is below `private`, with a symbolic link to it at its usual place.
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
    """Remove folders with all they hold, and symbolic links to them; missing ones are no error. Raises OSError."""
    for path in paths:
        if os.path.islink(path):
            atomic.remove(path)
        elif os.path.isdir(path):
            shutil.rmtree(path)


def remove_parents(paths: typing.Iterable[str]) -> None:
    """Remove those of these folders that are empty, innermost first. Raises OSError."""
    for path in sorted(paths, reverse=True):
        atomic.remove_folder_if_empty(path)
