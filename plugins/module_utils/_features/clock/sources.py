# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The sources of time of this computer, as its time service reports them."""

import ipaddress
import re
import time
import typing

from ..._base.commands import run

_PAUSE = 1.0  # seconds
LAST = 0b1111  # the bits of the last four requests
MOST = 32  # sources that are listed
_SECONDS = re.compile(r"[+-]?\d{1,12}(?:\.\d{1,12})?(?:e[+-]?\d{1,2})?")

Source = typing.Dict[str, typing.Any]
Row = typing.Tuple[str, bool, bool, typing.Optional[float]]  # address, selected, reachable, offset in s


class TimeService(typing.NamedTuple):
    """A time service: its name, the command that lists its sources, and the function that reads the answer."""

    name: str
    command: typing.Tuple[str, ...]
    read: typing.Callable[[str], typing.Optional[typing.List[Row]]]  # None: it is not there


def list_sources(rows: typing.Iterable[Row]) -> typing.Iterator[Source]:
    """Yield the sources as plain data, without those that have no address, as a radio clock."""
    for address, selected, reachable, offset in rows:
        try:
            plain = str(ipaddress.ip_address(address))
        except ValueError:
            continue
        yield {"address": plain, "selected": selected, "reachable": reachable, "offset_s": offset}


def read_number(text: str) -> typing.Optional[float]:
    """Read a number of seconds, or None."""
    return float(text) if _SECONDS.fullmatch(text) else None


def has_answered(register: str) -> bool:
    """Return True if one of the last four requests was answered, by the register of the last eight, in octal digits."""
    return bool(re.fullmatch(r"[0-7]{1,3}", register)) and bool(int(register, 8) & LAST)


def read_chrony(output: str) -> typing.List[Row]:
    """Read the sources and the tracking of chronyc(1).

    A source: mode, state, address, stratum, poll, reach, last answer, offset of the corrected clock, ... The tracking: id, address,
    stratum, time, the pending correction of the system's clock, ... That is added: chronyd corrects it slowly, or never (-x).
    """
    rows = [line.split(",") for line in output.splitlines()]
    rest = next((read_number(row[4]) for row in rows if len(row) == 14), None) or 0.0
    found = []
    for row in rows:
        if len(row) == 10:
            offset = read_number(row[7])
            total = None if offset is None else round(offset - rest, 9)
            found.append((row[2], row[1] in "*+", has_answered(row[5]), total))
    return found


def read_timesyncd(output: str) -> typing.Optional[typing.List[Row]]:
    """Read `timedatectl show-timesync` (timedatectl(1)). Its one source counts once it has answered."""
    values = dict(line.partition("=")[::2] for line in output.splitlines())
    if not values:  # there is no such service
        return None
    answered = bool(values.get("NTPMessage", ""))
    return [(values.get("ServerAddress", ""), answered, answered, None)]


def read_ntpd(output: str) -> typing.List[Row]:
    """Read `ntpq -pn` (ntpq(8)): a mark and an address, refid, stratum, type, when, poll, reach, delay, offset in ms, jitter."""
    found = []
    for line in output.splitlines():
        words = line[1:].split()
        if len(words) == 10 and words[6].isdigit():
            offset = read_number(words[8])
            seconds = None if offset is None else offset / 1000
            found.append((words[0], line[0] in "*o+", has_answered(words[6]), seconds))
    return found


SERVICES = (
    TimeService("chrony", ("chronyc", "-n", "-c", "-m", "sources", "tracking"), read_chrony),
    TimeService("systemd-timesyncd", ("timedatectl", "show-timesync"), read_timesyncd),
    TimeService("ntpd", ("ntpq", "-pn"), read_ntpd),
)


def time_sources(patience: float = 0.0) -> typing.Dict[str, typing.Any]:
    """Ask the first time service that answers, or say that no service answers.

    One that has just been started has selected no source yet: it is asked again for `patience` seconds.
    """
    until = time.monotonic() + patience
    while True:
        found = _ask()
        answered = [entry for entry in found["sources"] if entry["reachable"]]
        waits = answered and not any(entry["selected"] for entry in answered)
        if not waits or time.monotonic() >= until:
            return found
        time.sleep(_PAUSE)


def _ask() -> typing.Dict[str, typing.Any]:
    """Ask each service in turn, until one answers."""
    for service in SERVICES:
        answer = run(service.command)
        found = service.read(answer.text) if answer.status == 0 else None
        if found is not None:
            return {"answers": True, "service": service.name, "sources": list(list_sources(found))[:MOST]}
    return {"answers": False, "service": "", "sources": []}
