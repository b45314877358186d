# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The time services of this machine: the user-managed ones, and the state of chrony. Nothing is changed."""

import glob
import os
import re
import time
import typing

from ..._base.commands import text
from ..._base.plain_text import LINE, plain
from ..._machine import systemd
from ..._machine.system import may_give
from ..._probe.facts.part import FactPart
from .sources import time_sources

UNIT = "chrony.service"
CHRONYD = "/usr/sbin/chronyd"
# The collection's files for chrony.
OURS = ("/etc/chrony/rosfleet-multimaster.conf", f"/etc/systemd/system/{UNIT}.d/rosfleet-multimaster.conf")
_CAP_SYS_TIME = 25  # capabilities(7)
_STOCK = "/etc/chrony/chrony.conf", "/usr/share/chrony/chrony.conf"  # in use, and as the package has it
_MOST = 20  # configurations that are listed


class TimeServiceFiles(typing.NamedTuple):
    """A time service: the files with its configuration, and the lines there that name a source of time."""

    service: str
    files: typing.Tuple[str, ...]
    line: "typing.Pattern[str]"


_SERVERS = re.compile(r"\s*(?:server|servers|pool|peer|refclock|local|initstepslew)\b.*", re.IGNORECASE)
# The package's own files of timesyncd (systemd's in /usr/lib, and lines that are commented out) are no user's configuration. Who has
# installed ntpd or openntpd has chosen it, with whatever servers.
_CHRONY = TimeServiceFiles(
    UNIT, ("/etc/chrony/conf.d/*.conf", "/etc/chrony/sources.d/*.sources"), re.compile(r"\s*[^\s#!;%].*")
)
DIALECTS = (
    _CHRONY,
    # Another configuration than that of the package, which the collection's would replace.
    TimeServiceFiles(UNIT, ("/etc/default/chrony",), re.compile(r"\s*DAEMON_OPTS\s*=.*[\s\"']-f.*")),
    TimeServiceFiles(
        UNIT,
        (f"/etc/systemd/system/{UNIT}.d/*.conf", f"/run/systemd/system/{UNIT}.d/*.conf"),
        re.compile(r"\s*ExecStart\s*=\s*\S.*"),
    ),
    TimeServiceFiles(
        "systemd-timesyncd.service",
        (
            "/etc/systemd/timesyncd.conf",
            "/etc/systemd/timesyncd.conf.d/*.conf",
            "/run/systemd/timesyncd.conf.d/*.conf",
            "/usr/local/lib/systemd/timesyncd.conf.d/*.conf",
        ),
        re.compile(r"\s*NTP\s*=\s*\S.*"),
    ),
    TimeServiceFiles("ntpsec.service", ("/etc/ntpsec/ntp.conf",), _SERVERS),
    TimeServiceFiles("ntp.service", ("/etc/ntp.conf",), _SERVERS),
    TimeServiceFiles("openntpd.service", ("/etc/openntpd/ntpd.conf",), _SERVERS),
)
# Those that count with the configuration of their package, too.
_CHOSEN = {"ntpsec.service", "ntp.service", "openntpd.service"}
_PROPERTIES = ("Id", "LoadState", "UnitFileState", "ActiveState", "StateChangeTimestampMonotonic")


def clock(root: str = "/") -> typing.Dict[str, typing.Any]:
    """Read who may set the clock, whether chrony is there, the user-managed time services, and their sources."""
    services = list(dict.fromkeys(dialect.service for dialect in DIALECTS))
    states = systemd.states(services, _PROPERTIES)
    loaded = {service: state for service, state in zip(services, states) if state.get("LoadState") == "loaded"}
    return {
        "chronyd": CHRONYD if os.access(os.path.join(root, CHRONYD[1:]), os.X_OK) else "",
        "enabled": loaded.get(UNIT, {}).get("UnitFileState") == "enabled",
        "settable": may_give(text(os.path.join(root, "proc/1/status")), _CAP_SYS_TIME),
        "others": list(_others(root, set(loaded)))[:_MOST],
        "restart_due": UNIT in loaded and _is_older(root, loaded[UNIT]),
        "sources": time_sources()["sources"],
    }


def _others(root: str, loaded: typing.Collection[str]) -> typing.Iterator[typing.Dict[str, str]]:
    """Yield the foreign configurations of the services that are there."""
    ours = os.path.exists(os.path.join(root, OURS[0][1:]))
    for dialect in DIALECTS:
        # While chrony reads our file, its own file counts only at the source, which includes it.
        if dialect.service not in loaded or (dialect.service == UNIT and ours):
            continue
        lines = list(_lines(root, dialect))
        if not lines and dialect.service in _CHOSEN:
            lines = [{"file": dialect.files[0], "line": "as its package has it"}]
        for entry in lines:
            yield dict(entry, service=dialect.service)


def _lines(root: str, dialect: TimeServiceFiles) -> typing.Iterator[typing.Dict[str, str]]:
    """Yield the lines of a service that name a source of time; those of chrony's own file, if a person has edited it."""
    paths = [path for pattern in dialect.files for path in sorted(glob.glob(os.path.join(root, pattern[1:])))]
    if dialect is _CHRONY:
        used, packaged = (text(os.path.join(root, path[1:])) for path in _STOCK)
        paths += [os.path.join(root, _STOCK[0][1:])] if used != packaged else []
    for path in paths:
        named = [line.strip() for line in text(path).splitlines() if dialect.line.fullmatch(line)]
        edited = path.endswith(_STOCK[0][1:])
        if named or edited:
            place = plain("/" + os.path.relpath(path, root), LINE)
            yield {"file": place, "line": plain(named[0], LINE) if named else "not as its package has it"}


def _is_older(root: str, unit: systemd.Properties) -> bool:
    """Return True if chrony runs since before our present files, which an interrupted run has written, or does not run with them."""
    paths = [os.path.join(root, path[1:]) for path in OURS]
    there = [path for path in paths if os.path.exists(path)]
    if unit.get("ActiveState") != "active":
        return there == paths
    return any(systemd.find_change(unit) < os.stat(path).st_mtime <= time.time() for path in there)


FACT = FactPart("clock", clock, 10)
