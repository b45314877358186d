# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The dialects of routers and gateways: how the device of a make takes its routes.

Examples of their output are in tests/unit/golden/router_config.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

# Kinds of devices.
ROUTER, GATEWAY = "router", "gateway"
# A block may be repeated for each of these.
ROUTES, PEERS = "routes", "peers"

# RouterOS finds our entries by this text.
MARK = "rosfleet.multimaster"

# Values of Dialect.again.
REPLACES = "Using it again replaces its former lines."
ADDS = "Do so before a robot goes or gets another address."


class Block(NamedTuple):
    """A piece of a dialect: a template, and the kinds of device that need it."""

    text: str
    each: str = ""  # ROUTES, PEERS, or empty for once
    kinds: tuple[str, ...] = (ROUTER, GATEWAY)


@dataclass(frozen=True)
class Dialect:
    """The language of one make of device. Templates are those of str.format."""

    title: str
    suffix: str  # of the file; one with "sh" is a program
    use: str  # the sentence with the use of a file
    add: tuple[Block, ...]
    remove: tuple[Block, ...]
    again: str = ADDS  # the sentence for a second use, after a change of the fleet
    comment: str = "# "  # the begin of a line of comment
    # kind -> the maker's name of the interface on the common network
    interfaces: Mapping[str, str] = field(default_factory=dict)
    notes: Mapping[str, str] = field(default_factory=dict)


def _vyatta(title: str, nat: str, outbound: str, last: str, redirects: str) -> Dialect:
    """Return the dialect of a system from Vyatta: `nat` is the rule for translation, `redirects` the setting for ICMP redirects."""
    begin = Block("configure\ndelete firewall group network-group ROSFLEET")
    end = Block("commit\nsave\nexit")
    note = f"The rule '{nat}' must be free, and before those that translate."
    return Dialect(
        title=title,
        suffix="txt",
        use="Paste it into a shell of the device.",
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
            ROUTER: note,
            GATEWAY: f"{note}\nA firewall must let the common network and the networks above pass.",
        },
    )


def _set_redirects(value: int) -> Block:
    """Return the block that sets ICMP redirects of every interface of a router with Linux."""
    text = f'for file in /proc/sys/net/ipv4/conf/*/send_redirects; do echo {value} > "$file"; done'
    return Block(text, kinds=(ROUTER,))


# uci, with `nat` and `rule` in the firewall, and a file for sysctl: openwrt.org/docs/guide-user/network.
_OPENWRT_FORGET = Block(
    "for section in $({{ uci -q show network; uci -q show firewall; }} | sed -n 's/^\\([a-z]*\\.rosfleet_[a-z0-9_]*\\)=.*/\\1/p'); do\n"
    '    uci delete "$section"\n'
    "done"
)
_OPENWRT_RELOAD = Block(
    "uci commit network\nuci commit firewall\n/etc/init.d/network reload\n/etc/init.d/firewall reload"
)
# Raw rules with notrack leave out both translation and "drop invalid": help.mikrotik.com, Firewall, RAW. If a computer
# answers its neighbour directly, the router sees half of a connection. The default firewall would drop it as invalid.
_ROUTEROS_FORGET = Block(
    '/ip route remove [find comment~"^{mark}"]\n'
    '/ip firewall raw remove [find comment~"^{mark}"]\n'
    "/ip firewall address-list remove [find list=rosfleet]"
)

#: name -> dialect, in the order of lists
DIALECTS: Mapping[str, Dialect] = {
    "openwrt": Dialect(
        title="OpenWrt 21.02 and later (uci)",
        suffix="sh",
        use="Paste it into a shell of the device.",
        again=REPLACES,
        interfaces={ROUTER: "lan", GATEWAY: "wan"},
        add=(
            _OPENWRT_FORGET,
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
            _OPENWRT_RELOAD,
            Block(
                "printf 'net.ipv4.conf.%s.send_redirects=0\\n' all default > /etc/sysctl.d/90-rosfleet-multimaster.conf",
                kinds=(ROUTER,),
            ),
            _set_redirects(0),
        ),
        remove=(
            _OPENWRT_FORGET,
            _OPENWRT_RELOAD,
            Block("rm -f /etc/sysctl.d/90-rosfleet-multimaster.conf", kinds=(ROUTER,)),
            _set_redirects(1),
        ),
    ),
    "routeros": Dialect(
        title="MikroTik RouterOS 7",
        suffix="rsc",
        use="Paste it into a terminal of the device, or copy it there and /import it.",
        again=REPLACES,
        add=(
            _ROUTEROS_FORGET,
            Block('/ip route add dst-address={network} gateway={gateway} comment="{mark}: {robot}"', each=ROUTES),
            Block('/ip firewall address-list add list=rosfleet address={own} comment="{mark}"'),
            Block(
                '/ip firewall address-list add list=rosfleet address={network} comment="{mark}: {robot}"', each=PEERS
            ),
            Block(
                "/ip firewall raw add chain=prerouting action=notrack src-address-list=rosfleet dst-address-list=rosfleet "
                'dst-address-type=!local comment="{mark}"'
            ),
            Block("/ip settings set send-redirects=no", kinds=(ROUTER,)),
        ),
        remove=(_ROUTEROS_FORGET, Block("/ip settings set send-redirects=yes", kinds=(ROUTER,))),
        notes=dict.fromkeys(
            (ROUTER, GATEWAY), "The maker's firewall lets untracked packets pass; one of your own must do so, too."
        ),
    ),
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
    "ios": Dialect(
        title="Cisco IOS",
        suffix="txt",
        comment="! ",
        use="Paste it in configuration mode (configure terminal); afterwards: write memory.",
        interfaces={ROUTER: "GigabitEthernet0/0", GATEWAY: "GigabitEthernet0/0"},
        add=(
            Block("ip route {network.network_address} {network.netmask} {gateway}", each=ROUTES),
            Block("interface {interface}\n no ip redirects\nexit", kinds=(ROUTER,)),
            Block("end"),
        ),
        remove=(
            Block("no ip route {network.network_address} {network.netmask} {gateway}", each=ROUTES),
            Block("interface {interface}\n ip redirects\nexit", kinds=(ROUTER,)),
            Block("end"),
        ),
        notes={
            GATEWAY: "If 'ip nat inside source' translates towards the common network, its access list must deny it and the "
            "networks above."
        },
    ),
    "linux": Dialect(
        title="Linux (ip route)",
        suffix="sh",
        use="Copy it to the device and run it as root.",
        add=(
            Block("set -eu"),
            Block("ip route replace {network} via {gateway}", each=ROUTES),
            _set_redirects(0),
        ),
        remove=(
            Block("set -eu"),
            Block("ip route del {network} via {gateway} 2> /dev/null || true", each=ROUTES),
            _set_redirects(1),
        ),
        notes={
            ROUTER: "A reboot forgets it: have it run at every boot.",
            GATEWAY: "A reboot forgets it: have it run at every boot.\n"
            "Rules that masquerade towards the common network must leave out that and the networks above.",
        },
    ),
}
