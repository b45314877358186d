# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The unit of the tunnel."""

from __future__ import annotations

from ..._plan.hooks import UnitHooks

_TUNNEL = """\
# Managed by rosfleet.multimaster: the tunnel to the other robots, of the robot {robot}
[Unit]
Description=Tunnel of this computer of {robot} to the other robots (WireGuard)
Documentation=https://github.com/rosfleet/multimaster
# Its address is there without a network, and so is its port: who comes back is heard from whatever address.
After=network-pre.target
Before=multimaster-address.service multimaster-roscore.service multimaster-discovery.service multimaster-sync.service

[Service]
Type=oneshot
RemainAfterExit=yes
Environment=ROSFLEET_INPUTS={inputs}
# An earlier start may have left it, as a wireguard-go that was killed.
ExecStartPre=-/sbin/ip link delete dev multimaster0
ExecStart=/usr/bin/wg-quick up {configuration}/multimaster0.conf
ExecStop=/usr/bin/wg-quick down {configuration}/multimaster0.conf
# Root, since the key is root's, with only the rights of a network manager.
CapabilityBoundingSet=CAP_NET_ADMIN
# The one device that wireguard-go needs, if the kernel has no WireGuard.
DeviceAllow=/dev/net/tun rw
BindPaths=-/dev/net/tun
ReadWritePaths=/run
ProtectHome=yes
RestrictAddressFamilies=AF_INET AF_INET6 AF_NETLINK AF_UNIX
MemoryMax=256M
TasksMax=256
{sandbox}"""

HOOKS = UnitHooks(services={"tunnel": _TUNNEL})
