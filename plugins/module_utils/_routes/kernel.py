# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The kernel's routes: what a route is, how `ip` shows it, and the words with which `ip` makes it.

Reading is `ip -json -details route show`; the text of the same command is read where it has no JSON (iproute2 before 4.16).
"""

import ipaddress
import json
import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.commands import run
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.problem import Problem

MAIN = 254  # the table main, linux/rtnetlink.h
DEFAULTS = {4: "0.0.0.0/0", 6: "::/0"}
METRICS = {4: 0, 6: 1024}  # what the kernel takes where none is given; 1024 is IP6_RT_PRIO_USER
PROTOCOL = "static"  # rtnetlink(7): made by the administrator; networkd and NetworkManager give theirs the same
NO_WAY = ("blackhole", "unreachable", "prohibit")

_LIMIT = 30.0  # seconds; a command takes a few thousandths on a machine that is not overloaded

Raw = typing.Dict[str, typing.Any]  # one route as `ip -json -details route show` has it


Key = typing.Tuple[int, str, int, int]


class Route(typing.NamedTuple):
    """A route that can be asked for. Every field has its value, none is left to a default of the kernel or a manager."""

    destination: str  # CIDR in normal form; "0.0.0.0/0" and "::/0" are the default routes
    gateway: str = ""  # "" for a destination on the link itself
    device: str = ""  # "" only for the types of NO_WAY
    metric: int = 0
    table: int = MAIN
    source: str = ""
    on_link: bool = False
    type: str = "unicast"

    @property
    def version(self) -> int:
        """4 or 6."""
        return 6 if ":" in self.destination else 4

    @property
    def key(self) -> Key:
        """What the kernel tells routes apart by: of one key there is one way (ip-route(8), `replace`)."""
        return (self.version, self.destination, self.table, self.metric)

    @property
    def way(self) -> typing.Tuple[typing.Any, ...]:
        """Key and way. `onlink` only allows a gateway that the kernel would refuse, so it makes no other way."""
        return self.key + (self.type, self.gateway, self.device, self.source)


class Held(typing.NamedTuple):
    """A route that the kernel holds."""

    route: Route
    protocol: str
    words: typing.Tuple[str, ...]  # with which `ip route replace` brings it back
    strange: typing.Tuple[str, ...]  # what it has and these words do not say

    @property
    def text(self) -> str:
        """As `ip route` writes it."""
        return " ".join(self.words)


def words_of(route: Route) -> typing.List[str]:
    """The words behind `ip route replace` that make a route."""
    words = [] if route.type == "unicast" else [route.type]
    words.append("default" if route.destination in DEFAULTS.values() else route.destination)
    if route.gateway:
        words += ["via", route.gateway]
    if route.device:
        words += ["dev", route.device]
    words += ["proto", PROTOCOL]
    if route.source:
        words += ["src", route.source]
    if route.metric:
        words += ["metric", str(route.metric)]
    if route.table != MAIN:
        words += ["table", str(route.table)]
    if route.on_link:
        words.append("onlink")
    return words


def command(verb: str, version: int, words: typing.Iterable[str]) -> typing.List[str]:
    """The command for a change; verb is replace, append or del."""
    return ["ip", "-%d" % version, "route", verb] + list(words)


def text_of(route: Route) -> str:
    """A route of ours as `ip route` writes it."""
    return " ".join(words_of(route))


# From what `ip` shows

_PLAIN = ("onlink", "linkdown", "dead", "pervasive", "offload", "offload_failed", "trap", "rt_offload", "rt_trap")
_KNOWN = {
    "type", "dst", "gateway", "via", "dev", "protocol", "scope", "prefsrc", "metric", "table", "flags", "metrics",
    "pref", "nexthops", "error", "weight",
}  # fmt: skip
_PATH_METRICS = ("mtu", "advmss", "window", "rtt", "rttvar", "cwnd", "initcwnd", "initrwnd", "ssthresh", "hoplimit")


def held(raw: Raw, version: int, table: int) -> Held:
    """A route as `ip` shows it."""
    kind, destination = raw.get("type", "unicast"), raw["dst"]
    if destination == "default":
        destination = DEFAULTS[version]
    way = kind not in NO_WAY
    flags = raw.get("flags", [])
    route = Route(
        destination=str(ipaddress.ip_network(destination)),
        gateway=raw.get("gateway") or raw.get("via", {}).get("host", ""),
        device=raw.get("dev", "") if way else "",  # IPv6 names lo for a blackhole
        metric=raw.get("metric", 0),
        table=table,
        source=raw.get("prefsrc", ""),
        on_link="onlink" in flags,
        type=kind,
    )
    strange = sorted(set(raw) - _KNOWN)
    words = [] if kind == "unicast" else [kind]
    words.append(raw["dst"])
    words += _hop(raw if way else {})
    protocol = raw.get("protocol", "boot")
    words += ["proto", protocol]
    if version == 4 and way and raw.get("scope", "global") != "global":
        words += ["scope", raw["scope"]]
    if route.source:
        words += ["src", route.source]
    if route.metric:
        words += ["metric", str(route.metric)]
    if table != MAIN:
        words += ["table", str(table)]
    if route.on_link:
        words.append("onlink")
    for metrics in raw.get("metrics", []):
        for name, value in sorted(metrics.items()):
            if name in _PATH_METRICS and isinstance(value, int):
                words += [name, str(value)]
            else:
                strange.append(name)
    if raw.get("pref", "medium") != "medium":
        words += ["pref", raw["pref"]]
    for hop in raw.get("nexthops", []):
        words += ["nexthop"] + _hop(hop) + ["weight", str(hop.get("weight", 1))]
        words += ["onlink"] if "onlink" in hop.get("flags", []) else []
        strange += sorted(set(hop) - _KNOWN)
    return Held(route, protocol, tuple(words), tuple(strange))


def _hop(raw: Raw) -> typing.List[str]:
    words = []
    if "via" in raw:
        words += ["via", raw["via"]["family"], raw["via"]["host"]]
    elif raw.get("gateway"):
        words += ["via", raw["gateway"]]
    if raw.get("dev"):
        words += ["dev", raw["dev"]]
    return words


_NAMES = {"proto": "protocol", "src": "prefsrc"}
_NUMBERS = ("metric", "weight", "error")


def from_text(output: str) -> typing.List[Raw]:
    """The same out of the text of `ip -oneline -details route show`."""
    return [_line(line) for line in output.splitlines() if line.strip()]


def _line(line: str) -> Raw:
    head, *hops = [part.split() for part in line.replace("\\", " ").split("nexthop ")]
    raw = {"type": head[0], "dst": head[1], "flags": []}
    _pairs(head[2:], raw)
    for words in hops:
        hop = {"flags": []}
        _pairs(words, hop)
        raw.setdefault("nexthops", []).append(hop)
    return raw


def _pairs(words: typing.List[str], raw: Raw) -> None:
    words = list(words)
    while words:
        name = words.pop(0)
        if name in _PLAIN:
            raw["flags"].append(name)
        elif name == "via" and words[0] in ("inet", "inet6"):
            raw["via"] = {"family": words.pop(0), "host": words.pop(0)}
        elif not words:
            raw[name] = ""
        elif name in _PATH_METRICS:
            value = words.pop(0)
            raw.setdefault("metrics", [{}])[0][name] = int(value) if value.isdigit() else value
        else:
            value = words.pop(0)
            name = "gateway" if name == "via" else _NAMES.get(name, name)
            raw[name] = int(value) if name in _NUMBERS else value


# The kernel


class Kernel:
    """The kernel's routes, read and changed by the command ip."""

    def read(self, version: int, table: int) -> typing.List[Held]:
        """The routes of a table. Raises Problem where they cannot be read."""
        show = ["-details", "-%d" % version, "route", "show", "table", str(table)]
        answer = run(["ip", "-json"] + show, limit=_LIMIT)
        if "table does not exist" in answer.error:
            return []
        try:
            if answer.status != 0:
                raise ValueError  # an option that it does not know, perhaps: the answer as text decides
            found = json.loads(answer.output.decode("utf-8") or "[]")
        except ValueError:
            answer = run(["ip", "-oneline"] + show, limit=_LIMIT)
            found = from_text(answer.output.decode("utf-8", "replace"))
        if answer.status != 0:
            raise Problem("routes: the kernel's routes cannot be read (%s), expected the command ip." % answer.error)
        # Routes for a kind of service or for some senders only are others in the kernel's eyes, and never ours.
        return [held(raw, version, table) for raw in found if "dst" in raw and not {"tos", "from"} & set(raw)]

    def change(self, verb: str, version: int, words: typing.Iterable[str]) -> None:
        """One change. Raises Problem with the kernel's own words."""
        argv = command(verb, version, words)
        answer = run(argv, limit=_LIMIT)
        if answer.status != 0:
            said = " ".join(answer.error.split()).replace("RTNETLINK answers: ", "").replace("Error: ", "").rstrip(".")
            raise Problem("routes: the kernel refuses '%s' (%s)." % (" ".join(argv), said or "without a word"))
