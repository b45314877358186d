# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The dialect of Cisco IOS."""

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
    position=5,
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
