# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The dialect of MikroTik RouterOS.

Raw rules with notrack leave out both translation and "drop invalid": help.mikrotik.com, Firewall, RAW. If a computer
answers its neighbour directly, the router sees half of a connection. The default firewall would drop it as invalid.
"""

from __future__ import annotations

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.dialect import (
    GATEWAY,
    MARK,
    PEERS,
    REPLACES,
    ROUTER,
    ROUTES,
    Block,
    Dialect,
)

_FORGET = Block(
    '/ip route remove [find comment~"^' + MARK + '"]\n'
    '/ip firewall raw remove [find comment~"^' + MARK + '"]\n'
    "/ip firewall address-list remove [find list=rosfleet]"
)
DIALECT = Dialect(
    position=2,
    title="MikroTik RouterOS 7",
    suffix="rsc",
    comment="# ",
    use="Paste it into a terminal of the device, or copy it there and /import it.",
    again=REPLACES,
    interfaces={},
    add=(
        _FORGET,
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
    remove=(_FORGET, Block("/ip settings set send-redirects=yes", kinds=(ROUTER,))),
    notes=dict.fromkeys(
        (ROUTER, GATEWAY), "The maker's firewall lets untracked packets pass; one of your own must do so, too."
    ),
)
