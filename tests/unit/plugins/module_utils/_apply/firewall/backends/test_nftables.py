# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""nftables: the table against real packets with any source, and the sentences for computers that cannot have it.

Three network namespaces: a stranger, a gateway and what is behind it. ../test_run.py has runs of the module.
"""

import contextlib
import json
import os
import random
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.firewall.backends import contract, nftables
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.firewall.packet_filter import (
    Guard,
    OpenPort,
    PacketFilter,
)
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.commands import Answer
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem
from mentioned import mentions
from namespaces import why_not

NODES = Path(__file__).parents[7] / "lab" / "nodes"
TOOLS = ("nft", "unshare", "nsenter", "ip", "sysctl")
PORT, GROUP, GROUP6 = 5000, "226.0.0.0", "ff02::77"
CARELESS = [
    f"net.ipv4.conf.{name}.{setting}"
    for name in ("all", "out", "in")
    for setting in ("accept_local=1", "route_localnet=1", "rp_filter=0")
]
STRANGER, VICTIM, INNER, MEMBER = "10.9.0.1", "10.9.0.2", "10.8.0.9", "10.9.0.77"
GLOBAL = {"stranger": "fd00:9::1", "victim": "fd00:9::2", "inner": "fd00:8::9"}
WANTED = PacketFilter((VICTIM, MEMBER, "10.8.0.1", INNER), ("10.8.0.0/24",), ())


SMALL = PacketFilter(("10.5.0.1",), (), ())
# Members whose addresses come in at one interface only: at one that is not there, or at the inner one.
GUARDS = (Guard(("10.7.0.0/24", "fd00:7::/64"), "tun0"), Guard(("10.8.0.0/24",), "in"))
GUARDED = PacketFilter(("10.7.0.0/24", "fd00:7::/64", "10.8.0.0/24", MEMBER), ("10.8.0.0/24",), (), guards=GUARDS)


def test_a_computer_without_nft(monkeypatch):
    monkeypatch.setattr(contract, "find_program", lambda _name: "")
    with pytest.raises(Problem, match=r"^There is no nft, expected it .* install it \(apt-get install nftables\)"):
        nftables.BackEnd(False, SMALL)


def test_guards_beside_another_back_end_wait_for_nft(monkeypatch):
    """It is installed between the look at all computers and the change."""
    monkeypatch.setattr(contract, "find_program", lambda _name: "")
    back_end = nftables.BackEnd(False, GUARDED._replace(members=()))
    assert back_end.changes and any("10.7.0.0/24" in line for line in back_end.after)
    with pytest.raises(Problem, match=r"^There is no nft, expected it .* install it \(apt-get install nftables\)\.$"):
        back_end.try_out()


FLUSHES = """
[Service]
ExecStart=/usr/sbin/nft -f /etc/nftables.conf
 ExecReload = /usr/sbin/nft -f /etc/nftables.conf
ExecStop=/usr/sbin/nft flush ruleset
"""


@pytest.mark.parametrize(
    ("fragment", "drop_in", "together"),
    [
        (FLUSHES, "[Unit]\nAfter=my.service", True),
        (FLUSHES, "[Service]\nExecStartPost=/usr/local/sbin/more-rules", False),
        (FLUSHES.replace("/etc/nftables.conf", "/etc/mine.conf"), "", False),
        ("", "", False),
    ],
    ids=["debian", "drop-in", "fragment", "none"],
)
def test_only_what_debian_has_nftables_service_do_is_replaced(monkeypatch, fragment, drop_in, together):
    texts = {"/lib/x.service": fragment, "/etc/x.conf": drop_in, nftables.DROP_IN: "ExecStart=\nExecStart=ours"}
    paths = {"FragmentPath": "/lib/x.service", "DropInPaths": f"{nftables.DROP_IN} /etc/x.conf"}
    monkeypatch.setattr(nftables, "text", texts.get)
    monkeypatch.setattr(nftables.systemd, "states", lambda units, properties: [paths])
    back_end = nftables.BackEnd(False, None)
    back_end.booted = True
    (content,) = [file["content"] for file in back_end.plan_files(SMALL) if file["path"] == nftables.DROP_IN]
    lines = content.splitlines()
    assert ("ExecStart=" in lines) is together
    assert lines[-3:] == [
        f"{name}=-/usr/sbin/nft -f {nftables.RULES_FILE}" for name in ("ExecStartPost", "ExecReload", "ExecStopPost")
    ]


def test_a_kernel_without_nftables(monkeypatch):
    said = "Error: Could not process rule: Operation not supported\n" + "table inet rosfleet_multimaster\n" * 100
    monkeypatch.setattr(contract, "find_program", lambda name: "/usr/sbin/" + name)
    monkeypatch.setattr(contract, "run_command", lambda _argv: Answer(1, b"", said))
    with pytest.raises(Problem, match="^This computer does not take the packet filter") as found:
        nftables.BackEnd(False, SMALL)
    assert mentions(str(found.value), "nft", "Operation not supported")
    assert "set multimaster_firewall to none" in str(found.value) and len(str(found.value)) < 500


def test_a_container_that_may_make_no_network_namespace(monkeypatch):
    """The real unshare, without the right: as another user, or with a limit."""
    ask = contract.run_command
    monkeypatch.setattr(contract, "find_program", lambda name: "/usr/sbin/" + name)
    restricted = ["setpriv", "--bounding-set=-sys_admin", "--inh-caps=-all"] if os.geteuid() == 0 else []
    if restricted and not (shutil.which("setpriv") and may_drop(restricted)):
        pytest.skip("setpriv cannot take the right away here")
    monkeypatch.setattr(contract, "run_command", lambda argv: ask([*restricted, *argv]))
    with pytest.raises(Problem, match="own.*unshare"):
        nftables.BackEnd(False, SMALL)


def may_drop(restricted):
    return subprocess.run([*restricted, "true"], check=False, capture_output=True).returncode == 0


# Packets with any source


class Space:
    """A network namespace, which ends with the process that holds it."""

    def __init__(self):
        self.holder = subprocess.Popen(["unshare", "--net", "sleep", "300"])
        while os.readlink(f"/proc/{self.holder.pid}/ns/net") == os.readlink("/proc/self/ns/net"):
            time.sleep(0.01)
        self("ip link set lo up")

    def words(self, *words):
        return ["nsenter", f"--net=/proc/{self.holder.pid}/ns/net", *words]

    def __call__(self, command, stdin=None):
        done = subprocess.run(self.words(*command.split()), input=stdin, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{command}: {done.stderr}"
        return done.stdout

    def local(self, device):
        """The link-local address of an interface."""
        found = json.loads(self(f"ip -6 -j address show dev {device} scope link"))
        return next(info["local"] for entry in found for info in entry.get("addr_info", ()) if "local" in info)

    def cable(self, device, other, other_device):
        self(f"ip link add {device} type veth peer name {other_device} netns {other.holder.pid}")
        for space, name in ((self, device), (other, other_device)):
            space(f"ip link set {name} up")

    def refused(self):
        """The number of resets that TCP has sent here, as it does to the beginning of a connection from nowhere."""
        lines = [line.split() for line in self("cat /proc/net/snmp").splitlines() if line.startswith("Tcp:")]
        return int(dict(zip(*lines, strict=True))["OutRsts"])

    @contextlib.contextmanager
    def hearing(self, device):
        """Yield what is heard; it is whole at the end."""
        heard = []
        command = self.words(sys.executable, str(NODES / "observers/hearer.py"), device, str(PORT), GROUP, GROUP6)
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            try:
                assert process.stdout.readline() == "listens\n"
                yield heard
                time.sleep(0.3)  # for what the kernel still has under way
            finally:
                process.terminate()  # it prints what it has yet to read
            heard += process.stdout.read().splitlines()


@pytest.fixture(scope="module")
def wires():
    """The stranger, the gateway that is to be the victim, and a computer behind it.

    The victim's kernel is as careless as it can be set: it takes own addresses, loopback addresses and senders by a wrong
    way from a wire.
    """
    if why_not("nft", "list", "ruleset"):
        pytest.skip(why_not("nft", "list", "ruleset"))
    stranger, victim, inner = spaces = [Space() for _number in range(3)]
    try:
        stranger.cable("out", victim, "out")
        victim.cable("in", inner, "in")
        stranger(f"ip address add {STRANGER}/24 dev out")
        stranger(f"ip address add {GLOBAL['stranger']}/64 dev out nodad")
        victim(f"ip address add {VICTIM}/24 dev out")
        victim(f"ip address add {GLOBAL['victim']}/64 dev out nodad")
        victim("ip address add 10.8.0.1/24 dev in")
        inner(f"ip address add {INNER}/24 dev in")
        inner("ip route add default via 10.8.0.1")
        victim(f"sysctl -qw net.ipv4.ip_forward=1 {' '.join(CARELESS)}")
        inner("sysctl -qw net.ipv4.conf.all.rp_filter=0 net.ipv4.conf.in.rp_filter=0")
        end = time.monotonic() + 10
        while "tentative" in victim("ip -6 address show") and time.monotonic() < end:
            time.sleep(0.1)
        yield spaces
    finally:
        for space in spaces:
            space.holder.kill()
            space.holder.wait()


@contextlib.contextmanager
def filtered(victim, wanted=WANTED):
    victim("nft -f -", nftables.render_table(wanted))
    try:
        yield
    finally:
        victim(f"nft delete table inet {nftables.TABLE}")


def send(wires, *packets):
    stranger, victim, _inner = wires
    mac = json.loads(victim("ip -j link show dev out"))[0]["address"]
    stranger(f"{sys.executable} {NODES / 'hostile/forger.py'} out {mac} {PORT}", json.dumps(packets))


def own_addresses(wires):
    """The sources that are the victim's own, by their version: those of each interface, and loopback."""
    victim = wires[1]
    return {
        4: [VICTIM, "10.8.0.1", "127.0.0.1", "127.1.2.3"],
        6: [victim.local("out"), victim.local("in"), GLOBAL["victim"], "::1"],
    }


def packets(wires, sources, protocol="udp"):
    """From each source to each kind of place at the victim."""
    places = {4: [VICTIM, "10.8.0.1", "127.0.0.1", GROUP], 6: [wires[1].local("out"), GLOBAL["victim"], GROUP6]}
    return [(protocol, source, place) for version in (4, 6) for source in sources[version] for place in places[version]]


@pytest.mark.slow
def test_without_the_filter_they_reach_a_port(wires):
    """Or the other tests could not fail."""
    with wires[1].hearing("out") as heard:
        send(wires, *packets(wires, own_addresses(wires)))
    found = {line.split(" > ")[0] for line in heard}
    assert {VICTIM, "10.8.0.1", "127.0.0.1", wires[1].local("out"), GLOBAL["victim"]} <= found


def test_an_own_address_does_not_come_in_from_a_wire(wires):
    with filtered(wires[1]), wires[1].hearing("out") as heard:
        send(wires, *packets(wires, own_addresses(wires)), ("udp", MEMBER, VICTIM), ("udp", STRANGER, VICTIM))
    assert heard == [f"{MEMBER} > {VICTIM}"]


def test_nor_does_the_beginning_of_a_connection(wires):
    """A connection that begins in the computer's own name is answered to itself, which began none."""
    victim, packet = wires[1], ("tcp", GLOBAL["victim"], GLOBAL["victim"])
    with victim.hearing("out"):
        before = victim.refused()
        send(wires, packet)
        time.sleep(0.3)
        assert victim.refused() == before + 1
    with filtered(victim), victim.hearing("out"):
        before = victim.refused()
        send(wires, packet, *packets(wires, own_addresses(wires), "tcp"))
        time.sleep(0.3)
        assert victim.refused() == before


def test_what_the_computer_sends_to_itself_arrives(wires):
    victim = wires[1]
    places = [VICTIM, "10.8.0.1", "127.0.0.1", GROUP, victim.local("out"), GLOBAL["victim"], "::1", GROUP6]
    with filtered(victim), victim.hearing("out") as heard:
        victim(f"{sys.executable} {NODES / 'programs/self_talker.py'} out {PORT} {' '.join(places)}")
    assert sorted(heard) == sorted(f"itself > {place}" for place in places)


def test_a_gateway_passes_on_no_forged_packet_in_its_own_name(wires):
    inner, forged = wires[2], [("udp", source, INNER) for source in (VICTIM, "10.8.0.1", "127.0.0.1")]
    member = ("udp", MEMBER, INNER)
    with inner.hearing("in") as heard:
        send(wires, member, *forged)
    assert f"{MEMBER} > {INNER}" in heard and f"{VICTIM} > {INNER}" in heard
    with filtered(wires[1]), inner.hearing("in") as heard:
        send(wires, member, *forged, ("udp", STRANGER, INNER))
    assert heard == [f"{MEMBER} > {INNER}"]


@pytest.mark.slow
@pytest.mark.parametrize("wanted", [GUARDED, GUARDED._replace(members=(), networks=())], ids=["whole", "beside"])
def test_an_address_comes_in_at_its_interface_alone(wires, wanted):
    """To the computer and through it, of IPv4 and IPv6; also the guards alone, beside another back end."""
    stranger, victim, inner = wires
    forged = [("10.7.0.5", VICTIM), ("10.8.0.9", VICTIM), ("fd00:7::5", GLOBAL["victim"])]
    forged.append(("::ffff:10.7.0.5", GLOBAL["victim"]))  # a socket of IPv6 has such names for senders of IPv4
    passed_on = [("10.7.0.5", INNER), ("10.8.0.77", INNER)]
    mac = json.loads(victim("ip -j link show dev in"))[0]["address"]
    own = json.dumps([("udp", "10.8.0.9", VICTIM), ("udp", "10.7.0.5", VICTIM)])
    for rules, heard_forged in ((contextlib.nullcontext(), True), (filtered(victim, wanted), False)):
        with rules, victim.hearing("out") as heard, inner.hearing("in") as behind:
            send(wires, *(("udp", *packet) for packet in (*forged, *passed_on)), ("udp", MEMBER, VICTIM))
            inner(f"{sys.executable} {NODES / 'hostile/forger.py'} in {mac} {PORT}", own)
        expected = [f"{source} > {place}" for source, place in forged] * heard_forged
        expected += [f"{MEMBER} > {VICTIM}", f"10.8.0.9 > {VICTIM}"] + [f"10.7.0.5 > {VICTIM}"] * heard_forged
        assert sorted(heard) == sorted(expected)
        assert sorted(behind) == sorted([f"{source} > {place}" for source, place in passed_on] * heard_forged)


@pytest.mark.slow
def test_no_packet_passes_while_all_rules_are_loaded_anew(wires, tmp_path):
    """As nftables.service does it with our drop-in, hundreds of times beside packets each 5 ms."""
    stranger, victim, _inner = wires
    others, ours = tmp_path / "nftables.conf", tmp_path / "firewall.nft"
    others.write_text("flush ruleset\ntable inet foreign {\n}\n")
    ours.write_text(nftables.DELETE + nftables.render_table(GUARDED))
    mac = json.loads(victim("ip -j link show dev out"))[0]["address"]
    together = [f'include "{others}"; include "{str(ours)[:-1]}[t]"', f'flush ruleset; include "{str(ours)[:-1]}[t]"']
    words = json.dumps([("udp", "10.7.0.5", VICTIM), ("udp", MEMBER, VICTIM)])
    with filtered(victim, GUARDED), victim.hearing("out") as heard:
        command = stranger.words(sys.executable, str(NODES / "hostile/forger.py"), "out", mac, str(PORT), "2")
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as sender:
            sender.stdin.write(words)
            sender.stdin.close()
            times = 0
            while sender.poll() is None:
                subprocess.run(victim.words("nft", together[times % 2]), check=True)
                times += 1
    assert times > 5 and set(heard) == {f"{MEMBER} > {VICTIM}"}


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_any_source_comes_in_only_where_the_rules_let_it(wires, seed):
    """Sources of all kinds, drawn by a generator: members pass, nothing else does."""
    drawn = random.Random(seed)
    network = f"10.{drawn.randrange(20, 200)}.{drawn.randrange(256)}"
    members, prefix = [f"{network}.0/25", MEMBER], f"fd{drawn.randrange(256):02x}:{drawn.randrange(1, 65535):x}:"
    wanted = PacketFilter((*members, f"{prefix}:/64"), (), (OpenPort("tcp", 8080),), (2222,))
    sources = {4: [MEMBER, f"{network}.{drawn.randrange(128)}"], 6: [f"{prefix}:{drawn.randrange(1, 65535):x}"]}
    let_in = {*sources[4], *sources[6]}
    for _turn in range(40):
        sources[4].append(f"{drawn.randrange(1, 224)}." + ".".join(str(drawn.randrange(255)) for _part in range(3)))
        sources[6].append(
            f"{drawn.choice(('fe80::', '2001:db8::', '::ffff:a09:', 'fd12::'))}{drawn.randrange(1, 65535):x}"
        )
    sources[4] += [f"{network}.{drawn.randrange(128, 255)}", *own_addresses(wires)[4]]
    sources[6] += own_addresses(wires)[6]
    with filtered(wires[1], wanted), wires[1].hearing("out") as heard:
        send(wires, *packets(wires, sources))
    found = {line.split(" > ")[0] for line in heard}
    assert found == let_in
