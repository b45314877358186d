# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The tunnel with the WireGuard of a machine's own kernel, and its guard: by packets, at each moment at which the guard could be away, and at a boot.

The stranger is at the bridge of the lab, outside of the machines. The order of the tests is that of a day. Half an hour if nothing else runs.
"""

import collections
import contextlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from machines import virtual
from machines.layout import hosts_of, read_inventory
from machines.podman import ROOT
from setups.links import wait_until

INVENTORY = Path(__file__).with_name("tunnel")
ANA, BOB = HOSTS = ("ana-pc", "bob-pc")
INSIDE = {ANA: "10.77.0.11", BOB: "10.77.0.12"}
BELOW = {ANA: "192.168.1.11", BOB: "192.168.1.12"}
STRANGER, LAPTOP = "192.168.1.254", "10.77.0.99"  # the bridge, and who is in multimaster_allow
# Below 1024, where everybody may come in: what the stranger sends in its own name shows that its packets arrive.
PORT = 900
GROUP, GROUP6 = "226.0.0.0", "ff02::77"
PACE = 0.05  # seconds
FORGED = [(source, place) for source in (INSIDE[BOB], LAPTOP) for place in (BELOW[ANA], INSIDE[ANA])]
FORGED.append((f"::ffff:{INSIDE[BOB]}", GROUP6))
HONEST = f"{STRANGER} > {BELOW[ANA]}"
# Hears from before the first moment at which the network is up.
HEARER = f"""
[Unit]
DefaultDependencies=no
Wants=network-pre.target
Before=network-pre.target
[Service]
ExecStartPre=/bin/sh -c 'until [ -e /sys/class/net/eth0 ]; do sleep 0.1; done; rm -f /run/heard'
ExecStart=/usr/bin/python3 /root/hearer.py eth0 {PORT} {GROUP} {GROUP6}
ExecStartPost=/bin/sh -c 'until grep -q listens /run/heard; do sleep 0.1; done'
StandardOutput=append:/run/heard
[Install]
WantedBy=sysinit.target
"""
# bob says to ana by the tunnel that it is there.
TELL = f"while :; do echo -n tunnel >/dev/udp/{INSIDE[ANA]}/{PORT}; sleep 0.2; done 2>/dev/null"
MOMENTS = (
    "systemctl restart multimaster-tunnel",
    "systemctl stop multimaster-tunnel; sleep 2; systemctl start multimaster-tunnel",
    *(f"systemctl {deed} nftables" for deed in ("start", "reload", "restart", "stop")),
    *(f"systemctl {deed} multimaster-firewall" for deed in ("restart", "reload")),
)
LEFT = """ls -d /etc/rosfleet-multimaster /etc/wireguard/* /etc/systemd/system/nftables.service.d 2>/dev/null
ip -o link show multimaster0 2>/dev/null; nft list tables | grep rosfleet"""


@pytest.fixture(scope="module")
def lab(new_machines, tmp_path_factory):
    """The robots after site.yml. The keys are kept beside the inventory, so it is a copy."""
    inventory = tmp_path_factory.mktemp("tunnel") / "inventory"
    shutil.copytree(INVENTORY, inventory)
    with new_machines("machines-tunnel", hosts_of(read_inventory(inventory)), inventory) as found:
        found.write(ANA, "/root/hearer.py", (ROOT / "lab/nodes/observers/hearer.py").read_text())
        found.write(ANA, "/etc/systemd/system/hearer.service", HEARER)
        found.write(BOB, "/root/tell.sh", TELL)
        found.run(ANA, "systemctl enable hearer")
        status, output = found.play("site.yml")
        assert status == 0, output
        yield found


@contextlib.contextmanager
def stranger(lab):
    """A stranger sends to ana, in the names of others and in its own, within the block."""
    mac = lab.run(ANA, "cat /sys/class/net/eth0/address").strip()
    words = json.dumps([["udp", *packet] for packet in [*FORGED, (STRANGER, BELOW[ANA])]])
    again = (
        'for _round in 1 2 3 4 5; do "$@" <<<"$PACKETS" >/dev/null || exit; done'  # two minutes each: it ends by itself
    )
    forger = [sys.executable, str(ROOT / "lab/nodes/hostile/forger.py"), "br0", mac, str(PORT), "120", str(PACE)]
    with subprocess.Popen(
        ["ip", "netns", "exec", virtual.namespace(lab.name), "bash", "-c", again, "forger", *forger],
        env={**os.environ, "PACKETS": words},
        start_new_session=True,
    ) as process:
        try:
            yield
        finally:
            os.killpg(process.pid, signal.SIGKILL)


def heard(lab):
    """How many datagrams have come to ana since its hearer was started, by their text."""
    return collections.Counter(lab.run(ANA, "sleep 1; cat /run/heard").splitlines()[1:])


def count(lab, *actions):
    """What came to ana while things happened to it."""
    lab.run(ANA, "systemctl restart hearer")
    lab.start(BOB, "tell", "bash /root/tell.sh")
    with stranger(lab):
        wait_until(lambda: {HONEST, "tunnel"} <= heard(lab).keys(), 120, "what is honest comes")
        for action in actions:
            action()
            before = heard(lab)
            wait_until(
                lambda before=before: all(heard(lab)[word] > before[word] + 5 for word in (HONEST, "tunnel")),
                120,
                "it still comes",
            )
        return heard(lab)


def moment(lab, unit, name):
    """When something has happened to a unit of ana, in microseconds since the boot."""
    return int(lab.run(ANA, f"systemctl show --value --property={name}TimestampMonotonic {unit}"))


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


def test_nothing_comes_in_beside_the_tunnel(lab):
    found = count(lab, *(lambda command=command: lab.run(ANA, command) for command in MOMENTS))
    assert found.keys() == {HONEST, "tunnel"} and found[HONEST] > 100, found


def test_nor_does_it_at_a_boot(lab):
    def boot():
        virtual.reboot(lab.name, ANA)
        lab.set_clock(ANA)

    found = count(lab, boot)  # what came since the boot
    assert found.keys() == {HONEST, "tunnel"} and found[HONEST] > 20, found
    guard, hearer = (moment(lab, unit, "ActiveEnter") for unit in ("multimaster-firewall", "hearer"))
    assert max(guard, hearer) < moment(lab, "systemd-networkd", "InactiveExit")


def test_without_the_guard_it_does(lab):
    """Or the other tests could not fail."""
    found = count(lab, lambda: lab.run(ANA, "nft flush chain inet rosfleet_multimaster guard"))
    assert f"{LAPTOP} > {BELOW[ANA]}" in found, found
    lab.run(ANA, "systemctl reload multimaster-firewall")


def test_the_fleet_talks(lab):
    """After all of that."""
    status, output = lab.play("playbooks/verify.yml")
    assert status == 0 and "PASSED" in output, output


def test_a_second_run_changes_nothing(lab):
    status, output = lab.play("site.yml")
    assert status == 0 and re.findall(r"-pc\s+: ok=\d+\s+changed=(\d+)", output) == ["0", "0"], output


def test_a_teardown_leaves_no_tunnel_and_no_key(lab):
    status, output = lab.play("playbooks/teardown.yml")
    assert status == 0, output
    assert {host: lab.run(host, LEFT, check=False).strip() for host in HOSTS} == dict.fromkeys(HOSTS, "")
