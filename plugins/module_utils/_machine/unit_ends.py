# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The last ends of the collection's services, as systemd and multimaster-watchdog.service have written them to the journal."""

import json
import re
import typing

from .._base import commands

WATCHDOG = "multimaster-watchdog.service"
# The messages of systemd about a unit: its catalog of messages, /usr/lib/systemd/catalog.
_FAILED, _SUCCEEDED = "d9b373ed55a64feb8242e02dbe79a49c", "7ad2d189f7e94e70a38c781354912448"
_EXITED = "98e322203f7a4ed290d09fe03c09fe15"
_LINES = 200  # of all services, the last ones
_LIMIT = 20.0  # seconds: a journal of gigabytes on a slow card
_SOON = 60e6  # microseconds in which a service ends that the watchdog has asked to
_FIELDS = "MESSAGE,MESSAGE_ID,UNIT,UNIT_RESULT,EXIT_STATUS,_SYSTEMD_UNIT"


class UnitEnd(typing.NamedTuple):
    """The end of a service: the Result of systemd, such as "oom-kill", and the status or the number of the signal."""

    result: str = ""
    status: typing.Optional[int] = None


def find_ends(units: typing.Sequence[str]) -> typing.Dict[str, UnitEnd]:
    """Find the last end of each unit since the boot of this computer."""
    return read_ends(commands.run(list_words(units), limit=_LIMIT).text.splitlines(), units)


def list_words(units: typing.Sequence[str]) -> typing.List[str]:
    """List the words of the command that asks the journal."""
    named = ["UNIT=" + unit for unit in units]
    command = ["journalctl", "--boot", "--quiet", "--no-pager", "--reverse", "--output=json"]
    # A field that begins with an underscore is the kernel's word: anybody may write the others.
    kinds = ["MESSAGE_ID=" + kind for kind in (_FAILED, _SUCCEEDED, _EXITED)]
    wanted = ["_PID=1"] + kinds + named + ["+", "_SYSTEMD_UNIT=" + WATCHDOG]
    return command + ["--lines=%d" % _LINES, "--output-fields=" + _FIELDS] + wanted


def read_ends(lines: typing.Sequence[str], units: typing.Sequence[str]) -> typing.Dict[str, UnitEnd]:
    """Read the last end of each unit from lines of the journal, the newest first."""
    ends = {}  # type: typing.Dict[str, UnitEnd]
    times = {}  # type: typing.Dict[str, int]
    exited = set()  # type: typing.Set[str]
    for line in lines:
        try:
            entry = json.loads(line)
            at = int(entry["__REALTIME_TIMESTAMP"])
        except (ValueError, KeyError, TypeError):
            continue
        fields = {name: text for name, text in entry.items() if isinstance(text, str)}
        unit, kind = fields.get("UNIT", ""), fields.get("MESSAGE_ID", "")
        if fields.get("_SYSTEMD_UNIT") == WATCHDOG:
            judged = fields.get("MESSAGE", "").partition(" hangs, and is ended")[0]
            if judged in ends and 0 <= times[judged] - at < _SOON:
                ends[judged] = ends[judged]._replace(result="watchdog")
        elif unit in units and kind in (_FAILED, _SUCCEEDED) and unit not in ends:
            ends[unit], times[unit] = UnitEnd("success" if kind == _SUCCEEDED else fields.get("UNIT_RESULT", "")), at
        elif unit in ends and kind == _EXITED and unit not in exited:
            ends[unit] = ends[unit]._replace(status=_read_status(fields.get("EXIT_STATUS", "")))
            exited.add(unit)
    return ends


def _read_status(text: str) -> typing.Optional[int]:
    return int(text) if re.match(r"[0-9]{1,3}\Z", text) else None
