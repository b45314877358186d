# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""One machine: a controller that is cut off, power that goes meanwhile, a disk that is full or read-only, settings of modules that come late.

A quarter of an hour if nothing else runs.
"""

import json

import pytest
import vm
from machines import virtual
from machines.podman import ROOT
from setups.links import wait_until

NAME, HOST, WITHIN = "machines-alone", "ana", 20
# The lab's way in comes from the last address of the network: this route leads the answers to nobody.
CUT = {"destination": "192.168.1.254/32", "gateway": "192.168.1.5"}
HARMLESS = {"destination": "10.70.1.0/24", "gateway": "192.168.1.5"}
STATE = """find /etc -newer /run/began -type f ! -name '*.timestamp' ! -name 'adjtime'; ls /var/lib/rosfleet-multimaster/*.json 2>/dev/null
ip route; ip rule; cat /proc/sys/net/ipv4/ip_default_ttl; nft list ruleset"""
DROPS = ROOT / "plugins/module_utils/_probe/trace/drops.py"
# A listener of the packet trace beside one that was killed, and a packet that a rule drops meanwhile.
LISTEN = """
import os, subprocess, sys
sys.path.insert(0, "/run")
from drops import DropReasons
if not os.fork():
    DropReasons().__enter__()
    os.kill(os.getpid(), 9)
os.wait()
left = os.listdir("/sys/kernel/tracing/instances")
with DropReasons() as reasons:
    subprocess.call(["ping", "-c", "3", "-i", "0.2", "-W", "1", "127.0.0.9"], stdout=subprocess.DEVNULL)
    print(len(left), reasons.read().get("drop reason NETFILTER_DROP"), os.listdir("/sys/kernel/tracing/instances") == left)
print(os.listdir("/sys/kernel/tracing/instances"))
"""
TRIAL = "multimaster-rollback-routes"


@pytest.fixture(scope="module")
def lab(new_machines):
    with new_machines(NAME, [vm.make_host(HOST, ["192.168.1.11/24"], "networkd", "bookworm")]) as found:
        found.run(HOST, "touch /var/lib/began")
        yield found


@pytest.fixture
def before(lab):
    return state(lab)


def state(lab):
    """The traces of a change: files of today, records, routes, rules."""
    return lab.run(HOST, STATE.replace("/run/began", "/var/lib/began"))


def cut_off(lab, seconds):
    """A change that cuts the controller off, and is taken back after so many seconds. The controller is killed after the block."""
    arguments = json.dumps({"routes": [CUT], "confirm_within": seconds})
    return lab.controller("ansible", HOST, "-m", "rosfleet.multimaster.routes", "-a", arguments)


def is_cut_off(lab):
    return "192.168.1.5" in lab.run(HOST, "ip route show 192.168.1.254")


def test_a_controller_that_is_cut_off_is_let_in_again(lab, before):
    status, output = lab.module(HOST, "routes", {"routes": [CUT], "confirm_within": WITHIN})
    assert status != 0 and "were not confirmed over a new connection within" in output, output
    assert '"rolled_back": true' in output, output
    assert state(lab) == before
    assert lab.run(HOST, f"systemctl list-units --all --no-legend '{TRIAL}*'") == ""


@pytest.mark.parametrize("end", ["reboot", "power"])
def test_a_boot_lets_the_controller_in_again(lab, before, end):
    """The switch waits for ten minutes, in which the machine boots."""
    with cut_off(lab, 600):
        wait_until(lambda: is_cut_off(lab), 600, "the route cuts the controller off")
        assert f"{TRIAL}.timer" in lab.run(HOST, f"systemctl list-units --all --no-legend '{TRIAL}*'")
        if end == "power":
            virtual.cut_power(NAME, HOST)
            virtual.give_power(NAME, HOST)
        else:
            virtual.reboot(NAME, HOST)
        lab.set_clock(HOST)
        assert not is_cut_off(lab)
        assert state(lab) == before
    status, output = lab.module(HOST, "routes", {"routes": []})
    assert status == 0 and '"changed": false' in output, output
    assert (
        lab.run(HOST, "ls -d /var/lib/rosfleet-multimaster 2>/dev/null", check=False) == ""
    )  # no lock of the run that was cut


FILL = "fallocate -l 64G /var/fill 2>/dev/null; dd if=/dev/zero of=/var/fill2 bs=64k 2>/dev/null; dd if=/dev/zero of=/var/fill3 bs=512 2>/dev/null; sync"


def test_a_full_disk_is_named_and_nothing_is_half(lab, before):
    lab.run(HOST, f"{FILL}; df --output=avail / | tail -1", check=False)
    status, output = lab.module(HOST, "routes", {"routes": [HARMLESS]})
    assert status != 0 and "cannot be written (No space left on device)" in output, output
    assert "no file can be made in /tmp" in output, output  # Ansible's own program was helped
    lab.run(HOST, "rm -f /var/fill*; sync")
    assert state(lab) == before
    for changed in ("true", "false"):
        status, output = lab.module(HOST, "routes", {"routes": [HARMLESS]})
        assert status == 0 and f'"changed": {changed}' in output, output
    status, output = lab.module(HOST, "routes", {"routes": []})
    assert status == 0, output
    assert state(lab) == before


def test_a_read_only_disk_is_named_and_nothing_is_half(lab, before):
    """As after errors of an SD card: the kernel remounts the root file system."""
    lab.run(HOST, "echo u >/proc/sysrq-trigger; until grep -q ' / ext4 ro' /proc/mounts; do sleep 0.2; done")
    try:
        status, output = lab.module(HOST, "routes", {"routes": [HARMLESS]})
        assert status != 0 and "read-only" in output.lower(), output
        assert state(lab) == before
    finally:
        lab.run(HOST, "mount -o remount,rw /")
    status, output = lab.module(HOST, "routes", {"routes": [HARMLESS]})
    assert status == 0 and '"changed": true' in output, output
    status, output = lab.module(HOST, "routes", {"routes": []})
    assert status == 0, output
    assert state(lab) == before


def test_a_setting_of_a_module_is_there_when_the_module_comes(lab, before):
    """systemd makes settings before anything loads nf_conntrack."""
    setting = {"name": "net.netfilter.nf_conntrack_max", "value": "70000", "ignore_missing": True}
    read = "modprobe nf_conntrack; udevadm settle; cat /proc/sys/net/netfilter/nf_conntrack_max"
    lab.run(HOST, "modprobe -r nf_conntrack")
    status, output = lab.module(HOST, "sysctl", {"settings": [setting]})
    assert status == 0 and '"changed": true' in output, output
    wait_until(lambda: lab.run(HOST, read) == "70000\n", 30, "the setting is there with the module")
    lab.reboot(HOST)
    assert lab.run(HOST, "ls /proc/sys/net/netfilter/nf_conntrack_max", check=False).startswith("ls: cannot access")
    wait_until(lambda: lab.run(HOST, read) == "70000\n", 30, "the setting is there with the module after a boot")
    status, output = lab.module(HOST, "sysctl", {"settings": []})
    assert status == 0, output
    assert state(lab) == before


def test_the_kernel_tells_the_packet_trace_why_it_drops(lab):
    """tracefs is that of a whole kernel, which containers do not have."""
    lab.write(HOST, "/run/drops.py", DROPS.read_text())
    lab.write(HOST, "/run/listen.py", LISTEN)
    lab.run(HOST, "nft 'table ip fault { chain one { type filter hook input priority 0; ip daddr 127.0.0.9 drop; }; }'")
    try:
        assert lab.run(HOST, "python3 /run/listen.py") == "1 3 True\n[]\n"
    finally:
        lab.run(HOST, "nft delete table ip fault; rm /run/drops.py /run/listen.py")
