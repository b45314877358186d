# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The services of the collection on this computer: their state, and the environment of their processes."""

import glob
import itertools
import re
import time
import typing

from ..._base import commands, processes
from ..._base.regular_files import read_regular
from ..._machine import systemd, unit_ends

_MOST = 65536  # bytes of a file of systemd, or of one with variables
_MOST_FILES = 20  # with variables, which a drop-in file names
_SETTING = re.compile(r"\s*([A-Za-z]+)\s*=(.*)", re.DOTALL)
_PREFIXES = "-@:+!|"  # of the path of a command (systemd.service(5))
_MOST_PROCESSES = 32  # of a service
_PROPERTIES = (
    "LoadState",
    "ActiveState",
    "SubState",
    "NRestarts",
    "MainPID",
    "EnvironmentFiles",
    "FragmentPath",
    "DropInPaths",
    "StateChangeTimestamp",
    "StatusText",
    "ActiveEnterTimestampMonotonic",
    "ControlGroup",
    "Result",
)
_REFUSED = 50  # names that a node refuses, which are reported
_WORD = r'("[^"]*"|[^\s"(),]+)'  # as quote() writes it
_MORE = re.compile(r"(?:^|, )and [0-9]+ more$")
# An entry of rosfleet_multimaster/sync/core/report.py: name, kind, the value there, its master, and the value here or the reason of the refusal.
# It begins at the beginning of a word: from each letter of a long one, it would read to the end of it again.
_REFUSAL = re.compile(rf"(?<![^\s\"(),]){_WORD}(?: \(([a-z]{{1,20}}) {_WORD} of {_WORD}: {_WORD}\))?(?:, |$)")


Settings = typing.List[typing.Tuple[str, str]]  # name and value, in the order of the file


def services(names: typing.List[str], variables: typing.Dict[str, str]) -> typing.List[typing.Dict[str, typing.Any]]:
    """Look at services of the collection: their state, and the variables that differ from the environment file.

    Raises OSError if systemd does not answer: that says nothing of any service.
    """
    found = []
    units = [f"multimaster-{name}.service" for name in names]
    states = _read_states(units)
    known = _find_ends(units, states)
    for name, unit, seen in zip(names, units, states):
        pid = seen.get("MainPID", "0")
        refused, refusals = read_refusals(seen.get("StatusText", ""))
        entry: typing.Dict[str, typing.Any] = {
            "name": name,
            "unit": unit,
            "load_state": seen.get("LoadState", ""),
            "active_state": seen.get("ActiveState", ""),
            "sub_state": seen.get("SubState", ""),
            "restarts": int(seen.get("NRestarts") or 0),
            "stopped": processes.is_stopped(pid),
            "differing": [],
            "drop_ins": [],
            "command_drop_ins": [],
            "since": seen.get("StateChangeTimestamp", ""),
            "refused": refused,
            "refusals": refusals,
            "age_s": find_age(seen.get("ActiveEnterTimestampMonotonic", "")),
            "result": known[unit].result,
            "status": known[unit].status,
        }
        entry["open_files"], entry["most_files"] = count_files(seen.get("ControlGroup", ""))
        if pid != "0" and seen.get("EnvironmentFiles"):  # a service without the file needs no ROS
            entry["differing"] = _read_changed(pid, variables)
        paths = seen.get("DropInPaths", "").split()
        entry["drop_ins"] = list_with_variables(paths, entry["differing"] or ())
        entry["command_drop_ins"] = list_with_commands(paths, seen.get("FragmentPath", ""))
        found.append(entry)
    return found


def _read_states(units: typing.List[str]) -> typing.List[systemd.Properties]:
    """Ask systemd for the state of units. Raises OSError without an answer."""
    answer = systemd.show(units, _PROPERTIES) if units else systemd.UnitProperties([])
    if len(answer.units) != len(units):
        raise OSError(f"systemd reported nothing about the services ({answer.error or 'without a word'})")
    return answer.units


def _find_ends(units: typing.List[str], states: typing.List[systemd.Properties]) -> typing.Dict[str, unit_ends.UnitEnd]:
    """Find how each unit ended last: by the journal, else by its state; an empty result for a unit that still runs."""
    failed = {unit: seen.get("Result", "") for unit, seen in zip(units, states) if _has_failed(seen)}
    ended = [unit for unit, seen in zip(units, states) if seen.get("NRestarts", "0") != "0" or unit in failed]
    known = unit_ends.find_ends(ended) if ended else {}
    return {unit: known.get(unit, unit_ends.UnitEnd(failed.get(unit, ""))) for unit in units}


def _read_changed(pid: str, wanted: typing.Dict[str, str]) -> typing.Optional[typing.List[str]]:
    """Name the wanted variables that a process lacks; None if it ended since, or is not ours to look at."""
    try:
        return find_changed(processes.environment(pid), wanted)
    except OSError:
        return None


def _has_failed(seen: systemd.Properties) -> bool:
    return seen.get("ActiveState", "") in ("failed", "activating")


def read_refusals(status: str) -> typing.Tuple[typing.List[str], typing.List[typing.Dict[str, str]]]:
    """List the names that master_sync refuses, and why, as it reports them to systemd; a text that has another form than a name is in quotes.

    A master_sync of an older release reports only the names.
    """
    listed = status.rpartition("; refused: ")[2] if "; refused: " in status else ""
    found = _REFUSAL.findall(_MORE.sub("", listed.partition("; not all of ")[0]))[:_REFUSED]
    rows = [dict(zip(("name", "kind", "there", "master", "here"), map(_unquote, row))) for row in found if row[1]]
    return [row[0] for row in found], rows


def _unquote(text: str) -> str:
    return text[1:-1] if text.startswith('"') else text


def find_age(entered: str) -> typing.Optional[float]:
    """Return the seconds since a service was started last, by the clock since boot, which is never stepped; `entered` is systemd's time in microseconds."""
    return round(time.monotonic() - int(entered) / 1e6, 1) if entered.isdigit() and int(entered) else None


def count_files(
    group: str, cgroups: str = "/sys/fs/cgroup"
) -> typing.Tuple[typing.Optional[int], typing.Optional[int]]:
    """Count the open files of the process of a control group that has the fewest left, and return its limit; two None if no process is seen."""
    lists = [commands.text(f"{cgroups}{version}{group}/cgroup.procs") for version in ("", "/systemd")] if group else []
    pids = " ".join(lists).split()[:_MOST_PROCESSES]
    counted = [files for files in map(processes.count_files, pids) if files]
    return min(counted, key=lambda files: files[1] - files[0], default=(None, None))


def find_changed(process: typing.Dict[str, str], wanted: typing.Dict[str, str]) -> typing.List[str]:
    """Name the wanted variables that have another value, or are missing, in the environment of a process."""
    return sorted(name for name, value in wanted.items() if process.get(name) != value)


# Drop-in files


def list_with_variables(paths: typing.Iterable[str], names: typing.Iterable[str]) -> typing.List[str]:
    """List the drop-in files that decide one of these variables: by a value, a file of values, the command, or by taking it away."""
    wanted = "|".join(map(re.escape, names))
    return [path for path in paths if wanted and any(_decides(*one, wanted) for one in _read_settings(path))]


def list_with_commands(paths: typing.Iterable[str], unit_file: str) -> typing.List[str]:
    """List the drop-in files with another command than that of the unit's own file; one that only runs it by nice(1) or taskset(1) has the same."""
    own = [_plain(value) for value in _commands(unit_file)]
    return [path for path in paths if any(not any(value.endswith(one) for one in own) for value in _commands(path))]


def _commands(path: str) -> typing.List[str]:
    return [value for name, value in _read_settings(path) if name == "ExecStart" and value]


def _plain(command: str) -> str:
    return command.lstrip(_PREFIXES)


def _read_settings(path: str) -> Settings:
    """Read the settings of a unit's file (systemd.syntax(7)); none if it cannot be read. systemctl writes a blank in a path otherwise, so it is not found."""
    settings: Settings = []
    for line in re.sub(r"\\\n", " ", _read_text(path)).split("\n"):
        found = None if line.lstrip().startswith(("#", ";")) else _SETTING.match(line)
        settings += [(found.group(1), found.group(2).strip())] if found else []
    return settings


def _read_text(path: str) -> str:
    try:
        return read_regular(path, _MOST).decode("utf-8", "replace")
    except OSError:
        return ""


def _decides(name: str, value: str, wanted: str) -> bool:
    """Return True if a setting decides one of the variables (names, as a pattern)."""
    if name == "EnvironmentFile":  # an empty one takes all files away, that of the collection among them
        return not value or _file_has(value.lstrip("-"), wanted)
    if name == "UnsetEnvironment":
        return bool(re.search(rf"(?:^|[\s\"'])(?:{wanted})(?=[\s\"'=]|$)", value))
    return name in ("Environment", "ExecStart") and bool(re.search(rf"(?:^|[\s\"'])(?:{wanted})=", value))


def _file_has(path: str, wanted: str) -> bool:
    if "%" in path:  # only systemd knows which file it is
        return True
    files = itertools.islice(glob.iglob(path), _MOST_FILES)
    return any(re.search(rf"^[ \t]*(?:{wanted})[ \t]*=", _read_text(file), re.MULTILINE) for file in files)
