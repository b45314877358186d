# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The kernel's routing tables: the types of routes, the reader of `ip route show`, and the commands that change them.

The reader takes `ip -json -details route show`. Before iproute2 4.16 there is no JSON, and it takes the text of the same
command.
"""

import ipaddress
import json
import re
import typing

from .._module.plain_text import quote
from .._module.problem import Problem
from .._process.commands import Answer, run

MAIN = 254  # the table main, linux/rtnetlink.h
DEFAULTS = {4: "0.0.0.0/0", 6: "::/0"}
METRICS = {4: 0, 6: 1024}  # the kernel's defaults; 1024 is IP6_RT_PRIO_USER
PROTOCOL = "static"  # rtnetlink(7): made by the administrator; networkd and NetworkManager use the same
NO_WAY = ("blackhole", "unreachable", "prohibit", "throw")  # the types of routes without gateway and device

_LIMIT = 30.0  # seconds; a command takes a few milliseconds on a machine that is not overloaded

PATH = ("mtu", "advmss", "initcwnd")  # metrics of the path that a user can ask for

Raw = typing.Dict[str, typing.Any]  # one route in the form of `ip -json -details route show`
Key = typing.Tuple[int, str, int, int]  # version, destination, table, metric


class Route(typing.NamedTuple):
    """A route that a user can ask for. Every field has a value; no default of the kernel or a manager applies."""

    destination: str  # CIDR in normal form; "0.0.0.0/0" and "::/0" are the default routes
    gateway: str = ""  # "" for a destination on the link itself
    device: str = ""  # "" only for the types of NO_WAY
    metric: int = 0
    table: int = MAIN
    source: str = ""
    on_link: bool = False
    type: str = "unicast"
    scope: str = ""  # "" for the kernel's own: link without a gateway, else global
    mtu: int = 0  # 0, as for the next two, for what the kernel finds out itself
    advmss: int = 0
    initcwnd: int = 0

    @property
    def version(self) -> int:
        """The version of IP: 4 or 6."""
        return 6 if ":" in self.destination else 4

    @property
    def key(self) -> Key:
        """The identity of a route for the kernel: `replace` of ip-route(8) replaces the route with the same key."""
        return (self.version, self.destination, self.table, self.metric)

    @property
    def way(self) -> typing.Tuple[typing.Any, ...]:
        """The key and the way. It is without `on_link`, which only allows a gateway that the kernel would refuse."""
        return self.key + (self.type, self.gateway, self.device, self.source, *self.refinements)

    @property
    def refinements(self) -> typing.Tuple[typing.Any, ...]:
        """The fields that the kernel fills in itself where they are empty."""
        return (self.scope, *(getattr(self, name) for name in PATH))

    def describe(self) -> typing.Dict[str, typing.Any]:
        """The fields by which all results of the module name a route."""
        return {
            "destination": format_destination(self.destination),
            "gateway": self.gateway or None,
            "device": self.device or None,
            "metric": self.metric,
            "table": self.table,
        }

    def fits(self, other: "Route") -> bool:
        """True where the other route goes this way. Where this route has no refinements, the other one may have any."""
        return self.way == other.way or (
            not any(self.refinements) and self.way == other._replace(scope="", mtu=0, advmss=0, initcwnd=0).way
        )


class KernelRoute(typing.NamedTuple):
    """A route that the kernel holds."""

    route: Route
    protocol: str  # rtnetlink(7): boot, static, dhcp, kernel, ...
    words: typing.Tuple[str, ...]  # the words with which `ip route replace` makes it again
    inexpressible: typing.Tuple[str, ...]  # its attributes that these words cannot express

    @property
    def text(self) -> str:
        """The route as `ip route` writes it."""
        return " ".join(self.words)


# From a route to the words of `ip`


def to_words(route: Route) -> typing.List[str]:
    """The words behind `ip route replace` that make a route."""
    words = [] if route.type == "unicast" else [route.type]
    words.append("default" if route.destination in DEFAULTS.values() else route.destination)
    if route.gateway:
        words += ["via", route.gateway]
    if route.device:
        words += ["dev", route.device]
    words += ["proto", PROTOCOL] + (["scope", route.scope] if route.scope else []) + _option_words(route)
    return words + [word for name in PATH if getattr(route, name) for word in (name, str(getattr(route, name)))]


def _option_words(route: Route) -> typing.List[str]:
    """The words for source, metric, table and on_link."""
    words = ["src", route.source] if route.source else []
    if route.metric:
        words += ["metric", str(route.metric)]
    if route.table != MAIN:
        words += ["table", str(route.table)]
    if route.on_link:
        words.append("onlink")
    return words


def format_route(route: Route) -> str:
    """A route of ours as `ip route` will write it, in the form of KernelRoute.text."""
    version, length = route.version, "/128" if route.version == 6 else "/32"
    raw = {
        "type": route.type,
        "dst": "default" if route.destination == DEFAULTS[version] else _strip_end(route.destination, length),
        "gateway": route.gateway,
        "dev": route.device,
        "protocol": PROTOCOL,
        "scope": route.scope or usual_scope(route.type, route.gateway),
        "prefsrc": route.source,
        "metric": route.metric,
        "flags": ["onlink"] if route.on_link else [],
        "metrics": [{name: getattr(route, name) for name in PATH if getattr(route, name)}],
    }
    return parse_route(raw, version, route.table).text


def _strip_end(text: str, end: str) -> str:
    return text[: -len(end)] if text.endswith(end) else text


def format_destination(destination: str) -> str:
    """A destination as a user writes it."""
    return "default" if destination == DEFAULTS[4] else destination


def build_command(verb: str, version: int, words: typing.Iterable[str]) -> typing.List[str]:
    """The command for a change. `verb` is replace, append or del."""
    return ["ip", f"-{version}", "route", verb, *words]


# From the output of `ip` to routes

_FLAGS = ("onlink", "linkdown", "dead", "pervasive", "offload", "offload_failed", "trap", "rt_offload", "rt_trap")
_KNOWN = {
    "type", "dst", "gateway", "via", "dev", "protocol", "scope", "prefsrc", "metric", "table", "flags", "metrics",
    "pref", "nexthops", "error", "weight",
}  # fmt: skip
_PATH_METRICS = ("mtu", "advmss", "window", "rtt", "rttvar", "cwnd", "initcwnd", "initrwnd", "ssthresh", "hoplimit")


def parse_route(raw: Raw, version: int, table: int) -> KernelRoute:
    """A route in the form of `ip -json`, read."""
    route = _parse_fields(raw, version, table)
    protocol = raw.get("protocol", "boot")
    words = [] if route.type == "unicast" else [route.type]
    words.append(raw["dst"])
    if route.type not in NO_WAY:
        words += _hop_words(raw)
    words += ["proto", protocol]
    if version == 4 and route.type not in NO_WAY and raw.get("scope", "global") != "global":
        words += ["scope", raw["scope"]]
    words += _option_words(route)
    metrics, inexpressible = _metric_words(raw)
    words += metrics
    if raw.get("pref", "medium") != "medium":
        words += ["pref", raw["pref"]]
    for hop in raw.get("nexthops", []):
        words += ["nexthop", *_hop_words(hop), "weight", str(hop.get("weight", 1))]
        words += ["onlink"] if "onlink" in hop.get("flags", []) else []
        inexpressible += sorted(set(hop) - _KNOWN)
    return KernelRoute(route, protocol, tuple(words), tuple(sorted(set(raw) - _KNOWN) + inexpressible))


def _parse_fields(raw: Raw, version: int, table: int) -> Route:
    """The fields of a route in the form of `ip -json`."""
    kind = raw.get("type", "unicast")
    metrics = {name: value for group in raw.get("metrics", []) for name, value in group.items()}
    destination = DEFAULTS[version] if raw["dst"] == "default" else raw["dst"]
    return Route(
        destination=str(ipaddress.ip_network(destination)),
        gateway=raw.get("gateway") or raw.get("via", {}).get("host", ""),
        device="" if kind in NO_WAY else raw.get("dev", ""),  # IPv6 names lo for a blackhole
        metric=raw.get("metric", 0),
        table=table,
        source=raw.get("prefsrc", ""),
        on_link="onlink" in raw.get("flags", []),
        type=kind,
        scope=_read_scope(raw, version, kind),
        **{name: metrics.get(name, 0) for name in PATH},
    )


def usual_scope(kind: str, gateway: str) -> str:
    """The scope that the kernel gives a route of IPv4 (ip-route(8))."""
    return "link" if kind == "unicast" and not gateway else "global"


def _read_scope(raw: Raw, version: int, kind: str) -> str:
    """The scope of a route, "" for the usual one, and where it says nothing: with IPv6, several next hops, and without a way.

    (NetworkManager gives a blackhole another scope than ip does.)
    """
    if version == 6 or "nexthops" in raw or kind in NO_WAY:
        return ""
    scope = raw.get("scope", "")
    return "" if scope == usual_scope(kind, raw.get("gateway") or raw.get("via", {}).get("host", "")) else scope


def _hop_words(raw: Raw) -> typing.List[str]:
    """The words for the gateway and the device of a route or of one of its next hops."""
    words = []
    if "via" in raw:
        words += ["via", raw["via"]["family"], raw["via"]["host"]]
    elif raw.get("gateway"):
        words += ["via", raw["gateway"]]
    if raw.get("dev"):
        words += ["dev", raw["dev"]]
    return words


def _metric_words(raw: Raw) -> typing.Tuple[typing.List[str], typing.List[str]]:
    """The words for the metrics of the path, such as `mtu`, and the names of those without words."""
    words, inexpressible = [], []
    for metrics in raw.get("metrics", []):
        for name, value in sorted(metrics.items()):
            if name in _PATH_METRICS and _NUMBER.match(str(value)):
                words += [name, *str(value).split()]
            else:
                inexpressible.append(name)
    return words, inexpressible


_NUMBER = re.compile(r"(lock )?[0-9]+$")  # locked: not to be changed by what the kernel finds out
_NAMES = {"proto": "protocol", "src": "prefsrc"}
_NUMBERS = ("metric", "weight", "error")


def from_text(output: str) -> typing.List[Raw]:
    """The routes in the text of `ip -oneline -details route show`, in the form of `ip -json`."""
    return [_parse_line(line) for line in output.splitlines() if line.strip()]


def _parse_line(line: str) -> Raw:
    head, *hops = [part.split() for part in line.replace("\\", " ").split("nexthop ")]
    raw: Raw = {"type": head[0], "dst": head[1], "flags": []}
    _read_pairs(head[2:], raw)
    for words in hops:
        hop: Raw = {"flags": []}
        _read_pairs(words, hop)
        raw.setdefault("nexthops", []).append(hop)
    return raw


def _read_pairs(words: typing.List[str], raw: Raw) -> None:
    """Read names and values into `raw`."""
    words = list(words)
    while words:
        name = words.pop(0)
        if name in _FLAGS:
            raw["flags"].append(name)
        elif name == "via" and words[0] in ("inet", "inet6"):
            raw["via"] = {"family": words.pop(0), "host": words.pop(0)}
        elif not words:
            raw[name] = ""
        elif name in _PATH_METRICS:
            value = words.pop(0)
            value = f"lock {words.pop(0)}" if value == "lock" and words else value
            raw.setdefault("metrics", [{}])[0][name] = int(value) if value.isdigit() else value
        else:
            value = words.pop(0)
            name = "gateway" if name == "via" else _NAMES.get(name, name)
            raw[name] = int(value) if name in _NUMBERS else value


def _add_locks(raws: typing.List[Raw], answer: Answer) -> None:
    """Add what only the text says: metrics that are locked."""
    lines = from_text(answer.text)
    same = len(lines) == len(raws) and all(
        line["dst"] == raw.get("dst") and line.get("metric", 0) == raw.get("metric", 0)
        for line, raw in zip(lines, raws)
    )
    for raw in raws if not same else ():
        if "metrics" in raw:
            raw["metrics"] = [*raw["metrics"], {"metrics that are changing": None}]
    for line, raw in zip(lines, raws) if same else ():
        if "metrics" in line:
            raw["metrics"] = line["metrics"]


# The kernel


def read_routes(version: int, table: int) -> typing.List[KernelRoute]:
    """The routes of a table. Raises Problem where they cannot be read."""
    show = ["-details", f"-{version}", "route", "show", "table", str(table)]
    answer = run(["ip", "-json", *show], limit=_LIMIT)
    if "table does not exist" in answer.error:
        return []
    try:
        if answer.status != 0:
            raise ValueError  # perhaps ip does not know the option -json; the command for text decides
        raws = json.loads(answer.output.decode("utf-8") or "[]")
        if any("metrics" in raw for raw in raws):
            _add_locks(raws, run(["ip", "-oneline", *show], limit=_LIMIT))
    except ValueError:
        answer = run(["ip", "-oneline", *show], limit=_LIMIT)
        raws = from_text(answer.text)
    if answer.status != 0:
        raise Problem(f"routes: the kernel's routes cannot be read ({quote(answer.error)}), expected the command ip.")
    # Routes for one kind of service, or for some senders only, have other keys for the kernel. They are never ours.
    return [parse_route(raw, version, table) for raw in raws if "dst" in raw and not {"tos", "from"} & set(raw)]


def change_route(verb: str, version: int, words: typing.Iterable[str]) -> None:
    """Make one change. Raises Problem with the kernel's own words."""
    argv = build_command(verb, version, words)
    answer = run(argv, limit=_LIMIT)
    if answer.status != 0:
        message = " ".join(answer.error.split()).replace("RTNETLINK answers: ", "").replace("Error: ", "").rstrip(".")
        raise Problem(f"routes: the kernel refuses {quote(' '.join(argv))} ({quote(message) or 'without a word'}).")
