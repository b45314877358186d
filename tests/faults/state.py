# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The state of a computer that a fault may change, read by a short command: the same as before the fault, and the fleet is green again."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping

UNITS = "multimaster-roscore multimaster-discovery multimaster-sync"
# What runs and what is configured; then, on a master, which robots its discovery lists.
LOOK = f"""
ip -4 -brief address; ip -4 route; ip -4 rule; ip -4 neighbour show nud permanent; ip -o link | grep -o NOARP
cat /sys/class/net/*/mtu; nft --stateless list ruleset; cat /etc/hosts
sysctl net.ipv4.ip_forward net.ipv4.conf.all.rp_filter net.ipv4.ip_default_ttl net.ipv4.icmp_echo_ignore_all net.ipv4.conf.all.arp_ignore
find /etc/sysctl.d /etc/network /etc/systemd/system /etc/rosfleet-multimaster /etc/cloud /etc/ld.so* -type f,l | sort | xargs sha256sum 2>/dev/null
systemctl is-enabled {UNITS}; systemctl is-active {UNITS}
systemctl list-units --plain --no-legend 'fault-*'; mount | grep '^fault'
find /run -maxdepth 1 -name 'fault*'; find /run/systemd/system -name 'fault*'
"""
MASTERS = """
rosservice call /master_discovery/list_masters 2>/dev/null | grep -E '^ *(name|online):' | paste - - | sort
"""
PATIENCE, PAUSE = 60.0, 1.0  # seconds


def look(lab, hosts: Iterable[str], masters: Iterable[str]) -> dict[str, str]:
    """The state of each computer, as a text."""
    return {host: lab.run(host, LOOK + (MASTERS if host in masters else ""), check=False) for host in hosts}


def back(lab, before: Mapping[str, str], masters: Iterable[str]) -> list[str]:
    """Wait until the fleet is as before; return what still differs after a while, a line each."""
    waiting, deadline = list(before), time.monotonic() + PATIENCE
    while True:
        now = look(lab, waiting, masters)
        waiting = [host for host in waiting if now[host] != before[host]]
        if not waiting or time.monotonic() > deadline:
            return [line for host in waiting for line in differences(host, before[host], now[host])]
        time.sleep(PAUSE)


def differences(host: str, before: str, now: str) -> list[str]:
    """The lines that only one of two states has."""
    old, new = before.splitlines(), now.splitlines()
    gone = [f"{host}: missing: {line}" for line in old if line not in new]
    return gone + [f"{host}: new: {line}" for line in new if line not in old] or [f"{host}: another order of lines"]
