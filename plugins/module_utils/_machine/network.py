# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The network of this machine: its interfaces with their addresses, and the routes that the kernel takes.

Every caller reads the output of `ip address`, `ip route get` and `ip route show default` through this file.
(`_routes/kernel.py` reads whole routing tables, because it must be able to make every route again.)
"""

import ipaddress
import json
import os
import re
import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._module.plain_text import quote
from ansible_collections.rosfleet.multimaster.plugins.module_utils._process.commands import Answer, run, text

_UP, _LOOPBACK, _MULTICAST = 0x1, 0x8, 0x1000  # netdevice(7), linux/if.h
_HOST_PREFIX = {"inet": 32, "inet6": 128}


class Address(typing.NamedTuple):
    """An address of an interface, with the length of its network's prefix."""

    address: str
    prefix: int
    family: str  # "inet" or "inet6", as `ip` says it

    @property
    def interface(self) -> typing.Union[ipaddress.IPv4Interface, ipaddress.IPv6Interface]:
        """The address together with its network."""
        return ipaddress.ip_interface(f"{self.address}/{self.prefix}")


class Interface(typing.NamedTuple):
    """A network interface."""

    name: str
    index: int = 0  # type: ignore[assignment]  # hides tuple.index, which has no use here
    up: bool = False
    multicast: bool = False
    loopback: bool = False
    mtu: int = 0  # bytes
    addresses: typing.Tuple[Address, ...] = ()

    @property
    def networks(self) -> typing.List[typing.Any]:
        """The addresses of the interface with their networks (ipaddress)."""
        return [address.interface for address in self.addresses]

    def plain(self) -> typing.Dict[str, typing.Any]:
        """The interface as multimaster_info returns it."""
        fields = self._asdict()
        del fields["index"]
        return dict(fields, addresses=[dict(address._asdict()) for address in self.addresses])


class RouteTo(typing.NamedTuple):
    """The route that the kernel takes to a destination. A field is None where `ip route` does not name it."""

    destination: str
    gateway: typing.Optional[str] = None
    device: typing.Optional[str] = None
    source: typing.Optional[str] = None  # the address with which this machine sends there
    metric: typing.Optional[str] = None
    error: str = ""  # the kernel's words where there is no route

    def plain(self) -> typing.Dict[str, typing.Optional[str]]:
        """The route as multimaster_info returns it."""
        fields = self._asdict()
        del fields["metric"]
        return dict(fields)


# Interfaces


def interfaces() -> typing.List[Interface]:
    """The network interfaces with their addresses. Raises OSError where the machine cannot be asked."""
    answer = run(["ip", "-json", "address"])
    if answer.status == 0:
        try:
            return from_json(answer.output.decode("utf-8"))
        except ValueError:
            pass  # iproute2 before 4.14 takes the option and prints text
    answer = run(["ip", "-oneline", "address"])
    if answer.status != 0:
        raise OSError(f"the interfaces' addresses cannot be read: {quote(answer.error) or 'ip failed'}")
    return from_text(answer.output.decode("utf-8", "replace"), links())


def from_json(output: str) -> typing.List[Interface]:
    """The interfaces in the output of `ip -json address`. Raises ValueError for anything else."""
    data = json.loads(output)
    if not isinstance(data, list):
        raise ValueError("expected a list of interfaces")
    return [
        Interface(
            name=link["ifname"],
            index=link.get("ifindex", 0),
            up="UP" in link.get("flags", ()),
            multicast="MULTICAST" in link.get("flags", ()),
            loopback="LOOPBACK" in link.get("flags", ()),
            mtu=link.get("mtu", 0),
            addresses=tuple(
                Address(entry["local"], entry["prefixlen"], entry["family"])
                for entry in link.get("addr_info", ())
                if "local" in entry
            ),
        )
        for link in data
        if "ifname" in link  # old versions leave empty objects
    ]


def from_text(output: str, found: typing.Iterable[Interface]) -> typing.List[Interface]:
    """These interfaces with the addresses in the output of `ip -oneline address`."""
    addresses: typing.Dict[str, typing.List[Address]] = {}
    lines = re.findall(
        r"^\d+:\s+([^\s@]+)\S*\s+(inet6?)\s+([^\s/]+)(?: peer [^\s/]+)?(?:/(\d+))?", output, re.MULTILINE
    )
    for name, family, address, prefix in lines:
        length = int(prefix) if prefix else _HOST_PREFIX[family]
        addresses.setdefault(name, []).append(Address(address, length, family))
    return [link._replace(addresses=link.addresses + tuple(addresses.get(link.name, ()))) for link in found]


def links(folder: str = "/sys/class/net") -> typing.List[Interface]:
    """The interfaces without their addresses, from the files of the kernel (sysfs(5))."""
    found = []
    for name in sorted(os.listdir(folder)):
        flags = text(os.path.join(folder, name, "flags")).strip()
        if not flags:
            continue  # a file such as bonding_masters
        up, loopback, multicast = (bool(int(flags, 16) & bit) for bit in (_UP, _LOOPBACK, _MULTICAST))
        index, mtu = (int(text(os.path.join(folder, name, file)).strip() or 0) for file in ("ifindex", "mtu"))
        found.append(Interface(name, index, up, multicast, loopback, mtu))
    return found


# Routes


def route_to(destination: str) -> RouteTo:
    """The route that the kernel takes to an IPv4 address (ip-route(8), get)."""
    return routes_to([destination])[0]


def routes_to(destinations: typing.Iterable[str]) -> typing.List[RouteTo]:
    """The routes that the kernel takes to IPv4 addresses, all asked for by one process (ip(8), -batch)."""
    every = list(destinations)
    asked = list(dict.fromkeys(address for address in every if is_address(address)))  # ip gives up at anything else
    lines = "".join(f"route get {address}\n" for address in asked)
    found = routes_from_batch(run(["ip", "-4", "-oneline", "-force", "-batch", "-"], given=lines.encode()), asked)
    return [found.get(address) or RouteTo(address, error="this is no IPv4 address") for address in every]


def routes_from_batch(answer: Answer, asked: typing.Sequence[str]) -> typing.Dict[str, RouteTo]:
    """{address: its route} from a line of output for each address that has one, and `Command failed -:N` for the Nth that has none."""
    failed = {
        asked[int(number) - 1]: why.replace("RTNETLINK answers: ", "").strip()
        for why, number in re.findall(r"([^\n]*)\n?Command failed -:(\d+)", answer.error)
        if 0 < int(number) <= len(asked)
    }
    lines = answer.output.decode("utf-8", "replace").splitlines()
    reached = [address for address in asked if address not in failed]
    if len(lines) != len(reached):
        return {address: RouteTo(address, error=answer.error or "ip gave no answer") for address in asked}
    found = {address: route_from_text(line, address) for address, line in zip(reached, lines)}
    return {**found, **{address: RouteTo(address, error=why or "no route") for address, why in failed.items()}}


def is_address(said: str) -> bool:
    """True for an IPv4 address."""
    try:
        ipaddress.IPv4Address(said)
    except ValueError:
        return False
    return True


def default_routes() -> typing.List[RouteTo]:
    """The default routes of IPv4 in the table main."""
    output = run(["ip", "-4", "route", "show", "default"]).output.decode("utf-8", "replace")
    return [route_from_text(line, "default") for line in output.splitlines() if line.startswith("default")]


def policy_rules() -> typing.List[str]:
    """The rules of IPv4 that lead to other tables than the kernel's own three do (ip-rule(8))."""
    output = run(["ip", "-4", "rule", "show"]).output.decode("utf-8", "replace")
    lines = (" ".join(line.split()) for line in output.splitlines())
    return [line for line in lines if not re.fullmatch(r"\d+: from all lookup (local|main|default)", line)]


def route_from_text(output: str, destination: str) -> RouteTo:
    """The route in the output of `ip route get`, or in a line of `ip route show`."""

    def after(word: str) -> typing.Optional[str]:
        match = re.search(rf"\b{word} (\S+)", output)
        return match.group(1) if match else None

    # A route to an IPv4 address may go by a gateway that has an IPv6 address: `via inet6 fe80::1`.
    return RouteTo(destination, after("via(?: inet6)?"), after("dev"), after("src"), after("metric"))
