# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Packets that come in beside the tunnel in the name of robots, each 5 ms, through each moment at which the guard could be away.

ana-pc has nothing else that filters packets, bob-pc has ufw, dan-gate has firewalld, and dan-arm is behind it. A stranger is on the network
that carries the tunnel. The order of the tests is that of a day.
"""

import json
import shutil
import sysconfig
import time

import pytest
from machines.layout import Extra
from machines.podman import ROOT
from setups import forgery
from setups.links import wait_until
from setups.packet_filters import FILTERS, STRANGER

INVENTORY = ROOT / "tests" / "systems" / "tunnel"
ANA, BOB, GATE, ARM = HOSTS = ("ana-pc", "bob-pc", "dan-gate", "dan-arm")
PROGRAMS = {ANA: "nftables", BOB: "ufw", GATE: "firewalld"}
INSIDE = {ANA: "10.77.0.21", BOB: "10.77.0.22", GATE: "10.77.0.24"}
BELOW = {ANA: "192.168.28.21", BOB: "192.168.28.254", GATE: "192.168.28.24"}
INNER, LAPTOP = "192.168.29.2", "10.77.0.99"  # dan-arm, and who is in multimaster_allow
# Where bob-pc has ansible-core and this collection, to run a module by hand.
ANSIBLE, COLLECTIONS = "/opt/ansible", "/opt/collections"
MOUNTS = (
    f"{sysconfig.get_path('purelib')}:{ANSIBLE}",
    f"{ROOT}:{COLLECTIONS}/ansible_collections/rosfleet/multimaster",
)
# Hears from the first moment of a boot on. A container's interface is up before its systemd; that of a machine is not.
EARLY = f"""
[Unit]
DefaultDependencies=no
Before=network-pre.target multimaster-firewall.service
[Service]
ExecStartPre=/bin/sh -c '[ -e /run/booted ] || ip link set eth0 down'
ExecStart=/usr/bin/python3 /root/hearer.py eth0 {forgery.PORT} {forgery.GROUP} {forgery.GROUP6}
StandardOutput=append:/root/heard
[Install]
WantedBy=sysinit.target
"""

TUNNEL = tuple(f"systemctl {deed} multimaster-tunnel" for deed in ("restart", "stop", "start"))
FLUSHES = tuple(f"systemctl {deed} nftables" for deed in ("start", "reload", "reload", "reload", "restart", "stop"))
MOMENTS = {
    "tunnel": (ANA, TUNNEL),
    "nftables": (ANA, FLUSHES),
    "own-unit": (ANA, ("systemctl restart multimaster-firewall", "systemctl reload multimaster-firewall")),
    "ufw-tunnel": (BOB, TUNNEL),
    "ufw": (BOB, ("ufw reload", "ufw disable", "ufw --force enable", "systemctl restart ufw")),
    "ufw-nftables": (BOB, (*FLUSHES, "ufw reload")),
    "firewalld-tunnel": (GATE, TUNNEL),
    "firewalld": (
        GATE,
        (
            "firewall-cmd --reload",
            "firewall-cmd --complete-reload",
            "systemctl stop firewalld",
            "systemctl start firewalld",
        ),
    ),
    "firewalld-nftables": (GATE, (*FLUSHES, "systemctl restart firewalld")),
}


@pytest.fixture(scope="module")
def lab(new_lab, tmp_path_factory):
    """The robots after site.yml, each with its own packet filter from before."""
    inventory = tmp_path_factory.mktemp("guard") / "inventory"
    shutil.copytree(INVENTORY, inventory)
    shared = inventory / "group_vars" / "robots.yml"
    shared.write_text(f"{shared.read_text()}multimaster_allow: [{LAPTOP}]\nmultimaster_answer_broadcast_pings: false\n")
    extras = {STRANGER: Extra(("192.168.28.99/24",)), BOB: Extra((), MOUNTS)}
    with new_lab("systems-guard", inventory, extras) as found:
        for host, program in PROGRAMS.items():
            found.run(host, FILTERS[program].before)
        status, output = found.play("site.yml")
        assert status == 0, output
        yield found


def make_attack(host, at=None):
    """In the name of other robots, of an inner computer and of who is allowed, to both addresses; and an IPv4 address within IPv6."""
    sources = [address for other, address in INSIDE.items() if other != host] + [INNER, LAPTOP]
    packets = [(source, place) for source in sources for place in (BELOW[host], INSIDE[host])]
    packets.append((f"::ffff:{sources[0]}", forgery.GROUP6))
    sender = BOB if host == ANA else ANA
    return forgery.Attack(STRANGER, host if at is None else at, host, packets, (sender, INSIDE[host]))


def commands(lab, host, *words):
    def carry_out(command):
        lab.run(host, command)
        time.sleep(0.3)

    return [lambda command=command: carry_out(command) for command in words]


def assert_kept_out(found, least=100):
    """Nothing came but what is honest, while the stranger has sent for seconds."""
    assert found.keys() == {"honest", "rounds"} and found["rounds"] > least and found["honest"] > 50, found


@pytest.mark.parametrize("moment", MOMENTS)
def test_nothing_comes_in_beside_the_tunnel(lab, moment):
    host, words = MOMENTS[moment]
    # After a restart of the tunnel the others speak with its former keys, for 15 s (the timers of WireGuard).
    wait_until(lambda: forgery.count(lab, make_attack(host), ())["honest"], 60, "what is honest comes")
    assert_kept_out(forgery.count(lab, make_attack(host), commands(lab, host, *words)))


@pytest.mark.parametrize("host", INSIDE)
def test_without_the_guard_it_does(lab, host):
    """Or the other tests could not fail."""
    words = "nft flush chain inet rosfleet_multimaster guard", "systemctl reload multimaster-firewall"
    found = forgery.count(lab, make_attack(host), commands(lab, host, *words))
    assert {f"{source} > {BELOW[host]}" for source in (INNER, LAPTOP)} <= found.keys(), found


def run_by_hand(lab, module, **arguments):
    """Run a module on bob-pc without a controller that confirms; returns its answer."""
    command = f"PYTHONPATH={ANSIBLE}:{COLLECTIONS} python3 -B -m ansible_collections.rosfleet.multimaster.plugins.modules.{module}"
    lab.run(BOB, "cat > /run/arguments", stdin=json.dumps({"ANSIBLE_MODULE_ARGS": arguments}))
    return json.loads(lab.run(BOB, f"{command} /run/arguments; rm /run/arguments", check=False))


def test_nor_does_it_while_a_change_is_taken_back(lab):
    """A tunnel without peers, and a packet filter with one more member, which nobody confirms."""
    path = "/etc/rosfleet-multimaster/multimaster0.conf"
    alone = {"path": path, "content": lab.run(BOB, f"cat {path}").partition("\n# ana-pc")[0] + "\n", "mode": "0600"}
    guards = [{"networks": ["10.77.0.0/24", "192.168.29.0/24"], "interface": "multimaster0"}]
    members, ways = [*INSIDE.values(), "192.168.29.1", INNER, LAPTOP], "wg show multimaster0 allowed-ips"

    def take_back():
        peers = lab.run(BOB, ways)
        last = {"confirm_within": 3, "confirmation": "word"}
        assert run_by_hand(lab, "tunnel", files=[alone], **last)["unconfirmed"]
        wait_until(
            lambda: sorted(lab.run(BOB, ways, check=False).split()) == sorted(peers.split()), 120, "its peers are back"
        )
        open_ports = ["51820/udp"]
        answer = run_by_hand(
            lab, "firewall", members=[*members, "10.5.0.1"], guards=guards, open_ports=open_ports, **last
        )
        assert answer["unconfirmed"] and "10.5.0.1" in lab.run(BOB, "iptables -S")
        wait_until(lambda: "10.5.0.1" not in lab.run(BOB, "iptables -S"), 120, "the rules are back")

    assert_kept_out(forgery.count(lab, make_attack(BOB), [take_back]))


def test_a_gateway_keeps_it_from_a_computer_without_nft(lab):
    """In the name of the tunnel's robots and of the inner network itself."""
    sources = (INSIDE[ANA], INSIDE[BOB], LAPTOP, "192.168.29.9")
    attack = forgery.Attack(STRANGER, GATE, ARM, [(source, INNER) for source in sources], (ANA, INNER))
    lab.run(ARM, "nft delete table inet rosfleet_multimaster; mv /usr/sbin/nft /usr/sbin/nft.away")
    try:
        words = (*TUNNEL, "firewall-cmd --reload", *FLUSHES, "systemctl restart firewalld")
        assert_kept_out(forgery.count(lab, attack, commands(lab, GATE, *words)))
        words = "nft flush chain inet rosfleet_multimaster guard", "systemctl reload multimaster-firewall"
        found = forgery.count(lab, attack, commands(lab, GATE, *words))
        assert f"{LAPTOP} > {INNER}" in found, found
    finally:
        lab.run(ARM, "mv /usr/sbin/nft.away /usr/sbin/nft; systemctl restart multimaster-firewall")


def test_an_inner_computer_takes_it_from_its_gateway_alone(lab):
    """dan-arm has a second interface, to a network of a stranger's."""
    rule = lab.run(ARM, "nft list chain inet rosfleet_multimaster guard")
    assert 'iifname != { "lo", "eth0" } ip saddr { 10.77.0.0/24, 192.168.29.0/24 } drop' in " ".join(rule.split()), rule


def boot(lab, host):
    """Boot a computer during the attack; returns what it has heard since before that."""
    lab.run(host, "cat > /root/hearer.py", stdin=(ROOT / "lab/nodes/observers/hearer.py").read_text())
    lab.run(
        host,
        "cat > /etc/systemd/system/early.service; touch /run/booted; systemctl enable --now early; sleep 0.5",
        stdin=EARLY,
    )
    attack = make_attack(host, at="")
    forgery.send(lab, attack)
    try:
        lab.run(host, "sleep 0.5")
        lab.reboot(host)
        lab.wait_until_up(host)
        lab.run(host, "sleep 3")
        forgery.stop(lab, attack)
        lines = lab.run(host, "cat /root/heard").splitlines()
    finally:
        lab.run(host, "systemctl disable --now early; rm /root/heard /etc/systemd/system/early.service")
    assert lines.count("listens") == 2, lines
    return {line for line in lines if line != "listens"}


@pytest.mark.parametrize("host", INSIDE)
def test_nothing_comes_in_at_a_boot(lab, host):
    assert boot(lab, host) <= {"honest"}
    wait_until(lambda: forgery.count(lab, make_attack(host), ())["honest"], 60, "what is honest comes again")


def test_without_its_unit_it_comes_in_at_a_boot(lab):
    """Or the test before could not fail."""
    lab.run(
        ANA, "systemctl mask --now multimaster-firewall 2> /dev/null || systemctl disable --now multimaster-firewall"
    )
    try:
        assert f"{LAPTOP} > {BELOW[ANA]}" in boot(lab, ANA)
    finally:
        lab.run(ANA, "systemctl unmask multimaster-firewall; systemctl enable --now multimaster-firewall")


def test_a_teardown_leaves_no_guard(lab):
    status, output = lab.play("playbooks/teardown.yml")
    assert status == 0, output
    left = "nft list tables | grep rosfleet; ls /etc/systemd/system/nftables.service.d /etc/rosfleet-multimaster 2> /dev/null"
    assert {host: lab.run(host, left, check=False) for host in HOSTS} == dict.fromkeys(HOSTS, "")
