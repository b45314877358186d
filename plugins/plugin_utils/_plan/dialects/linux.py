# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The dialect of a router or gateway with Linux outside the inventory."""

from __future__ import annotations

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.dialect import (
    ADDS,
    GATEWAY,
    ROUTER,
    ROUTES,
    Block,
    Dialect,
)

DIALECT = Dialect(
    position=6,
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
