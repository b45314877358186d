# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The tunnel that is the common network: what wg-quick reads on a computer, and the public keys of the others.

Pure: the plan, public keys and a description of the machine in, texts and sentences out. A private key is in none of them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from ipaddress import IPv4Network
from typing import Any

from .._base.plain_text import LINE, plain, quote
from . import units
from .model import ComputerPlan, Tunnel

INTERFACE = "multimaster0"
CONFIGURATION = f"{units.CONFIGURATION}/{INTERFACE}.conf"
# Made by the module tunnel_key; a unit test compares the two.
KEY = f"/etc/wireguard/{INTERFACE}.key"
MTU = 1420  # bytes; what wg-quick takes over a network of 1500
# Seconds after which a computer that has changed its address is heard from its new one.
KEEPALIVE = 3

# 43 letters have two bits more than 32 bytes. These are 0 in the one spelling of a key.
_KEY = re.compile("[A-Za-z0-9+/]{42}[AEIMQUYcgkosw048]=")
_HEADER = "# Managed by rosfleet.multimaster: the tunnel of this computer\n"
# wg-quick(8). The private key stays in its own file, and the routes have the gateways of the plan. The public half is told here,
# since a new key is a change that starts the tunnel again.
_INTERFACE = """\
[Interface]
# PublicKey = {public}
Address = {tunnel.address}/{tunnel.network.prefixlen}
ListenPort = {tunnel.port}
{hub}Table = off
PostUp = wg set %i private-key {key}
{routes}"""
# A computer that becomes the hub starts its tunnel again: the new interface sends no ICMP redirects (plan.NO_REDIRECTS).
_HUB = "# The hub: it passes packets on between its peers.\n"
_ROUTE = "PostUp = ip route replace {route.destination} via {route.gateway} dev %i\n"
_PEER = """
# {computer}
[Peer]
PublicKey = {key}
AllowedIPs = {networks}
{endpoint}PersistentKeepalive = {keepalive}
"""


def is_key(text: object) -> bool:
    """Say if a text is a public key: 32 bytes in base64, in the one spelling that wg(8) takes."""
    return isinstance(text, str) and _KEY.fullmatch(text) is not None


def render_tunnel(tunnel: Tunnel | None, keys: Mapping[str, str]) -> list[dict[str, str]]:
    """Return the files as managed_files takes them. `keys` are public ones by computer; who has none yet is no peer."""
    if tunnel is None:
        return []
    text = _INTERFACE.format(
        tunnel=tunnel,
        public=keys.get(tunnel.computer, "(made in this run)"),
        hub=_HUB if tunnel.hub else "",
        routes="".join(_ROUTE.format(route=route) for route in tunnel.routes),
        key=KEY,
    )
    peers = "".join(
        _PEER.format(
            computer=plain(peer.computer, LINE),
            key=keys[peer.computer],
            networks=", ".join(map(str, peer.networks)),
            endpoint=f"Endpoint = {peer.endpoint}:{tunnel.port}\n" if peer.endpoint else "",
            keepalive=KEEPALIVE,
        )
        for peer in tunnel.peers
        if is_key(keys.get(peer.computer))
    )
    return [{"path": CONFIGURATION, "content": _HEADER + text + peers, "mode": "0600"}]


def add_interface(plan: ComputerPlan, info: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return what multimaster_info found, with the interface of the tunnel as it will be."""
    tunnel = plan.tunnel
    if tunnel is None or any(entry["name"] == INTERFACE for entry in info["interfaces"]):
        return info
    planned = {
        "name": INTERFACE,
        "up": True,
        "loopback": False,
        "multicast": False,
        "point_to_point": True,
        "addresses": [{"address": str(tunnel.address), "prefix": tunnel.network.prefixlen, "family": "inet"}],
    }
    return {**info, "interfaces": [*info["interfaces"], planned]}


def list_tunnel_packages(tunnel: Tunnel | None, info: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the packages that the tunnel needs."""
    if tunnel is None:
        return ()
    return ("wireguard-tools", *(() if info["tunnel"]["kernel"] else ("wireguard-go",)))


def find_tunnel_problems(plan: ComputerPlan, info: Mapping[str, Any]) -> Iterator[str]:
    """Yield a sentence for somebody else's tunnel with the same address, and for a machine that can have no tunnel."""
    tunnel = plan.tunnel
    if tunnel is None:
        return
    places = [(of["name"], entry) for of in info["interfaces"] for entry in of["addresses"]]
    found = [name for name, entry in places if entry["address"] == str(tunnel.address) and name != INTERFACE]
    if found:
        there = ", ".join(map(quote, dict.fromkeys(found)))
        yield (
            f"{plan.computer}: {tunnel.address} is already on {there}, and multimaster_tunnel is 'wireguard'; expected nobody else's tunnel "
            "with this address: end that one, or set multimaster_tunnel to 'none' and use it as it is (docs/operate/hostile_networks.md)."
        )
    beside = [
        f"{entry['address']}/{entry['prefix']} on {quote(name)}"
        for name, entry in places
        if name != INTERFACE and entry["address"] != str(tunnel.address) and _overlaps(entry, tunnel.network)
    ]
    if beside:
        yield (
            f"{plan.computer}: {', '.join(beside)} is in the network of the tunnel, {tunnel.network}; expected no other interface there, since packets "
            "for robots would leave by it beside the tunnel: give one of the two another network."
        )
    if not info["tunnel"]["device"] and not info["tunnel"]["kernel"]:
        yield (
            f"{plan.computer}: the kernel has no WireGuard, and there is no /dev/net/tun, as in some containers; expected one of the two for the "
            "tunnel: load the module (modprobe wireguard), or give the container this device."
        )
    if not info["systemd"]["net_admin"]:
        yield (
            f"{plan.computer}: systemd has no CAP_NET_ADMIN, as in some containers; expected it for multimaster-tunnel.service: give the "
            "container this capability."
        )


def _overlaps(entry: Mapping[str, Any], network: IPv4Network) -> bool:
    """Say if the network of an address of an interface overlaps another one."""
    if entry.get("family", "inet") != "inet":
        return False
    return IPv4Network(f"{entry['address']}/{entry['prefix']}", strict=False).overlaps(network)


# The keys of all computers, as they are kept beside the inventory


class WrongKeys(ValueError):
    """Keys that are not to be believed; the text is the sentence about them."""


def read_keys(text: str) -> dict[str, str]:
    """Read the kept keys: a computer and its key on each line. Raises WrongKeys."""
    keys: dict[str, str] = {}
    for number, line in enumerate(text.splitlines(), 1):
        words = line.partition("#")[0].split()
        if not words:
            continue
        if len(words) != 2 or not is_key(words[1]) or words[0] in keys or words[1] in keys.values():
            raise WrongKeys(
                f"line {number} is {quote(line, LINE)}; expected the name of a computer and its public key, each computer and each key once"
            )
        keys[words[0]] = words[1]
    return keys


def write_keys(keys: Mapping[str, str]) -> str:
    """Write the keys, in the order of the computers."""
    head = "# The public keys of the tunnel, by computer: written by rosfleet.multimaster, and nothing secret.\n"
    return head + "".join(f"{computer} {keys[computer]}\n" for computer in sorted(keys))


def join_keys(
    kept: Mapping[str, str], told: Mapping[str, object], computers: Mapping[str, ComputerPlan], rotate: bool
) -> tuple[dict[str, str], dict[str, str]]:
    """Join the kept keys with those that computers have told of themselves. Return them, and a sentence for each computer that is refused.

    What one tells costs itself alone: it has the kept key then, or none. A computer that is no longer in the plan loses its place. A
    key that has changed is believed only where that was asked for, and never where it is the kept one of another computer.
    """
    inside = {name for name, plan in computers.items() if plan.tunnel}
    keys = {computer: key for computer, key in kept.items() if computer in inside}
    new = {
        computer: key for computer, key in told.items() if computer in inside and key not in ("", keys.get(computer))
    }
    reasons = {computer: _find_objection(computer, key, keys, new, rotate) for computer, key in new.items()}
    refused = {computer: reason for computer, reason in reasons.items() if reason}
    keys.update({computer: str(key) for computer, key in new.items() if computer not in refused})
    return keys, {computer: f"{computer}: {reason}" for computer, reason in refused.items()}


def _find_objection(
    computer: str, key: object, kept: Mapping[str, str], new: Mapping[str, object], rotate: bool
) -> str:
    """Say why a key that a computer has told is not believed; empty if it is."""
    if not is_key(key):
        return f"its public key is {quote(key, LINE)}; expected 32 bytes in base64: find out who answers there"
    owners = [other for other, one in (*kept.items(), *new.items()) if one == key and other != computer]
    if owners:
        return (
            f"its public key is that of {owners[0]}, too; expected a key of its own: one of them is a copy of the other, so run site.yml with "
            "-e tunnel_rotate=true"
        )
    if computer in kept and not rotate:
        return (
            f"its public key is {key}, and was {kept[computer]} before; expected the same: if you have set it up anew, run site.yml with "
            "-e tunnel_rotate=true, and else find out who answers there"
        )
    return ""
