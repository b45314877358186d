# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The way to the networks of the robots, in the language of routers and gateways of other makes.

Pure: the fleet's plan in, file contents out. To speak another dialect is one more row in DIALECTS.

Section 4.2 of the report asks for the routes. Two things more keep robots from each other where a device of another
make is between them: source addresses that it translates (ROS nodes call back the address that they see), and ICMP
redirects of the router, whose packets turn round on the common network.
"""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

ROUTER, GATEWAY = "router", "gateway"
ROUTES, PEERS = "routes", "peers"

# RouterOS finds what is ours by this.
MARK = "rosfleet.multimaster"

REPLACES = "Using it again replaces what it put there."
ADDS = "Do so before a robot goes or gets another address."


class RouterConfigProblem(ValueError):
    """What was asked for cannot be rendered; the text is one sentence."""


@dataclass(frozen=True)
class Network:
    """A network of the fleet; by `gateway` for a route, with the name of its robot, or "" for the common network."""

    robot: str
    network: str
    gateway: str = ""

    @property
    def name(self) -> str:
        """The robot's name in the letters that every dialect takes."""
        return re.sub(r"[^A-Za-z0-9_.-]", "_", self.robot) or "common network"

    def fields(self) -> dict[str, str]:
        """What templates may name."""
        network = ipaddress.ip_network(self.network)
        return {
            "robot": self.name,
            "network": self.network,
            "gateway": self.gateway,
            "address": str(network.network_address),
            "mask": str(network.netmask),
            "section": f"rosfleet_{re.sub('[./]', '_', self.network)}",
        }


@dataclass(frozen=True)
class Device:
    """A router or gateway of another make: the routes that it needs, and whom it must show unchanged addresses."""

    folder: str  # what its files are found under
    kind: str  # ROUTER or GATEWAY
    title: str
    own: str  # the network behind it; the common network for the router
    routes: tuple[Network, ...]
    peers: tuple[Network, ...]  # networks that it must not translate addresses towards


class Block(NamedTuple):
    """A piece of a dialect: a template, what it is repeated for, and the kinds of device that need it."""

    text: str
    each: str = ""  # ROUTES, PEERS, or once
    kinds: tuple[str, ...] = (ROUTER, GATEWAY)


@dataclass(frozen=True)
class Dialect:
    """How one make of device is told. Templates are those of str.format."""

    title: str
    suffix: str  # of the file
    comment: str  # how a line of comment begins
    use: str  # what a person does with a file
    again: str  # what happens when the file of a changed fleet is used
    interfaces: Mapping[str, str]  # kind -> the interface of the common network, as the maker names it
    add: tuple[Block, ...]
    remove: tuple[Block, ...]
    first_line: str = ""
    notes: Mapping[str, str] = field(default_factory=dict)  # kind -> what remains for the person


def _openwrt() -> Dialect:
    """uci, the firewall's sections `nat` and `rule`, and a file for sysctl: openwrt.org/docs/guide-user/network."""
    forget = Block(
        "for section in $({{ uci -q show network; uci -q show firewall; }} | sed -n 's/^\\([a-z]*\\.rosfleet_[a-z0-9_]*\\)=.*/\\1/p'); do\n"
        '    uci delete "$section"\n'
        "done"
    )
    reload = Block("uci commit network\nuci commit firewall\n/etc/init.d/network reload\n/etc/init.d/firewall reload")
    return Dialect(
        title="OpenWrt 21.02 and later (uci)",
        suffix="sh",
        comment="# ",
        use="Paste it into a shell of the device.",
        again=REPLACES,
        first_line="#!/bin/sh",
        interfaces={ROUTER: "lan", GATEWAY: "wan"},
        add=(
            forget,
            Block("uci batch <<'END'"),
            Block(
                "set network.{section}=route\n"
                "set network.{section}.interface='{interface}'\n"
                "set network.{section}.target='{network}'\n"
                "set network.{section}.gateway='{gateway}'",
                each=ROUTES,
            ),
            Block(
                "set firewall.{section}=nat\n"
                "set firewall.{section}.name='No translation towards {robot}'\n"
                "set firewall.{section}.family='ipv4'\n"
                "set firewall.{section}.proto='all'\n"
                "set firewall.{section}.src='*'\n"
                "set firewall.{section}.dest_ip='{network}'\n"
                "set firewall.{section}.target='ACCEPT'",
                each=PEERS,
            ),
            Block(
                "set firewall.rosfleet_forward=rule\n"
                "set firewall.rosfleet_forward.name='From the other robots'\n"
                "set firewall.rosfleet_forward.family='ipv4'\n"
                "set firewall.rosfleet_forward.proto='all'\n"
                "set firewall.rosfleet_forward.src='*'\n"
                "set firewall.rosfleet_forward.dest='*'\n"
                "set firewall.rosfleet_forward.dest_ip='{own}'\n"
                "set firewall.rosfleet_forward.target='ACCEPT'",
                kinds=(GATEWAY,),
            ),
            Block("add_list firewall.rosfleet_forward.src_ip='{network}'", each=PEERS, kinds=(GATEWAY,)),
            Block("END"),
            reload,
            Block(
                "printf 'net.ipv4.conf.%s.send_redirects=0\\n' all default > /etc/sysctl.d/90-rosfleet-multimaster.conf\n"
                'for file in /proc/sys/net/ipv4/conf/*/send_redirects; do echo 0 > "$file"; done',
                kinds=(ROUTER,),
            ),
        ),
        remove=(
            forget,
            reload,
            Block(
                "rm -f /etc/sysctl.d/90-rosfleet-multimaster.conf\n"
                'for file in /proc/sys/net/ipv4/conf/*/send_redirects; do echo 1 > "$file"; done',
                kinds=(ROUTER,),
            ),
        ),
    )


def _routeros() -> Dialect:
    """Raw rules with notrack leave out translation and "drop invalid" at once: help.mikrotik.com, Firewall, RAW.

    A computer that answers its neighbour directly shows the router only half of a connection, which the default
    firewall would drop as invalid.
    """
    forget = Block(
        '/ip route remove [find comment~"^' + MARK + '"]\n'
        '/ip firewall raw remove [find comment~"^' + MARK + '"]\n'
        "/ip firewall address-list remove [find list=rosfleet]"
    )
    return Dialect(
        title="MikroTik RouterOS 7",
        suffix="rsc",
        comment="# ",
        use="Paste it into a terminal of the device, or copy it there and /import it.",
        again=REPLACES,
        interfaces={},
        add=(
            forget,
            Block(
                '/ip route add dst-address={network} gateway={gateway} comment="' + MARK + ': {robot}"',
                each=ROUTES,
            ),
            Block('/ip firewall address-list add list=rosfleet address={own} comment="' + MARK + '"'),
            Block(
                '/ip firewall address-list add list=rosfleet address={network} comment="' + MARK + ': {robot}"',
                each=PEERS,
            ),
            Block(
                "/ip firewall raw add chain=prerouting action=notrack src-address-list=rosfleet dst-address-list=rosfleet "
                'dst-address-type=!local comment="' + MARK + '"'
            ),
            Block("/ip settings set send-redirects=no", kinds=(ROUTER,)),
        ),
        remove=(forget, Block("/ip settings set send-redirects=yes", kinds=(ROUTER,))),
        notes=dict.fromkeys(
            (ROUTER, GATEWAY), "The maker's firewall lets untracked packets pass; one of your own must do so, too."
        ),
    )


def _vyatta(title: str, nat: str, outbound: str, last: str, redirects: str) -> Dialect:
    """VyOS and EdgeOS have one ancestor and name translation and redirects differently."""
    begin = Block("configure\ndelete firewall group network-group ROSFLEET")
    end = Block("commit\nsave\nexit")
    return Dialect(
        title=title,
        suffix="txt",
        comment="# ",
        use="Paste it into a shell of the device.",
        again=ADDS,
        interfaces={ROUTER: "eth0", GATEWAY: "eth0"},
        add=(
            begin,
            Block("set protocols static route {network} next-hop {gateway}", each=ROUTES),
            Block("set firewall group network-group ROSFLEET network {network}", each=PEERS),
            Block(
                f"set {nat} description 'No translation towards robots'\n"
                f"set {nat} destination group network-group ROSFLEET\n"
                f"set {nat} {outbound} {{interface}}\n"
                f"set {nat} exclude" + (f"\nset {nat} {last}" if last else "")
            ),
            Block(f"set {redirects} disable", kinds=(ROUTER,)),
            end,
        ),
        remove=(
            begin,
            Block("delete protocols static route {network} next-hop {gateway}", each=ROUTES),
            Block(f"delete {nat}"),
            Block(f"set {redirects} enable", kinds=(ROUTER,)),
            end,
        ),
        notes={
            ROUTER: f"The rule '{nat}' must be free, and before those that translate.",
            GATEWAY: f"The rule '{nat}' must be free, and before those that translate.\n"
            "A firewall must let the common network and the networks above pass.",
        },
    )


def _ios() -> Dialect:
    return Dialect(
        title="Cisco IOS",
        suffix="txt",
        comment="! ",
        use="Paste it in configuration mode (configure terminal); afterwards: write memory.",
        again=ADDS,
        interfaces={ROUTER: "GigabitEthernet0/0", GATEWAY: "GigabitEthernet0/0"},
        add=(
            Block("ip route {address} {mask} {gateway}", each=ROUTES),
            Block("interface {interface}\n no ip redirects\nexit", kinds=(ROUTER,)),
            Block("end"),
        ),
        remove=(
            Block("no ip route {address} {mask} {gateway}", each=ROUTES),
            Block("interface {interface}\n ip redirects\nexit", kinds=(ROUTER,)),
            Block("end"),
        ),
        notes={
            GATEWAY: "Where 'ip nat inside source' translates towards the common network, its access list must deny it and the "
            "networks above."
        },
    )


def _linux() -> Dialect:
    return Dialect(
        title="Linux (ip route)",
        suffix="sh",
        comment="# ",
        first_line="#!/bin/sh",
        use="Copy it to the device and run it as root.",
        again=ADDS,
        interfaces={},
        add=(
            Block("set -eu"),
            Block("ip route replace {network} via {gateway}", each=ROUTES),
            Block(
                'for file in /proc/sys/net/ipv4/conf/*/send_redirects; do echo 0 > "$file"; done',
                kinds=(ROUTER,),
            ),
        ),
        remove=(
            Block("set -eu"),
            Block("ip route del {network} via {gateway} 2> /dev/null || true", each=ROUTES),
            Block(
                'for file in /proc/sys/net/ipv4/conf/*/send_redirects; do echo 1 > "$file"; done',
                kinds=(ROUTER,),
            ),
        ),
        notes={
            ROUTER: "A reboot forgets it: have it run at every boot.",
            GATEWAY: "A reboot forgets it: have it run at every boot.\n"
            "Rules that masquerade towards the common network must leave out that and the networks above.",
        },
    )


DIALECTS: Mapping[str, Dialect] = {
    "openwrt": _openwrt(),
    "routeros": _routeros(),
    "vyos": _vyatta(
        title="VyOS 1.4 and later",
        nat="nat source rule 5",
        outbound="outbound-interface name",
        last="",
        redirects="firewall global-options send-redirects",
    ),
    "edgeos": _vyatta(
        title="Ubiquiti EdgeOS",
        nat="service nat rule 5001",
        outbound="outbound-interface",
        last="type masquerade",
        redirects="firewall send-redirects",
    ),
    "ios": _ios(),
    "linux": _linux(),
}


def devices(plan: Mapping[str, Any]) -> list[Device]:
    """The router, and every gateway that is no computer of the inventory, out of the fleet's plan.

    Empty where no robot has a network of its own.
    """
    common = Network("", plan["common_network"])
    networks = [Network(entry["robot"], entry["network"], entry["common_address"]) for entry in plan["networks"]]
    if not networks:
        return []
    address = plan["router"].get("address")
    found = [
        Device(
            folder=ROUTER,
            kind=ROUTER,
            title=f"the router of the common network {common.network}" + (f" ({address})" if address else ""),
            own=common.network,
            routes=tuple(networks),
            peers=tuple(networks),
        )
    ]
    for entry, network in zip(plan["networks"], networks, strict=True):
        if entry["device"]:
            others = tuple(other for other in networks if other != network)
            found.append(
                Device(
                    folder=f"{GATEWAY}-{network.name}",
                    kind=GATEWAY,
                    title=f"the gateway of {network.name} ({entry['gateway']}, {entry['common_address']})",
                    own=network.network,
                    routes=others,
                    peers=(common, *others),
                )
            )
    return found


def files(
    plan: Mapping[str, Any], dialects: Iterable[str] = tuple(DIALECTS), interfaces: Mapping[str, Any] | None = None
) -> list[dict[str, str]]:
    """The files of all devices: `path` below a folder of the caller's choice, and `content`.

    `interfaces` names the interface of the common network where it is not the maker's usual one: device -> dialect ->
    interface. Raises RouterConfigProblem.
    """
    wanted, given = list(dialects), interfaces or {}
    found = devices(plan)
    _known("router_config_dialects", wanted, DIALECTS)
    _known("router_config_interfaces", given, [device.folder for device in found])
    for device, names in given.items():
        variable = f"router_config_interfaces.{device}"
        if not isinstance(names, Mapping):
            raise RouterConfigProblem(
                f"{variable} is {names!r}; expected a mapping such as {{openwrt: lan}}: correct it."
            )
        _known(variable, names, [name for name in DIALECTS if DIALECTS[name].interfaces])
        for dialect, name in names.items():
            if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_./:-]*", str(name)):
                raise RouterConfigProblem(
                    f"{variable}.{dialect} is '{name}'; expected one word of letters, digits and ./:_-, such as "
                    "GigabitEthernet0/1: correct it."
                )
    return [
        {"path": f"{device.folder}/{file}", "content": content}
        for device in found
        for name in wanted
        for file, content in _files(device, name, given.get(device.folder, {}).get(name, "")).items()
    ]


def _known(variable: str, given: Iterable[str], expected: Iterable[str]) -> None:
    for name in given:
        if name not in expected:
            raise RouterConfigProblem(
                f"{variable} has '{name}', which is not known; expected some of {', '.join(expected) or 'none'}: correct it."
            )


def _files(device: Device, name: str, interface: str) -> dict[str, str]:
    """The file of a dialect for a device, and the one that takes it back."""
    dialect = DIALECTS[name]
    interface = interface or dialect.interfaces.get(device.kind, "")
    add, remove = f"{name}.{dialect.suffix}", f"{name}.remove.{dialect.suffix}"
    about = [
        f"{MARK}: the way to the networks of the robots, for {device.title}.",
        f"{dialect.title}. {dialect.use}",
        f"To take it back: {remove}. {dialect.again}",
        "",
        *(f"  {route.name}: {route.network} by {route.gateway}" for route in device.routes),
        "",
    ]
    if interface:
        about.append(f"The interface of the common network: {interface} (router_config_interfaces sets another).")
    if device.kind in dialect.notes:
        about += dialect.notes[device.kind].splitlines()
    about_remove = [f"{MARK}: takes {add} back, for {device.title}.", f"{dialect.title}. {dialect.use}"]
    return {
        add: _text(dialect, about, _lines(dialect.add, device, interface)),
        remove: _text(dialect, about_remove, _lines(dialect.remove, device, interface)),
    }


def _text(dialect: Dialect, about: Sequence[str], lines: Sequence[str]) -> str:
    first = [dialect.first_line] if dialect.first_line else []
    comment = [f"{dialect.comment}{line}".rstrip() for line in about]
    while comment[-1] == dialect.comment.rstrip():
        comment.pop()
    return "\n".join([*first, *comment, *lines, ""])


def _lines(blocks: Sequence[Block], device: Device, interface: str) -> list[str]:
    shared = {"own": device.own, "interface": interface}
    repeated = {ROUTES: [route.fields() for route in device.routes], PEERS: [peer.fields() for peer in device.peers]}
    return [
        block.text.format(**shared, **fields)
        for block in blocks
        if device.kind in block.kinds
        for fields in (repeated[block.each] if block.each else [{}])
    ]
