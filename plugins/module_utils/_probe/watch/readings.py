# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause
"""The readings of a watch on its computer, each few seconds: all parts that cost little.

Each reader returns {(kind, name): value}. Two commands are run, `ip` and `systemctl`; everything else is a file of the
kernel, or a connection that is closed at once. A value that cannot be read is a value, too.
"""

import hashlib
import time
import typing

from ..._base.commands import text
from ..._base.deadlines import call_all
from ..._contract.outcomes import Outcome
from ..._machine import network, systemd
from ..._machine.outcomes import connect
from ..._machine.ports import address_of
from ..multicast.memberships import igmp_memberships

CONNECT = 2.0  # seconds that a TCP port has to open
STEP = 0.1  # seconds by which the clock may differ from the time that has passed
CLOCK_TRIES = 20
MOST_BYTES = 1 << 20  # of a file

Params = typing.Dict[str, typing.Any]
Values = typing.Dict[typing.Tuple[str, str], str]


def read_all(params: Params, before: "LastLook") -> Values:
    """Read all parts that the options of multimaster_watch name."""
    values: Values = {}
    values.update(links(params["addresses"], params["group"]))
    values.update(routes(params["destinations"], text("/proc/net/route")))
    values.update({("setting", name): setting(name) for name in params["settings"]})
    values.update(services([f"multimaster-{name}.service" for name in params["services"]], before))
    values.update(ports(params["masters"]))
    values["hosts", "/etc/hosts"] = _sum("/etc/hosts")
    values["clock", "clock"] = before.clock(*read_clocks())
    return values


def read_clocks() -> typing.Tuple[float, float]:
    """Read both clocks of one moment: if this process was held up between the two, a busy machine is no step of the clock."""
    for _try in range(CLOCK_TRIES):
        began, now = time.monotonic(), time.time()
        if time.monotonic() - began < STEP / 2:
            break
    return began, now


def links(addresses: typing.Sequence[str], group: str) -> Values:
    """Read the interfaces of the planned addresses: link, address, and membership of the group."""
    values: Values = {}
    try:
        found = network.interfaces()
    except OSError as problem:
        return {("address", address): str(problem) for address in addresses}
    members = {entry["interface"] for entry in igmp_memberships(text("/proc/net/igmp")) if entry["group"] == group}
    for address in addresses:
        here = [item for item in found if address in {entry.address for entry in item.addresses}]
        values["address", address] = here[0].name if here else "on no interface"
        if here:
            values["link", here[0].name] = text(f"/sys/class/net/{here[0].name}/operstate").strip() or "gone"
            values["membership", here[0].name] = "member" if here[0].name in members else "no member"
    return values


def routes(destinations: typing.Sequence[str], table: str) -> Values:
    """Read the gateways of destinations in the content of /proc/net/route (proc(5))."""
    gateways: typing.Dict[str, typing.List[str]] = {}
    for line in table.splitlines()[1:]:
        words = line.split()
        if len(words) > 7:
            network_, gateway = address_of(words[1]), address_of(words[2])
            prefix = bin(int(words[7], 16)).count("1")
            name = "default" if prefix == 0 else f"{network_}/{prefix}"
            gateways.setdefault(name, []).append(gateway)
    return {("route", name): ", ".join(sorted(gateways.get(name, []))) or "no route" for name in destinations}


def setting(name: str) -> str:
    """Read a kernel setting by its name, such as net.ipv4.ip_forward or net/ipv4/conf/eth0.1/rp_filter."""
    path = name if "/" in name else name.replace(".", "/")
    return text("/proc/sys/" + path).strip() or "not there"


def services(units: typing.Sequence[str], before: "LastLook") -> Values:
    """Read the state of units, and whether they were started again."""
    return {
        ("service", unit): before.service(unit, seen.get("ActiveState", ""), seen.get("MainPID", ""))
        for unit, seen in zip(units, systemd.states(units, ("ActiveState", "MainPID")))
        if seen  # a busy systemd is no loss
    }


def ports(masters: typing.Sequence[Params]) -> Values:
    """Open the TCP port of the discovery node of each master, and close it again."""
    found = call_all(_open_port, masters, 2 * CONNECT + 1, lambda master: "no answer")
    return {("port", str(master["computer"])): value for master, value in zip(masters, found)}


def _open_port(master: Params) -> str:
    place = master["address"], int(master["rpc_port"])
    answer = connect(*place, CONNECT)
    if answer.outcome != Outcome.OPEN:  # one lost packet is no loss
        answer = connect(*place, CONNECT)
    return answer.words


class LastLook:
    """The last look at things that happen in a moment: a step of the clock, a service that is started again."""

    def __init__(self, now: float, wall: float) -> None:
        self._ahead = wall - now
        self._processes: typing.Dict[str, str] = {}
        self._states: typing.Dict[str, str] = {}

    def clock(self, now: float, wall: float) -> str:
        """Return True if the clock was stepped since the last look, against the time that has passed."""
        step, self._ahead = wall - now - self._ahead, wall - now
        return f"stepped by {step:+.1f} s" if abs(step) > STEP else "steady"

    def service(self, unit: str, state: str, process: str) -> str:
        """Return True if a unit is active, or was started again since the last look."""
        last, self._states[unit] = self._states.get(unit), state
        if state == "deactivating" and state != last:
            return "active"  # it was asked to stop: the next look shows if it has ended, or that it was started again
        if state != "active":
            return state or "not there"
        before, self._processes[unit] = self._processes.get(unit, process), process
        return "active" if before == process else "started again"


def _sum(path: str) -> str:
    try:
        with open(path, "rb") as stream:
            return hashlib.sha256(stream.read(MOST_BYTES)).hexdigest()[:12]
    except OSError as problem:
        return problem.strerror or "cannot be read"
