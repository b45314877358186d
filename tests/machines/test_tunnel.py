# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The tunnel with the WireGuard of a machine's own kernel, after site.yml."""

import shutil
from pathlib import Path

import pytest
from machines.layout import hosts_of, read_inventory

INVENTORY = Path(__file__).with_name("tunnel")
ANA, BOB = HOSTS = ("ana-pc", "bob-pc")


@pytest.fixture(scope="module")
def lab(new_machines, tmp_path_factory):
    """The robots after site.yml. The keys are kept beside the inventory, so it is a copy."""
    inventory = tmp_path_factory.mktemp("tunnel") / "inventory"
    shutil.copytree(INVENTORY, inventory)
    with new_machines("machines-tunnel", hosts_of(read_inventory(inventory)), inventory) as found:
        status, output = found.play("site.yml")
        assert status == 0, output
        yield found


def test_the_kernel_makes_the_tunnel(lab):
    for host in HOSTS:
        assert "wireguard" in lab.run(host, "ip -d link show multimaster0")
        found = lab.run(host, "ls -d /sys/module/wireguard; ps -e | grep wireguard-go", check=False)
        assert found == "/sys/module/wireguard\n"
        assert lab.run(host, "systemctl is-active multimaster-tunnel") == "active\n"


def test_only_the_tunnel_is_seen_on_the_network_below(lab):
    """But for the lab's own way in."""
    seen = lab.run(ANA, "timeout 10 tcpdump -n -i eth0 -c 200 '(udp or tcp) and not port 22' 2>/dev/null", check=False)
    lines = [line for line in seen.splitlines() if line.strip()]
    assert len(lines) > 2 and all(".51820 > " in line and ".51820: UDP" in line for line in lines), seen
    inside = lab.run(ANA, "timeout 20 tcpdump -n -i multimaster0 -c 2 'udp port 11511' 2>/dev/null", check=False)
    assert ".11511: UDP" in inside  # heartbeats
