# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Faults of the catalogue (tests/faults) for any fleet: its computers play those of the catalogue's inventory. Pure.

The catalogue has three robots: kobuki is one computer on the common network, tibi and dabo have a network of their own behind a
gateway that runs the roscore, and another computer each.
"""

from __future__ import annotations

import ipaddress
import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from machines.podman import ROOT, LabError

sys.path.append(str(ROOT / "tests" / "faults"))

import judge  # noqa: E402
from catalogue import FOLDER, LAB, Fault, Step, read  # noqa: E402

PARTS = ("kobuki-pc", "tibi-gate", "tibi-arm", "dabo-gate", "dabo-arm")
PLACEHOLDER = re.compile(r"<([a-z][a-z-]*)(\.common)?>(/24)?")
# The catalogue's inventory as its commands know it: text -> (robot, what).
KNOWN = {
    "192.168.11.0/24": ("tibi", "network"),
    "192.168.12.0/24": ("dabo", "network"),
    "192.168.11.77": ("tibi", "free"),
    "192.168.12.1": ("dabo", "free"),
    "192.168.1.77": ("", "free"),
    "192.168.1.88": ("", "free"),
    "192.168.1.250": ("", "free"),
    "192.168.66.9": ("", "free"),
    "11611": ("kobuki", "rpc_port"),
}
LITERAL = re.compile("|".join(rf"(?<![\d.]){re.escape(text)}(?![\d.])" for text in KNOWN) + r"|(?<=\s)dabo-gate(?=\s)")


class _Placeholders(dict[str, str]):
    """Placeholders that stay as they are."""

    def __contains__(self, name: object) -> bool:
        return True

    def __missing__(self, name: str) -> str:
        return f"<{name}>"


@dataclass(frozen=True)
class Cast:
    """The computers and robots that play those of the catalogue, and the fleet's own values."""

    computers: Mapping[str, str]  # of the catalogue -> of the fleet
    robots: Mapping[str, str]
    variables: Mapping[str, Mapping[str, Any]]  # of the fleet's computers

    def translate(self, text: str) -> str:
        """A command of the catalogue in the words of this fleet."""
        return re.sub(f"{PLACEHOLDER.pattern}|{LITERAL.pattern}", self._value, text)

    def _value(self, found: re.Match[str]) -> str:
        name, common, prefix = found.groups()
        if found[0] in KNOWN:
            return self._translate_literal(*KNOWN[found[0]])
        if name in ("group", "port"):
            own = next(iter(self.variables.values()))
            default = {"group": "226.0.0.0", "port": "11511"}[name]
            return str(own.get(f"multimaster_multicast_{name}") or default)
        host = self.computers[name or found[0]]
        if not name:
            return host
        own = self.variables[host]
        gateway = own.get("multimaster_gateway") == host
        address = own["multimaster_common_address"] if common and gateway else own["multimaster_address"]
        return address + (f"/{_network(own, common=bool(common)).prefixlen}" if prefix else "")

    def _translate_literal(self, robot: str, what: str) -> str:
        own = self.variables[self.computers[f"{robot}-pc" if robot == "kobuki" else f"{robot}-gate"]] if robot else {}
        if what == "network":
            return str(_network(own))
        if what == "rpc_port":
            return str(own.get("multimaster_rpc_port") or int(own.get("multimaster_roscore_port") or 11311) + 300)
        return self._free(_network(own or next(iter(self.variables.values())), common=not robot))

    def _free(self, network: ipaddress.IPv4Network) -> str:
        """An address that no computer has."""
        names = ("multimaster_address", "multimaster_common_address", "multimaster_router", "multimaster_gateway")
        taken = {str(own.get(name)) for own in self.variables.values() for name in names}
        first, last = int(network.network_address), int(network.broadcast_address)
        return next(
            str(found) for found in map(ipaddress.ip_address, range(last - 1, first, -1)) if str(found) not in taken
        )


def _network(own: Mapping[str, Any], *, common: bool = False) -> ipaddress.IPv4Network:
    text = own.get("multimaster_network") if not common else None
    return ipaddress.IPv4Network(text or own["multimaster_common_network"])


def cast_of(robots: Mapping[str, Sequence[str]], variables: Mapping[str, Mapping[str, Any]]) -> Cast:
    """Choose the computers and robots that play those of the catalogue. A part is missing if the fleet has no computer or robot for it."""
    free = {robot: variables[hosts[0]] for robot, hosts in robots.items() if hosts}
    computers: dict[str, str] = {}
    names: dict[str, str] = {}
    for part in ("tibi", "dabo"):
        gated = [robot for robot, own in free.items() if own.get("multimaster_gateway") in robots[robot]]
        # A gateway that runs the roscore, as there; a robot of several computers.
        gated.sort(
            key=lambda robot: (
                len(robots[robot]) < 2,
                free[robot]["multimaster_gateway"] != _master(robots[robot], free[robot]),
            )
        )
        if gated:
            own, hosts = free.pop(gated[0]), robots[gated[0]]
            names[part], computers[f"{part}-gate"] = gated[0], own["multimaster_gateway"]
            inner = [host for host in hosts if host not in (own["multimaster_gateway"], own.get("multimaster_master"))]
            if inner:
                computers[f"{part}-arm"] = inner[0]
    plain = sorted(free, key=lambda robot: bool(free[robot].get("multimaster_network")))
    if plain:
        names["kobuki"], computers["kobuki-pc"] = plain[0], _master(robots[plain[0]], free[plain[0]])
    return Cast(computers, names, {host: variables[host] for hosts in robots.values() for host in hosts})


def _master(hosts: Sequence[str], own: Mapping[str, Any]) -> str:
    master = own.get("multimaster_master") or hosts[0]
    return str(master if master in hosts else own.get("multimaster_companion") or hosts[0])  # a sealed one is no host


def cast_faults(names: Iterable[str], cast: Cast, folder: Path = FOLDER) -> list[Fault]:
    """Read faults for this fleet. Raises LabError with a sentence for each that cannot be made."""
    known = [path.stem for path in sorted(folder.glob("*.yml"))]
    found, problems = [], []
    for name in names:
        if name not in known:
            problems.append(
                f"FAULTS has {name}, which is no fault of the catalogue; expected some of {', '.join(known)}."
            )
            continue
        fault = read(folder / f"{name}.yml", _Placeholders())
        missing = sorted(_parts(fault) - {*cast.computers, *cast.robots})
        if any(step.where == LAB for step in (*fault.inject, *fault.undo)):
            problems.append(
                f"FAULTS has {name}, which is made between the computers of the catalogue's own lab; leave it out."
            )
        elif missing:
            problems.append(
                f"FAULTS has {name}, which needs {' and '.join(map(_describe_part, missing))}, and the fleet has none that is free; leave it out."
            )
        else:
            found.append(_recast(fault, cast))
    if problems:
        raise LabError(" ".join(problems))
    return found


def _describe_part(part: str) -> str:
    if part.startswith("kobuki"):
        return "a robot besides those with a gateway"
    return (
        f"{'an inner computer of ' if part.endswith('-arm') else ''}a robot with a network of its own behind a gateway"
    )


def _parts(fault: Fault) -> set[str]:
    """The computers and robots of the catalogue that a fault is about."""

    def list_places() -> Iterator[str]:
        for step in (*fault.inject, *fault.settled, *fault.undo):
            yield step.where
            yield from (part for part in PARTS if part in step.what)
            for literal in LITERAL.findall(step.what):
                robot = KNOWN.get(literal, ("", ""))[0]
                yield {"": "", "kobuki": "kobuki-pc"}.get(robot, f"{robot}-gate")
        yield from (place for place in fault.at if place in (*PARTS, "kobuki", "tibi", "dabo"))

    return set(list_places()) - {"", LAB}


def _recast(fault: Fault, cast: Cast) -> Fault:
    def steps(of: Sequence[Step]) -> tuple[Step, ...]:
        return tuple(Step(cast.computers[step.where], cast.translate(step.what)) for step in of)

    places = {**cast.computers, **cast.robots}
    return replace(
        fault,
        inject=steps(fault.inject),
        settled=steps(fault.settled),
        undo=steps(fault.undo),
        at=tuple(places.get(place, place) for place in fault.at),
    )


def judge_report(fault: Fault, document: Mapping[str, Any]) -> tuple[bool, str]:
    """Return if a report names the component of a fault first, and the one that it names."""
    named = judge.named(document)
    verdict = judge.verdict(fault, named)
    return verdict == judge.FIRST, f"{verdict}: {named.text}"
