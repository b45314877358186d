# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The sizes of the plan of one computer, as the modules make it there: names, routes, and the rules of each packet filter."""

from __future__ import annotations

import time
from typing import Any

from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.firewall.backends import (
    firewalld,
    nftables,
    ufw,
)
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.firewall.packet_filter import read_options
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.hosts import bindings, plan
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain import to_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import FleetPlan

BEFORE = b"127.0.0.1\tlocalhost\n"  # of /etc/hosts
UFW = "*filter\n### RULES ###\n\n### END RULES ###\nCOMMIT\n"  # a file of ufw without rules
INTERFACES = {"{common}": "eth0", "{own}": "eth1"}


def measure_computer(fleet: FleetPlan, name: str) -> dict[str, Any]:
    """Measure the plan of a computer: its sizes, and the seconds of a processor in which the modules make it."""
    data, own = to_plain(fleet), fleet.computers[name]
    filter_of_it = data["computers"][name]["firewall"]
    guards = [{**guard, "interface": INTERFACES[guard["interface"]]} for guard in filter_of_it["guards"]]
    options = {**filter_of_it, "members": data["let_in"], "guards": guards, "ssh_ports": []}
    began = time.process_time()
    names = plan.plan(BEFORE, bindings.bindings_of(data["hosts_entries"]))
    packet_filter = read_options(options, [])
    assert packet_filter is not None
    table = nftables.render_table(packet_filter)
    of_ufw = ufw.list_rules(packet_filter, (4, 6))
    ufw.arrange(UFW, of_ufw, "")
    of_firewalld = firewalld.BackEnd(True, packet_filter).plan_rules(packet_filter)
    return {
        "computer": "gateway" if own.is_gateway else "behind it",
        "seconds": time.process_time() - began,
        "names": len(names.entries),
        "hosts_bytes": len(names.content or b""),
        "routes": len(own.routes),
        "nftables_bytes": len(table),
        "ufw_rules": len(of_ufw),
        "firewalld_rules": len(of_firewalld),
    }
