# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The time since when a component is broken, if a machine shows it. Pure: a component and the facts of its place in, a text out.

A service has a time of its own. The kernel notes no time for its settings, routes and rules. So a file is named only if it decides
the fault: its line, its value, or its table of the packet filter was read.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from ipaddress import IPv4Network

from ..components.component import Component
from ..context.check_context import FleetState, Participant
from ..observe.observations import BootDeviation, Probe, ServiceState

SERVICES = ("roscore", "discovery", "sync")
LATER = ("hung", "stale", "untold", "full", "stopped")  # these begin some time after the start, which says nothing
FEW = 4  # changes of a link that are usual: it comes when the computer starts
# A fault of the kernel's settings -> the settings, and the value that is wrong; a file counts if it sets this value.
SETTINGS: Mapping[tuple[str, str], tuple[str, str]] = {
    ("forwarding", "off"): (r"net\.ipv4\.(ip_forward|conf\..+\.forwarding)", "0"),
    ("reverse_path", "strict"): (r"net\.ipv4\.conf\..+\.rp_filter", "1"),
    ("redirects", "sent"): (r"net\.ipv4\.conf\..+\.send_redirects", "1"),
    ("setting", "icmp_group"): (r"net\.ipv4\.icmp_echo_ignore_broadcasts", "1"),
}
# A maker of packet filters -> the tables and chains that are its own, as "family table chain".
MAKERS: Mapping[str, str] = {
    "ufw": r"ip6? filter ufw6?-.*",
    "firewalld": r"(inet|ip|ip6) firewalld .*",
    "docker": r"ip6? [a-z]+ DOCKER.*",
    "libvirtd": r"ip6? ([a-z]+ LIBVIRT_.*|libvirt_network .*)",
    "fail2ban": r"(ip6? filter|inet f2b-table) f2b-.*",
}


def describe_onset(component: Component, computer: Participant | None, state: FleetState) -> str:
    """Return since when; empty if it is not known."""
    if computer is None:
        return ""
    probe = computer.probe
    if component.kind in (*SERVICES, "service"):
        return _service_time(
            [entry for entry in probe.services if component.kind == entry.name or component.what == entry.unit],
            component.mode,
        )
    if (component.kind, component.mode) == ("environment", "service"):
        return _service_time([entry for entry in probe.services if entry.differing], "runs")
    if component.kind == "link":
        return "; ".join(_link_history(probe))
    files = (f"{entry.file} was changed {entry.when}" for entry in probe.next_boot if _decides(entry, component, state))
    deciding = _find_subjects(component, computer, state)
    changes = (f"{entry.what} {entry.how} {entry.when}" for entry in probe.changes if entry.about in deciding)
    return "; ".join(dict.fromkeys([*files, *changes]))


def _service_time(services: list[ServiceState], mode: str) -> str:
    """A service that has ended is so since it changed its state; one that runs with something wrong has it since its start."""
    times = [entry.since for entry in services if entry.since]
    if not times or mode in LATER:
        return ""
    return f"it ended {times[0]}" if mode in ("dead", "down") else f"it was started {times[0]}"


def _link_history(probe: Probe) -> Iterable[str]:
    """Return the last word of the journal about an interface that is down, and how often a link came and went."""
    for entry in probe.forwarding.interfaces:
        if entry.last:
            yield f"the journal's last line about {entry.interface}: {entry.last}"
        elif (entry.carrier_changes or 0) > FEW:
            yield f"the link of {entry.interface} came or went {entry.carrier_changes} times"


def _decides(entry: BootDeviation, component: Component, state: FleetState) -> bool:
    """Return True if a file that differs from the plan is the reason of a fault."""
    if not entry.when:
        return False
    if component.kind == "boot":
        return entry.kind == component.mode and (not component.what or entry.name == component.what)
    if entry.kind == "sysctl" and (component.kind, component.mode) in SETTINGS:
        names, value = SETTINGS[component.kind, component.mode]
        return bool(re.fullmatch(names, entry.name.strip('"')) and re.search(rf" sets {value}\b", entry.found))
    return (
        component.kind == "route"
        and component.mode == "missing"
        and entry.kind == "route"
        and _leads(entry, component, state)
    )


def _leads(entry: BootDeviation, component: Component, state: FleetState) -> bool:
    """Return True if the route of a file, such as "192.168.11.0/24 by 192.168.1.201", leads to the network of a component; without one to any."""
    try:
        destination = IPv4Network(entry.name.strip('"').partition(" by ")[0].replace("default", "0.0.0.0/0"))
    except ValueError:
        return False
    names = state.fleet.network_names.items()
    return not component.what or any(
        name == component.what and network.subnet_of(destination) for network, name in names
    )


def _find_subjects(component: Component, computer: Participant, state: FleetState) -> set[str]:
    """Find the changes that concern a component, by their `about`."""
    if component.kind == "names":
        return {"order"} if component.mode == "order" else {"names"} if _is_in_file(component, computer) else set()
    origins = state.filters.list_origins(component)
    makers = {maker for maker, own in MAKERS.items() if any(re.fullmatch(own, origin) for origin in origins)}
    tables = {f"table {origin.rpartition(' ')[0]}" for origin in origins}
    return makers if len(makers) == 1 else tables if not makers else set()


def _is_in_file(component: Component, computer: Participant) -> bool:
    """Return True if a line of /etc/hosts gives a name one of its wrong addresses."""
    member = computer.members.get(component.what)
    return member is not None and any(
        address in member.file_addresses for address in member.addresses if address != member.address
    )
