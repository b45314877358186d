# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The kernel's routing tables: the types of routes, the reader of `ip route show`, and the commands that change them.

The reader takes the text of `ip -oneline -details route show`. Before iproute2 4.16 there is no JSON of it, and the JSON of
later ones does not say which metrics are locked.
"""

import ipaddress
import re
import typing

from ..._base.commands import run
from ..._base.plain_text import quote
from ..._base.problem import Problem

MAIN = 254  # the table main, linux/rtnetlink.h
DEFAULTS = {4: "0.0.0.0/0", 6: "::/0"}
METRICS = {4: 0, 6: 1024}  # the kernel's defaults; 1024 is IP6_RT_PRIO_USER
PROTOCOL = "static"  # rtnetlink(7): made by the administrator; networkd and NetworkManager use the same
NO_WAY = ("blackhole", "unreachable", "prohibit", "throw")  # the types of routes without gateway and device

_LIMIT = 30.0  # seconds; a command takes a few milliseconds on a machine that is not overloaded

PATH = ("mtu", "advmss", "initcwnd")  # metrics of the path that a user can ask for

Fields = typing.Dict[str, typing.Any]  # the fields of a route or of one of its next hops, as `ip route show` names them
Key = typing.Tuple[int, str, int, int]  # version, destination, table, metric


class RouteSpec(typing.NamedTuple):
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
    mtu: int = 0  # 0, as for the next two, for a value that the kernel finds out itself
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
    def way(self) -> "RouteSpec":
        """The route without `on_link`, which only allows a gateway that the kernel would refuse."""
        return self._replace(on_link=False)

    def describe(self) -> typing.Dict[str, typing.Any]:
        """The fields by which all results of the module name a route."""
        return {
            "destination": format_destination(self.destination),
            "gateway": self.gateway or None,
            "device": self.device or None,
            "metric": self.metric,
            "table": self.table,
        }

    def fits(self, other: "RouteSpec") -> bool:
        """True if the other route goes this way. A field that this one leaves to the kernel may have any value in the other one."""
        plain = other._replace(scope="", mtu=0, advmss=0, initcwnd=0)
        return self.way in (other.way, plain.way)


class KernelRoute(typing.NamedTuple):
    """A route that the kernel holds."""

    route: RouteSpec
    protocol: str  # rtnetlink(7): boot, static, dhcp, kernel, ...
    words: typing.Tuple[str, ...]  # the words with which `ip route replace` makes it again
    inexpressible: typing.Tuple[str, ...]  # its attributes that these words cannot express

    @property
    def text(self) -> str:
        """The route as `ip route` writes it."""
        return " ".join(self.words)


# From a route to the words of `ip`


def to_words(route: RouteSpec, metrics: typing.Iterable[str] = PATH) -> typing.List[str]:
    """The words behind `ip route replace` that make a route, with these metrics of its path in this order."""
    words = [] if route.type == "unicast" else [route.type]
    words.append("default" if route.destination in DEFAULTS.values() else route.destination)
    if route.gateway:
        words += ["via", route.gateway]
    if route.device:
        words += ["dev", route.device]
    words += ["proto", PROTOCOL] + (["scope", route.scope] if route.scope else []) + _option_words(route)
    return words + [word for name in metrics if getattr(route, name) for word in (name, str(getattr(route, name)))]


def _option_words(route: RouteSpec) -> typing.List[str]:
    """The words for source, metric, table and on_link."""
    words = ["src", route.source] if route.source else []
    if route.metric:
        words += ["metric", str(route.metric)]
    if route.table != MAIN:
        words += ["table", str(route.table)]
    if route.on_link:
        words.append("onlink")
    return words


def format_route(route: RouteSpec) -> str:
    """A route of ours as `ip route` will write it, in the form of KernelRoute.text."""
    scope = route.scope or usual_scope(route.type, route.gateway)
    unsaid = scope == "global" or route.version == 6 or route.type in NO_WAY
    destination = re.sub("/128$" if route.version == 6 else "/32$", "", route.destination)
    return " ".join(to_words(route._replace(destination=destination, scope="" if unsaid else scope), sorted(PATH)))


def format_destination(destination: str) -> str:
    """A destination as a user writes it."""
    return "default" if destination == DEFAULTS[4] else destination


# From the output of `ip` to routes

_FLAGS = (
    ("onlink", "linkdown", "dead", "pervasive", "offload", "offload_failed", "trap", "rt_offload", "rt_trap")
    + ("notify", "unresolved", "rt_offload_failed")
)  # fmt: skip
_PATH_METRICS = {*PATH, "window", "rtt", "rttvar", "cwnd", "initrwnd", "ssthresh", "hoplimit", "rto_min"}
_KNOWN = _PATH_METRICS | {
    "type", "dst", "gateway", "via", "dev", "proto", "scope", "src", "metric", "table", "flags",
    "pref", "nexthops", "error", "weight",
}  # fmt: skip
_NUMBER = re.compile(r"(lock )?[0-9]+$")  # locked: not to be changed by findings of the kernel


def parse_route(line: str, version: int, table: int) -> KernelRoute:
    """A route in a line of `ip -oneline -details route show`, read."""
    fields = _read_line(line)
    route = _parse_fields(fields, version, table)
    protocol = fields.get("proto", "boot")
    words = [] if route.type == "unicast" else [route.type]
    words.append(fields["dst"])
    if route.type not in NO_WAY:
        words += _hop_words(fields)
    words += ["proto", protocol]
    if version == 4 and route.type not in NO_WAY and fields.get("scope", "global") != "global":
        words += ["scope", fields["scope"]]
    words += _option_words(route)
    inexpressible = sorted(set(fields) - _KNOWN)
    for name in sorted(_PATH_METRICS & set(fields)):
        if _NUMBER.match(fields[name]):
            words += [name, *fields[name].split()]
        else:
            inexpressible.append(name)
    if fields.get("pref", "medium") != "medium":
        words += ["pref", fields["pref"]]
    for hop in fields.get("nexthops", []):
        words += ["nexthop", *_hop_words(hop), "weight", hop.get("weight", "1")]
        words += ["onlink"] if "onlink" in hop["flags"] else []
        inexpressible += sorted(set(hop) - _KNOWN)
    return KernelRoute(route, protocol, tuple(words), tuple(inexpressible))


def _parse_fields(fields: Fields, version: int, table: int) -> RouteSpec:
    kind, gateway = fields["type"], fields.get("via", [""])[-1]
    destination = DEFAULTS[version] if fields["dst"] == "default" else fields["dst"]
    # With IPv6, several next hops, and without a way, a scope says nothing: NetworkManager gives a blackhole another one than ip.
    scope = "" if version == 6 or "nexthops" in fields or kind in NO_WAY else fields.get("scope", "")
    numbers = {name: fields.get(name, "0") for name in PATH}
    return RouteSpec(
        destination=str(ipaddress.ip_network(destination)),
        gateway=gateway,
        device="" if kind in NO_WAY else fields.get("dev", ""),  # IPv6 names lo for a blackhole
        metric=int(fields.get("metric", 0)),
        table=table,
        source=fields.get("src", ""),
        on_link="onlink" in fields["flags"],
        type=kind,
        scope="" if scope == usual_scope(kind, gateway) else scope,
        **{name: int(value) if value.isdigit() else value for name, value in numbers.items()},
    )


def usual_scope(kind: str, gateway: str) -> str:
    """The scope that the kernel gives a route of IPv4 (ip-route(8))."""
    return "link" if kind == "unicast" and not gateway else "global"


def _hop_words(fields: Fields) -> typing.List[str]:
    """The words for the gateway and the device of a route or of one of its next hops."""
    words = ["via", *fields["via"]] if "via" in fields else []
    return words + (["dev", fields["dev"]] if fields.get("dev") else [])


def _read_line(line: str) -> Fields:
    """The fields of a route in a line of `ip`, with those of its next hops."""
    kind, destination, *words = line.replace("\\", " ").split()
    route: Fields = {"type": kind, "dst": destination, "flags": []}
    fields = route
    while words:
        name = words.pop(0)
        if name == "nexthop":
            fields = {"flags": []}
            route.setdefault("nexthops", []).append(fields)
        elif name in _FLAGS:
            fields["flags"].append(name)
        else:
            # A gateway of the other version has its family before it, and a metric that is locked this word.
            more = (
                words[:1] in (["inet"], ["inet6"]) if name == "via" else name in _PATH_METRICS and words[:1] == ["lock"]
            )
            value, words = words[: 1 + more], words[1 + more :]
            fields[name] = value if name == "via" else " ".join(value)
    return route


# The kernel


def read_routes(version: int, table: int) -> typing.List[KernelRoute]:
    """The routes of a table. Raises Problem if they cannot be read."""
    show = ["-oneline", "-details", f"-{version}", "route", "show", "table", str(table)]
    answer = run(["ip", *show], limit=_LIMIT)
    if "table does not exist" in answer.error:
        return []
    if answer.status != 0:
        raise Problem(f"routes: the kernel's routes cannot be read ({quote(answer.error)}), expected the command ip.")
    # A line of its own begins with a tab: it repeats a next hop that the route names by a number. Behind it the route goes on.
    lines = re.sub(r"\n\t[^\\\n]*", "", answer.text).split("\n")
    kernel_routes = [parse_route(line, version, table) for line in lines if line]
    # Routes for one kind of service, or for some senders only, have other keys for the kernel. They are never ours.
    return [entry for entry in kernel_routes if not {"tos", "from"} & set(entry.inexpressible)]


def change_route(argv: typing.Sequence[str], may_refuse: bool = False) -> None:
    """Make one change by a command. Raises Problem with the kernel's own words.

    With `may_refuse`, only if the question did not reach the kernel: the command gave no answer, or could not be started.
    """
    answer = run(argv, limit=_LIMIT)
    if answer.status < 0 or (answer.status > 0 and not may_refuse):
        message = " ".join(answer.error.split()).replace("RTNETLINK answers: ", "").replace("Error: ", "").rstrip(".")
        raise Problem(f"routes: the kernel refuses {quote(' '.join(argv))} ({quote(message) or 'without a word'}).")
