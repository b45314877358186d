# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The file and the unit of smcroute on a gateway."""

from __future__ import annotations

from collections.abc import Sequence

from ..._plan import quotes, units

ROUTER_UNIT = "multimaster-multicast-routing.service"
ROUTER_FILE = f"{units.CONFIGURATION}/smcroute.conf"
_ROUTER_HEADER = (
    "# Managed by rosfleet.multimaster: multicast between the network of the robot {robot} and the common network"
)
_ROUTER = """\
{header}
[Unit]
Description=Multicast routing of {robot} for the group {group}
Documentation=https://github.com/rosfleet/multimaster
After=smcroute.service
# It is started again as often as it ends: an interface may come late.
StartLimitIntervalSec=0

[Service]
Environment=ROSFLEET_INPUTS={inputs}
# smcrouted goes on without routes if another program has the kernel's multicast routing, or an interface is not there,
# so both are looked at.
ExecStartPre=/bin/sh -c '! grep -q "^ *[0-9]" /proc/net/ip_mr_vif || \
{{ echo "Another program routes multicast already, perhaps smcroute.service: stop and disable it." >&2; exit 1; }}'
ExecStart={command} -n -N -s -f {file}
ExecStartPost=/bin/sh -c 'for try in $$(seq 150); do \
grep -qF " $$1 " /proc/net/ip_mr_vif && grep -qF " $$2 " /proc/net/ip_mr_vif && exit; sleep 0.2; done; \
echo "smcrouted does not route between $$1 and $$2: are both up?" >&2; exit 1' sh {names}
Restart=always
RestartSec=5
# Root, as smcrouted demands, but with only the rights of a router.
CapabilityBoundingSet=CAP_NET_ADMIN CAP_NET_RAW
# Its socket and its number are there.
ReadWritePaths=/run
ProtectHome=yes
RestrictAddressFamilies=AF_INET AF_INET6 AF_UNIX AF_NETLINK
MemoryDenyWriteExecute=yes
MemoryMax=64M
TasksMax=64
{sandbox}
# It gives the file of its number its owner.
SystemCallFilter=@chown"""


def render_router(robot: str, group: str, interfaces: Sequence[str], command: str, inputs: str) -> units.Unit:
    """The unit of smcrouted on a gateway; `command` is its path, `inputs` the digest of its file."""
    text = units.complete(
        _ROUTER,
        header=_ROUTER_HEADER.format(robot=quotes.escape_text(robot)),
        robot=quotes.escape_text(robot),
        group=quotes.escape_text(group),
        inputs=quotes.escape_text(inputs),
        command=quotes.check_program(command),
        file=ROUTER_FILE,
        names=" ".join(quotes.quote_argument(interface) for interface in interfaces),
    )
    return {"name": ROUTER_UNIT, "content": text}


def render_routes(robot: str, group: str, interfaces: Sequence[str]) -> str:
    """The file of smcrouted (smcroute.conf(5)): the group passes both ways between two interfaces."""
    lines = [f"phyint {interface} enable" for interface in interfaces]
    lines += [f"mgroup from {interface} group {group}" for interface in interfaces]
    ways = [tuple(interfaces), tuple(reversed(interfaces))]
    lines += [f"mroute from {source} group {group} to {target}" for source, target in ways]
    return "\n".join([_ROUTER_HEADER.format(robot=robot), *lines, ""])
