# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The common part of VyOS and EdgeOS, both from Vyatta. They name translation and redirects differently."""

from __future__ import annotations

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.dialect import (
    ADDS,
    GATEWAY,
    PEERS,
    ROUTER,
    ROUTES,
    Block,
    Dialect,
)


def vyatta(position: int, title: str, nat: str, outbound: str, last: str, redirects: str) -> Dialect:
    """Return a dialect: `nat` is the rule for translation, `redirects` the setting for ICMP redirects."""
    begin = Block("configure\ndelete firewall group network-group ROSFLEET")
    end = Block("commit\nsave\nexit")
    note = f"The rule '{nat}' must be free, and before those that translate."
    return Dialect(
        position=position,
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
            ROUTER: note,
            GATEWAY: f"{note}\nA firewall must let the common network and the networks above pass.",
        },
    )
