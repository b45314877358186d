# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The common network as a tunnel of WireGuard, on real systems. wireguard-go makes it where the kernel cannot.

ana-pc and dan-gate are reached at their endpoints; bob-pc speaks first, and changes its address; dan-arm is behind dan-gate. The order
of the tests is that of a day.
"""

import json
import re
import shutil
import sysconfig

import pytest
from machines.layout import Extra
from machines.podman import ROOT
from setups.links import wait_until

INVENTORY = ROOT / "tests" / "systems" / "tunnel"
ANA, BOB, GATE, ARM = HOSTS = ("ana-pc", "bob-pc", "dan-gate", "dan-arm")
INSIDE = (ANA, BOB, GATE)
KEYS = "multimaster_tunnel_keys.txt"
CLOSED = """nft 'table inet fault { chain one { type filter hook input priority filter; udp dport 51820 drop; };
chain two { type filter hook output priority filter; udp dport 51820 drop; }; }'"""
# Where bob-pc has ansible-core and this collection, to run a module by hand.
ANSIBLE, COLLECTIONS = "/opt/ansible", "/opt/collections"
MOUNTS = (
    f"{sysconfig.get_path('purelib')}:{ANSIBLE}",
    f"{ROOT}:{COLLECTIONS}/ansible_collections/rosfleet/multimaster",
)
BY_HAND = (
    f"PYTHONPATH={ANSIBLE}:{COLLECTIONS} python3 -B -m ansible_collections.rosfleet.multimaster.plugins.modules.tunnel"
    " /run/arguments; rm /run/arguments"
)
UNDO = """nft delete table inet fault 2> /dev/null; ip link set eth0 mtu 1500
ip route del 10.77.0.24 dev eth0 2> /dev/null; systemctl restart multimaster-tunnel"""
LEFT = """ls -d /etc/rosfleet-multimaster /etc/wireguard/* /etc/systemd/system/nftables.service.d 2> /dev/null
ip -o link show multimaster0 2> /dev/null; nft list tables | grep rosfleet"""


@pytest.fixture(scope="module")
def lab(new_lab, tmp_path_factory):
    """The robots after site.yml. The keys are kept beside the inventory, so it is a copy."""
    inventory = tmp_path_factory.mktemp("tunnel") / "inventory"
    shutil.copytree(INVENTORY, inventory)
    with new_lab("systems-tunnel", inventory, {BOB: Extra((), MOUNTS)}) as found:
        status, output = found.play("site.yml")
        assert status == 0, output
        yield found


def changed(output):
    """Read the recap: the number of changes by computer."""
    return {
        host: int(number) for host, number in re.findall(r"(\S+-(?:pc|gate|arm))\s+: ok=\d+\s+changed=(\d+)", output)
    }


def repair(lab, *options):
    status, output = lab.play("site.yml", *options)
    assert status == 0, output
    return changed(output)


def key_of(lab, host):
    return lab.run(host, "wg show multimaster0 public-key").strip()


def assert_passes(lab):
    status, output = lab.play("playbooks/verify.yml")
    assert status == 0 and "PASSED" in output, output


def assert_one_finding(lab, sentence):
    status, output = lab.play("playbooks/verify.yml")
    assert status != 0 and f"Findings: 1. {sentence}" in output, output
    assert " 2. " not in output.partition("Findings:")[2].partition("FAILED:")[0], output


def test_everything_is_proved_inside_the_tunnel(lab):
    assert_passes(lab)
    assert repair(lab) == dict.fromkeys(HOSTS, 0)


def test_no_private_key_leaves_its_computer(lab):
    kept = (lab.inventory / KEYS).read_text()
    for host in INSIDE:
        private = lab.run(host, "cat /etc/wireguard/multimaster0.key").strip()
        assert lab.run(host, "stat -c %a:%U /etc/wireguard/multimaster0.key").strip() == "600:root"
        assert private not in kept and key_of(lab, host) in kept
        assert private not in lab.run(
            host, "cat /etc/rosfleet-multimaster/* 2> /dev/null; journalctl --boot --no-pager"
        )
        status, output = lab.module(host, "tunnel_key", {"rotate": False})
        assert status == 0 and key_of(lab, host) in output and private not in output
    assert lab.run(ARM, "ls /etc/wireguard", check=False).strip() == ""


def test_only_the_tunnel_is_seen_on_the_network_below(lab):
    """Nothing of ROS is in the clear: of UDP and TCP there is the tunnel alone, and the ssh of the lab by its socket."""
    seen = lab.run(ANA, "timeout 6 tcpdump -n -i eth0 -c 200 'udp or tcp' 2> /dev/null", check=False).split("\n")
    lines = [line for line in seen if line.strip()]
    assert lines and all(".51820 > " in line and ".51820: UDP" in line for line in lines)
    inside = lab.run(ANA, "timeout 6 tcpdump -n -i multimaster0 -c 2 'udp port 11511' 2> /dev/null", check=False)
    assert ".11511: UDP" in inside  # heartbeats


def test_a_guard_that_somebody_removed_is_found_and_comes_back(lab):
    """test_guard.py has what it does."""
    lab.run(GATE, "nft flush chain inet rosfleet_multimaster guard")
    assert_one_finding(lab, f"the packet filter of {GATE} is not as planned")
    assert repair(lab)[GATE] == 1
    assert repair(lab) == dict.fromkeys(HOSTS, 0)


def run_by_hand(lab, **arguments):
    """Run the module on bob-pc without a controller that confirms; returns its answer."""
    lab.run(BOB, "cat > /run/arguments", stdin=json.dumps({"ANSIBLE_MODULE_ARGS": arguments}))
    return json.loads(lab.run(BOB, BY_HAND, check=False))


def test_a_tunnel_that_nobody_confirms_is_taken_back(lab):
    path, ways = "/etc/rosfleet-multimaster/multimaster0.conf", "wg show multimaster0 allowed-ips"
    text, before = lab.run(BOB, f"cat {path}"), sorted(lab.run(BOB, ways).splitlines())
    alone = {"path": path, "content": text.partition("\n# ana-pc")[0] + "\n", "mode": "0600"}
    answer = run_by_hand(lab, files=[alone], confirm_within=5, confirmation="word")
    assert answer["unconfirmed"] and not lab.run(BOB, ways) and lab.run(BOB, f"cat {path}") == text
    wait_until(lambda: sorted(lab.run(BOB, ways, check=False).splitlines()) == before, 20, "its peers are back")
    assert not lab.run(BOB, "ls -d /run/rosfleet-multimaster/tunnel-on-trial 2> /dev/null", check=False)
    broken = {**alone, "content": text.replace("[Interface]", "[Nothing]")}
    answer = run_by_hand(lab, files=[broken], confirm_within=5, confirmation="another")
    assert answer["failed"] and "does not come up" in answer["msg"]
    assert sorted(lab.run(BOB, ways).splitlines()) == before
    assert repair(lab) == dict.fromkeys(HOSTS, 0)
    assert_passes(lab)


@pytest.mark.parametrize(
    ("host", "command", "sentence"),
    [
        (BOB, "systemctl stop multimaster-tunnel", "multimaster-tunnel.service does not run on bob-pc"),
        (ANA, CLOSED, "nothing comes through the tunnel of ana-pc"),
        (
            ANA,
            "wg genkey > /run/other; wg set multimaster0 private-key /run/other; rm /run/other",
            "the key of ana-pc is not the one that others have of it",
        ),
        (
            ANA,
            "wg set multimaster0 peer $(wg show multimaster0 allowed-ips | grep 10.77.0.22 | cut -f1) remove",
            "ana-pc has other peers in its tunnel than planned: bob-pc",
        ),
        (BOB, "ip link set eth0 mtu 1300", "the network that carries the tunnel of bob-pc takes packets of 1300 bytes"),
        (
            BOB,
            "ip route add 10.77.0.24 via 192.168.28.24 dev eth0",
            "packets of bob-pc for 10.77.0.24 take another route than the tunnel",
        ),
    ],
    ids=["stopped", "closed", "key", "peer", "mtu", "beside"],
)
def test_a_fault_of_the_tunnel_is_the_one_finding(lab, host, command, sentence):
    lab.run(host, command)
    try:
        assert_one_finding(lab, sentence)
    finally:
        lab.run(host, UNDO)


def test_a_robot_that_changes_its_address_is_back_in_seconds(lab):
    """Its address in the tunnel stays. wireguard-go keeps its old source until the next handshake, after 15 s.

    It would take another one where sendmsg(2) gives EINVAL for a source that is gone; Linux 6.18 gives ENETUNREACH.
    """
    lab.start(ANA, "pings", "ping -D -n -i 0.2 10.77.0.22")
    wait_until(lambda: "icmp_seq=5" in lab.run(ANA, "cat /run/pings.out"), 20, "answers before")
    lab.run(
        BOB,
        "ip address flush dev eth0 scope global; ip address add 192.168.28.77/24 dev eth0; ip route replace default via 192.168.28.1 dev eth0 onlink",
    )
    wait_until(
        lambda: "192.168.28.77:" in lab.run(ANA, "wg show multimaster0 endpoints"), 40, "ana-pc knows the new address"
    )
    lab.run(ANA, "sleep 3")
    lab.stop(ANA, "pings")
    times = [float(at) for at in re.findall(r"\[(\d+\.\d+)\] 64 bytes", lab.run(ANA, "cat /run/pings.out"))]
    assert max(after - before for before, after in zip(times, times[1:], strict=False)) < 20
    assert_passes(lab)


def test_a_tunnel_that_was_started_again_passes_at_once(lab):
    """The others have sessions that it has lost. bob-pc notices that after 15 s."""
    lab.run(ANA, "systemctl restart multimaster-tunnel")
    assert_passes(lab)


def test_a_changed_key_is_refused_until_it_is_asked_for(lab):
    before = {host: key_of(lab, host) for host in INSIDE}
    lab.run(BOB, "umask 077; wg genkey > /etc/wireguard/multimaster0.key")
    status, output = lab.play("site.yml")
    assert status != 0 and "bob-pc: its public key is " in output and "tunnel_rotate=true" in output, output
    assert key_of(lab, BOB) == before[BOB]  # nothing has changed
    assert repair(lab, "--limit", "!bob") == dict.fromkeys((ANA, GATE, ARM), 0)  # as after a rotation that broke off
    repair(lab, "-e", "tunnel_rotate=true")
    after = {host: key_of(lab, host) for host in INSIDE}
    assert not {*before.values()} & {*after.values()} and len({*after.values()}) == 3
    assert_passes(lab)
    assert repair(lab) == dict.fromkeys(HOSTS, 0)


def test_one_new_key_is_known_after_a_whole_run(lab):
    """The robot alone makes it, and uses it at once; the others have its place from the kept file."""
    before = key_of(lab, BOB)
    assert repair(lab, "--limit", "bob", "-e", "tunnel_rotate=true") == {BOB: 3}
    assert key_of(lab, BOB) != before
    repair(lab)
    assert_passes(lab)


def test_a_run_without_a_robot_knows_its_key(lab):
    assert repair(lab, "--limit", "ana:bob") == dict.fromkeys((ANA, BOB), 0)


def test_a_robot_without_an_endpoint_is_reached_by_the_hub(lab):
    hosts, shared = lab.inventory / "hosts.yml", lab.inventory / "group_vars" / "robots.yml"
    before = {path: path.read_text() for path in (hosts, shared)}
    hosts.write_text(before[hosts].replace("multimaster_endpoint: 192.168.28.24", ""))
    shared.write_text(before[shared] + "multimaster_tunnel_hub: ana-pc\n")
    repair(lab)
    assert repair(lab) == dict.fromkeys(HOSTS, 0)
    assert_passes(lab)
    assert "ttl=62 " in lab.run(BOB, "ping -c1 -W2 192.168.29.2")  # by ana-pc and dan-gate
    lab.run(ANA, "sysctl -q -w net.ipv4.ip_forward=0")
    try:
        assert_one_finding(lab, "ana-pc drops packets for other networks")
    finally:
        lab.run(ANA, "sysctl -q -w net.ipv4.ip_forward=1")
    for path, text in before.items():
        path.write_text(text)
    repair(lab)


def test_a_reboot_brings_the_tunnel_back(lab):
    lab.reboot(GATE)
    lab.wait_until_up(GATE)
    wait_until(
        lambda: "ok" in lab.run(ARM, "ping -c1 -W1 10.77.0.21 > /dev/null && echo ok", check=False),
        60,
        "dan-arm reaches ana-pc",
    )
    assert_passes(lab)


def test_who_is_taken_out_of_the_inventory_is_out(lab):
    hosts = lab.inventory / "hosts.yml"
    hosts.write_text(re.sub(r"    bob:\n.*?(?=    dan:)", "", hosts.read_text(), flags=re.DOTALL))
    repair(lab)
    assert "10.77.0.22" not in lab.run(ANA, "wg show multimaster0 allowed-ips")
    assert lab.run(BOB, "ping -c1 -W1 10.77.0.21 > /dev/null || echo nothing").strip() == "nothing"
    assert "bob-pc" not in (lab.inventory / KEYS).read_text()
    assert_passes(lab)


def test_a_teardown_leaves_no_tunnel_and_no_key(lab):
    status, output = lab.play("playbooks/teardown.yml")
    assert status == 0, output
    assert {host: lab.run(host, LEFT, check=False).strip() for host in (ANA, GATE, ARM)} == dict.fromkeys(
        (ANA, GATE, ARM), ""
    )
