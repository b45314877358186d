# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The dialect of OpenWrt: uci, with `nat` and `rule` in the firewall, and a file for sysctl.

See openwrt.org/docs/guide-user/network.
"""

from __future__ import annotations

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.dialect import (
    GATEWAY,
    PEERS,
    REPLACES,
    ROUTER,
    ROUTES,
    Block,
    Dialect,
)

_FORGET = Block(
    "for section in $({{ uci -q show network; uci -q show firewall; }} | sed -n 's/^\\([a-z]*\\.rosfleet_[a-z0-9_]*\\)=.*/\\1/p'); do\n"
    '    uci delete "$section"\n'
    "done"
)
_RELOAD = Block("uci commit network\nuci commit firewall\n/etc/init.d/network reload\n/etc/init.d/firewall reload")
DIALECT = Dialect(
    position=1,
    title="OpenWrt 21.02 and later (uci)",
    suffix="sh",
    comment="# ",
    use="Paste it into a shell of the device.",
    again=REPLACES,
    first_line="#!/bin/sh",
    interfaces={ROUTER: "lan", GATEWAY: "wan"},
    add=(
        _FORGET,
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
        _RELOAD,
        Block(
            "printf 'net.ipv4.conf.%s.send_redirects=0\\n' all default > /etc/sysctl.d/90-rosfleet-multimaster.conf\n"
            'for file in /proc/sys/net/ipv4/conf/*/send_redirects; do echo 0 > "$file"; done',
            kinds=(ROUTER,),
        ),
    ),
    remove=(
        _FORGET,
        _RELOAD,
        Block(
            "rm -f /etc/sysctl.d/90-rosfleet-multimaster.conf\n"
            'for file in /proc/sys/net/ipv4/conf/*/send_redirects; do echo 1 > "$file"; done',
            kinds=(ROUTER,),
        ),
    ),
)
