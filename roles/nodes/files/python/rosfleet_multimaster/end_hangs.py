# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The program that ends services that hang. systemd starts them again.

Each service signals to systemd again and again that it turns. One that is silent is looked at: if it waits for a processor or a
disk, it may go on, however long that takes (edge/process/liveness.py). It must be a process of its own, in a unit of its
own, since who is stopped cannot judge. A judge who gets no processor himself is late, and that is right then.
It runs on the system's Python (`python3 -I`), only on files of root, and without ROS.
"""

import logging
import os
import signal
from contextlib import suppress
from typing import Dict, Mapping, NamedTuple

from .edge.clock import monotonic, sleep
from .edge.journal import plain_streams, say
from .edge.process import children
from .edge.process.liveness import Limits, Silence, read_sample
from .edge.process.systemd import notify

LOOK = 5.0  # seconds between two looks
LATE = 10.0  # seconds without a sign of life after which a service is looked at
GRACE = 10.0  # seconds in which it may write the place at which it hangs
PATIENCE = 60.0  # seconds for systemd to answer
LIMITS = Limits()
PROPERTIES = "Id,ActiveState,MainPID,WatchdogUSec,WatchdogTimestampMonotonic,ActiveEnterTimestampMonotonic"


class Service(NamedTuple):
    """A service that runs: its process, and its last sign of life (seconds of the monotonic clock)."""

    pid: int
    heard: float


def read_services(text: str) -> Dict[str, Service]:
    """The services that run, by unit, in the output of `systemctl show`."""
    services = {}
    for block in text.split("\n\n"):
        unit = dict(line.partition("=")[::2] for line in block.splitlines())
        with suppress(KeyError, ValueError):
            heard = int(unit["WatchdogTimestampMonotonic"]) or int(unit["ActiveEnterTimestampMonotonic"])
            pid = int(unit["MainPID"])
            signals = unit["WatchdogUSec"] not in ("0", "infinity")  # else it was not asked for signs of life
            if unit["ActiveState"] == "active" and signals and pid > 1:
                services[unit["Id"]] = Service(pid, heard / 1e6)
    return services


class Judge:
    """Ends services that hang."""

    def __init__(self, limits: Limits = LIMITS, late: float = LATE, grace: float = GRACE) -> None:
        self._limits, self._late, self._grace = limits, late, grace
        self._silent: Dict[str, Silence] = {}
        self._ended: Dict[str, float] = {}  # unit -> when its process was asked to end

    def look(self, services: Mapping[str, Service]) -> None:
        """Look at the services that run."""
        for unit in [*self._silent]:
            if unit not in services:
                self._forget(unit)
        for unit, service in services.items():
            if monotonic() - service.heard < self._late:
                self._forget(unit)
            else:
                self._look_at(unit, service)

    def _forget(self, unit: str) -> None:
        self._silent.pop(unit, None)
        self._ended.pop(unit, None)

    def _look_at(self, unit: str, service: Service) -> None:
        sample = read_sample(service.pid)
        silence = self._silent.get(unit)
        if sample is None or silence is None or not silence.is_of(sample):
            self._forget(unit)
            if sample is not None:
                self._silent[unit] = Silence(sample)
            return
        silence.add(sample)
        age = monotonic() - service.heard
        reason = silence.find_hang(age, self._limits)
        if unit in self._ended:
            if monotonic() - self._ended[unit] >= self._grace:
                _send(service.pid, signal.SIGKILL)
        elif reason:
            say(f"{unit} hangs, and is ended: no sign of life for {age:.0f} s, and {reason}", logging.ERROR)
            _send(service.pid, signal.SIGABRT)
            _send(service.pid, signal.SIGCONT)
            self._ended[unit] = monotonic()


def _send(pid: int, number: int) -> None:
    with suppress(ProcessLookupError):
        os.kill(pid, number)


def main(*units: str) -> None:
    """Judge these units for ever."""
    plain_streams()
    judge, command = Judge(), ["systemctl", "show", f"--property={PROPERTIES}", "--", *units]
    notify("READY=1", "STATUS=services that hang are ended")
    while True:
        judge.look(read_services(children.output(command, PATIENCE)))
        notify("WATCHDOG=1")
        sleep(LOOK)
