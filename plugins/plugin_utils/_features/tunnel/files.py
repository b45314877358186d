# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The file that wg-quick reads on a computer of the tunnel. Pure: the plan and public keys in. No private key is in it."""

from __future__ import annotations

from collections.abc import Mapping

from ..._base.plain_text import LINE, plain
from ..._plan import units
from .keys import is_key
from .model import INTERFACE, Tunnel

CONFIGURATION = f"{units.CONFIGURATION}/{INTERFACE}.conf"
# Made by the module tunnel_key; a unit test compares the two.
KEY = f"/etc/wireguard/{INTERFACE}.key"
# Seconds after which a computer that has changed its address is heard from its new one.
KEEPALIVE = 3

_HEADER = "# Managed by rosfleet.multimaster: the tunnel of this computer\n"
# wg-quick(8). The private key stays in its own file, and the routes have the gateways of the plan. The public half is given here,
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


def render_tunnel(tunnel: Tunnel | None, keys: Mapping[str, str]) -> list[dict[str, str]]:
    """Return the files as managed_files takes them. `keys` are public ones by computer; a computer without a key yet is no peer."""
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
