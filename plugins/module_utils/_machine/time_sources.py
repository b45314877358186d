# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Whose time this computer follows, as its time service says it."""

import ipaddress
import re
import typing

from .._process.commands import run

LAST = 0b1111  # the bits of the last four requests
MOST = 32  # sources that are told
_SECONDS = re.compile(r"[+-]?\d{1,12}(?:\.\d{1,12})?(?:e[+-]?\d{1,2})?")

Source = typing.Dict[str, typing.Any]


class Service(typing.NamedTuple):
    """A time service: its name, the command that tells its sources, and the function that reads the answer."""

    name: str
    command: typing.Tuple[str, ...]
    read: typing.Callable[[str], typing.Optional[typing.List[Source]]]  # None: it is not there


def make_source(
    address: str, selected: bool, reachable: bool, offset: typing.Optional[float]
) -> typing.Optional[Source]:
    """Return a source as plain data; None for an address that is none, such as the name of a radio clock."""
    try:
        plain = str(ipaddress.ip_address(address))
    except ValueError:
        return None
    return {"address": plain, "selected": selected, "reachable": reachable, "offset_s": offset}


def read_number(text: str) -> typing.Optional[float]:
    """Read a number of seconds, or None."""
    return float(text) if _SECONDS.fullmatch(text) else None


def has_answered(register: str) -> bool:
    """Say if one of the last four requests was answered, by the register of the last eight, in octal digits."""
    return bool(re.fullmatch(r"[0-7]{1,3}", register)) and bool(int(register, 8) & LAST)


def read_chrony(output: str) -> typing.List[Source]:
    """Read `chronyc -n -c sources` (chronyc(1)): mode, state, address, stratum, poll, reach, last answer, offset, ..."""
    lines = [line.split(",") for line in output.splitlines()]
    found = [
        make_source(row[2], row[1] in "*+", has_answered(row[5]), read_number(row[7]))
        for row in lines
        if len(row) >= 10
    ]
    return [entry for entry in found if entry]


def read_timesyncd(output: str) -> typing.Optional[typing.List[Source]]:
    """Read `timedatectl show-timesync` (timedatectl(1)). Its one source counts once it has answered."""
    values = dict(line.partition("=")[::2] for line in output.splitlines())
    if not values:  # there is no such service
        return None
    answered = bool(values.get("NTPMessage", ""))
    found = make_source(values.get("ServerAddress", ""), answered, answered, None)
    return [found] if found else []


def read_ntpd(output: str) -> typing.List[Source]:
    """Read `ntpq -pn` (ntpq(8)): a mark and an address, refid, stratum, type, when, poll, reach, delay, offset in ms, jitter."""
    found = []
    for line in output.splitlines():
        words = line[1:].split()
        if len(words) == 10 and words[6].isdigit():
            offset = read_number(words[8])
            found.append(
                make_source(
                    words[0], line[0] in "*o+", has_answered(words[6]), None if offset is None else offset / 1000
                )
            )
    return [entry for entry in found if entry]


SERVICES = (
    Service("chrony", ("chronyc", "-n", "-c", "sources"), read_chrony),
    Service("systemd-timesyncd", ("timedatectl", "show-timesync"), read_timesyncd),
    Service("ntpd", ("ntpq", "-pn"), read_ntpd),
)


def time_sources() -> typing.Dict[str, typing.Any]:
    """Ask the first time service that answers; or say that none does."""
    for service in SERVICES:
        answer = run(service.command)
        found = service.read(answer.text) if answer.status == 0 else None
        if found is not None:
            return {"answers": True, "service": service.name, "sources": found[:MOST]}
    return {"answers": False, "service": "", "sources": []}
