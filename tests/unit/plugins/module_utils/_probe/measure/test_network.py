# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The view of a computer on others: real sockets, real packets, in network namespaces where there must be two hosts."""

import errno
import json
import os
import pathlib
import shutil
import socket
import subprocess
import sys
import threading

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.commands import Answer
from ansible_collections.rosfleet.multimaster.plugins.module_utils._contract.outcomes import Outcome
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.measure import network

root = pytest.mark.skipif(os.geteuid() != 0, reason="raw sockets and namespaces need root")

PING = """
import json, sys
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import network as machine
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.commands import Answer
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.measure import network
pings = network.ping(sys.argv[1:], tries=2, answer=0.4)
routes = [network.route_to_plain(machine.route_to(address)) for address in sys.argv[1:]]
print(json.dumps([{address: answer.to_plain() for address, answer in pings.items()}, routes]))
"""


@pytest.fixture
def hosts():
    """Two hosts, 10.99.0.1 and 10.99.0.2, on one wire."""
    names = [f"probe{os.getpid()}{side}" for side in "ab"]
    commands = [f"ip netns add {name}" for name in names]
    commands += [
        f"ip -n {names[0]} link add eth0 type veth peer name eth0 netns {names[1]}",
        *(f"ip -n {name} address add 10.99.0.{number}/24 dev eth0" for number, name in enumerate(names, 1)),
        *(f"ip -n {name} link set {link} up" for name in names for link in ("lo", "eth0")),
    ]
    try:
        for command in commands:
            subprocess.run(command.split(), check=True)
        yield names
    finally:
        for name in names:
            subprocess.run(["ip", "netns", "delete", name], check=False)


# The errors of a kernel that refuses to send, each made by the kernel itself
ERRNOS = """
import json, resource, subprocess, sys
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import outcomes
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.measure import network
def run(words):
    subprocess.run(words.split(), check=True)
def connect(address, port=9):
    answer = outcomes.connect(address, port, 5.0)
    return answer.outcome.value, answer.errno
def ping(address):
    answer = network.ping([address], tries=1, answer=0.3)[address]
    return answer.outcome.value, answer.errno
found = {}
for number, kind in enumerate(("prohibit", "blackhole", "unreachable"), 1):
    run(f"ip route add {kind} 10.98.{number}.1")
    found[kind] = ping(f"10.98.{number}.1"), connect(f"10.98.{number}.1")
for number, kind in enumerate(("prohibit", "blackhole", "unreachable"), 1):
    run(f"ip rule add to 10.96.{number}.1 {kind}")
    found["rule " + kind] = ping(f"10.96.{number}.1"), connect(f"10.96.{number}.1")
found["no route"] = ping("10.97.0.1"), connect("10.97.0.1")
found["nobody listens"] = None, connect("10.99.0.2")
found["nobody answers"] = None, connect("10.99.0.3")
run("nft add table inet fault")
run("nft add chain inet fault one { type filter hook output priority 0; }")
run("nft add rule inet fault one ip protocol icmp drop")
found["filter"] = ping("10.99.0.2"), None
run("sysctl -q -w net.ipv4.ip_local_reserved_ports=1024-65535")
found["ports"] = None, connect("10.99.0.2")
resource.setrlimit(resource.RLIMIT_NOFILE, (3, 3))
found["files"] = None, connect("10.99.0.2")
print(json.dumps(found))
"""


@pytest.mark.slow
@root
@pytest.mark.skipif(not shutil.which("nft"), reason="needs nft")
def test_errnos_of_a_real_kernel_are_told_apart(hosts):
    collections = str(pathlib.Path(network.__file__).parents[7])
    output = subprocess.run(
        ["ip", "netns", "exec", hosts[0], sys.executable, "-c", ERRNOS],
        check=True,
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": collections},
    ).stdout

    def both(outcome, number):
        return [[outcome.value, number]] * 2

    closed, none = Outcome.CLOSED_ROUTE, Outcome.NETWORK_UNREACHABLE
    assert json.loads(output) == {
        "prohibit": both(closed, errno.EACCES),
        "blackhole": both(closed, errno.EINVAL),
        "unreachable": both(Outcome.HOST_UNREACHABLE, errno.EHOSTUNREACH),
        "rule prohibit": both(closed, errno.EACCES),
        "rule blackhole": both(closed, errno.EINVAL),
        "rule unreachable": both(none, errno.ENETUNREACH),
        "no route": both(none, errno.ENETUNREACH),
        "nobody listens": [None, [Outcome.REFUSED.value, errno.ECONNREFUSED]],
        "nobody answers": [None, [Outcome.HOST_UNREACHABLE.value, errno.EHOSTUNREACH]],
        "filter": [[Outcome.NOT_PERMITTED.value, errno.EPERM], None],
        "ports": [None, [Outcome.NO_LOCAL_PORT.value, errno.EADDRNOTAVAIL]],
        "files": [None, [Outcome.NO_FILE.value, errno.EMFILE]],
    }


@root
def test_ping_between_two_hosts(hosts):
    collections = str(pathlib.Path(network.__file__).parents[7])
    output = subprocess.run(
        ["ip", "netns", "exec", hosts[0], sys.executable, "-c", PING, "10.99.0.2", "10.99.0.3", "10.98.0.1"],
        check=True,
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": collections},
    ).stdout
    pings, ways = json.loads(output)
    assert pings["10.99.0.2"]["ok"] and 0 < pings["10.99.0.2"]["rtt_ms"] < 400
    assert not pings["10.99.0.3"]["ok"] and pings["10.99.0.3"]["error"]
    assert pings["10.99.0.2"]["outcome"] == "answered" and pings["10.99.0.2"]["reporter"] == "10.99.0.2"
    local = {
        "ok": False,
        "rtt_ms": None,
        "error": "Network is unreachable",
        "outcome": "network_unreachable",
        "errno": errno.ENETUNREACH,
    }
    assert pings["10.98.0.1"] == {**local, "icmp_type": None, "icmp_code": None, "reporter": ""}
    assert ways[0] == {"device": "eth0", "source": "10.99.0.1", "gateway": None, "metric": None, "error": ""}
    assert ways[2]["device"] is None and "unreachable" in ways[2]["error"]


LARGE = """
import json, sys
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.commands import Answer
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.measure import network
others = [{"name": address, "address": address} for address in sys.argv[1:]]
print(json.dumps([network.members(others, "me"), network.forwarding("/proc/sys/net/ipv4")]))
"""


@pytest.mark.slow
@root
@pytest.mark.parametrize(("theirs", "arrives"), [("1500", True), ("1000", False)])
def test_large_packets_and_the_neighbour_between_two_hosts(hosts, theirs, arrives):
    """An interface with a small MTU takes no large packets, though small ones pass."""
    subprocess.run(["ip", "-n", hosts[1], "link", "set", "eth0", "mtu", theirs], check=True)
    shown = subprocess.run(
        ["ip", "netns", "exec", hosts[1], "cat", "/sys/class/net/eth0/address"], check=True, stdout=subprocess.PIPE
    )
    output = subprocess.run(
        ["ip", "netns", "exec", hosts[0], sys.executable, "-c", LARGE, "10.99.0.2", "10.99.0.3"],
        check=True,
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(pathlib.Path(network.__file__).parents[7])},
    ).stdout
    (there, nobody), forwarding = json.loads(output)
    assert there["ping_address"]["ok"] and there["ping_large"]["ok"] == arrives
    assert there["neighbour"] == shown.stdout.decode().strip() and not there["neighbour_fixed"]
    assert forwarding["icmp_echo_ignore_all"] == 0
    assert nobody["ping_large"] is None and nobody["neighbour"] == ""
    assert (there["loss"], there["tcp"]) == (0.0, "")
    assert nobody["loss"] == 1.0 and nobody["tcp"] not in ("", "refused")
    assert nobody["ping_address"]["error"] == "10.99.0.1 reports: host unreachable" and not nobody["silent"]
    told = [nobody["ping_address"][key] for key in ("outcome", "icmp_type", "icmp_code", "reporter", "errno")]
    assert told == ["host_unreachable", 3, 1, "10.99.0.1", None]
    assert not there["silent"]
    (own,) = forwarding["interfaces"]
    assert (own["addresses"], own["prefixes"], own["mtu"], len(own["mac"])) == (["10.99.0.1"], [24], 1500, 17)


def test_a_neighbour_that_was_set_by_hand_is_told(tmp_path):
    table = tmp_path / "arp"
    table.write_text(
        "IP address       HW type     Flags       HW address            Mask     Device\n"
        "10.99.0.2        0x1         0x2         02:00:00:00:00:02     *        eth0\n"
        "10.99.0.3        0x1         0x6         02:00:00:00:00:03     *        eth0\n"
        "10.99.0.4        0x1         0x0         00:00:00:00:00:00     *        eth0\n"
    )
    assert network.machine.neighbours(str(table)) == {
        "10.99.0.2": ("02:00:00:00:00:02", False),
        "10.99.0.3": ("02:00:00:00:00:03", True),
    }


@pytest.mark.slow
@root
@pytest.mark.skipif(not shutil.which("nft"), reason="needs nft")
def test_a_host_that_drops_pings_is_silent_without_a_cause(hosts):
    rules = "table ip t { chain c { type filter hook input priority 0; icmp type echo-request drop; }; }"
    subprocess.run(["ip", "netns", "exec", hosts[1], "nft", rules], check=True)
    output = subprocess.run(
        ["ip", "netns", "exec", hosts[0], sys.executable, "-c", LARGE, "10.99.0.2"],
        check=True,
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(pathlib.Path(network.__file__).parents[7])},
    ).stdout
    ((there,), _forwarding) = json.loads(output)
    assert there["silent"] and (there["loss"], there["tcp"]) == (1.0, "refused")
    assert there["ping_address"]["error"] == "no answer to 3 requests"
    assert (there["ping_address"]["outcome"], there["tcp_outcome"]) == ("no_answer", "refused")


def test_no_answer_is_a_loss_and_a_large_fleet_is_not_flooded():
    assert network.losses([]) == {}
    assert len(network.sample([str(number) for number in range(1000)])) <= network.MOST_COUNTED
    assert network.sample(["one", "two"]) == ["one", "two"] and network.sample([]) == []


@root
def test_lost_pings_are_counted():
    assert network.losses(["127.0.0.1"]) == {"127.0.0.1": 0.0}


def test_a_port_that_nobody_uses():
    assert network.try_unused_port("127.0.0.1") == (Outcome.REFUSED, "refused")


HIDDEN = """
import json, socket
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.commands import Answer
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.measure import network
print(json.dumps([network.machine.resolve("robot.test")[0], network.user_addresses(["robot.test", "localhost"])]))
"""


@root
@pytest.mark.parametrize(("mode", "theirs"), [(0o644, ["10.99.0.7"]), (0o600, [])])
def test_a_hosts_file_for_root_alone_has_no_names_for_others(tmp_path, mode, theirs):
    hosts = tmp_path / "hosts"
    hosts.write_text("127.0.0.1 localhost\n10.99.0.7 robot.test\n")
    hosts.chmod(mode)
    command = f"mount --bind {hosts} /etc/hosts && exec /usr/bin/python3 -c '{HIDDEN}'"
    output = subprocess.run(
        ["unshare", "--mount", "--propagation", "private", "sh", "-c", command],
        check=True,
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(pathlib.Path(network.__file__).parents[7])},
    ).stdout
    mine, others = json.loads(output)
    assert (mine, others.get("robot.test")) == (["10.99.0.7"], theirs)


@root
def test_ping_of_nobody_and_of_this_computer():
    assert network.ping([]) == {}
    assert network.ping(["127.0.0.1"])["127.0.0.1"].ok


def test_forwarding_is_what_is_effective(tmp_path):
    found = network.forwarding()
    assert found["ip_forward"] in (0, 1) and all(entry["addresses"] for entry in found["interfaces"])
    (tmp_path / "ip_forward").write_text("1\n")
    for place in ["all", *[entry["interface"] for entry in found["interfaces"]]]:
        folder = tmp_path / "conf" / place
        folder.mkdir(parents=True)
        for setting, value in (
            ("forwarding", "1"),
            ("rp_filter", "2" if place == "all" else "1"),
            ("send_redirects", "0"),
        ):
            (folder / setting).write_text(value + "\n")
    for entry in network.forwarding(str(tmp_path))["interfaces"]:
        assert (entry["forwarding"], entry["rp_filter"], entry["send_redirects"]) == (1, 2, 0)


def test_the_journal_is_asked_of_all_links_that_are_down_at_once(monkeypatch):
    """Docker leaves a bridge for each of its networks, and a journal of gigabytes takes seconds for each question."""
    names = [f"br{number}" for number in range(8)]
    address = network.machine.Address("10.99.0.1", 24, "inet")
    links = [network.machine.NetworkInterface(name, up=True, addresses=(address,)) for name in ["eth0", *names]]
    monkeypatch.setattr(network.machine, "interfaces", lambda: links)
    told = {"mac": "", "carrier_changes": 0, "power_save": None}
    monkeypatch.setattr(network, "link_of", lambda name: dict(told, state="up" if name == "eth0" else "down"))
    asked = threading.Barrier(len(names), timeout=20)

    def carrier(name):
        asked.wait()
        return f"{name}: link down"

    monkeypatch.setattr(network, "carrier", carrier)
    found = {entry["interface"]: entry["last"] for entry in network.forwarding()["interfaces"]}
    assert found == {"eth0": "", **{name: f"{name}: link down" for name in names}}


def test_calls_arrive_empty():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as helper:
        helper.bind(("127.0.0.1", 0))
        helper.settimeout(2)
        assert network.call(["127.0.0.1"], helper.getsockname()[1]) == ""
        assert [helper.recv(10) for number in range(network.TRIES)] == [b""] * network.TRIES
    assert network.call(["255.255.255.255"], 9)  # refused by the kernel: not allowed without asking for it


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            "passwd: files\nhosts:\t\tfiles mdns4_minimal [NOTFOUND=return] dns # as Debian has it\n",
            ["files", "mdns4_minimal", "dns"],
        ),
        ("# hosts: dns\n", []),
        ("hosts:\n", []),
    ],
)
def test_the_sources_of_names_are_read_in_their_order(tmp_path, text, expected):
    path = tmp_path / "nsswitch.conf"
    path.write_text(text)
    assert network.name_sources(str(path)) == expected
    assert network.name_sources(str(tmp_path / "none")) == []


def test_the_addresses_of_names_in_a_file_are_read(tmp_path):
    path = tmp_path / "hosts"
    path.write_text("127.0.1.1 Tibi-Nav tibi # 10.0.0.9 tibi\n\n192.168.1.1\n192.168.11.100\ttibi-nav\n")
    assert network.file_addresses(str(path)) == {"tibi-nav": ["127.0.1.1", "192.168.11.100"], "tibi": ["127.0.1.1"]}
    assert network.file_addresses(str(tmp_path / "none")) == {}


POLICY = """
import json
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.commands import Answer
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.measure import network
print(json.dumps(network.policy()))
"""


@root
def test_rules_and_routes_that_lead_nowhere_are_read(hosts):
    for command in (
        "ip rule add to 10.98.0.0/16 lookup 77 priority 100",
        "ip route add unreachable 10.98.0.0/16 table 77",
        "ip route add blackhole 10.97.0.1",
    ):
        subprocess.run(["ip", "netns", "exec", hosts[0], *command.split()], check=True)
    output = subprocess.run(
        ["ip", "netns", "exec", hosts[0], sys.executable, "-c", POLICY],
        check=True,
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(pathlib.Path(network.__file__).parents[7])},
    ).stdout
    found = json.loads(output)
    assert found["rules"] == ["100: from all to 10.98.0.0/16 lookup 77"]
    assert "blackhole 10.97.0.1" in found["closed"]
    assert any(line.startswith("unreachable 10.98.0.0/16 table 77") for line in found["closed"])


@pytest.mark.parametrize(
    ("told", "kind", "saves"),
    [
        ("Power save: on\n", "managed", True),
        ("Power save: on\n", "P2P-client", True),
        ("Power save: on\n", "AP", None),
        ("Power save: on\n", "mesh point", None),
        ("Power save: on\n", "", True),
        ("Power save: off\n", "managed", False),
        ("command failed: No such device (-19)\n", "managed", None),
        ("", "", None),
    ],
)
@pytest.mark.parametrize("mark", ["wireless", "phy80211"])
def test_a_wireless_interface_is_asked_for_its_power(tmp_path, monkeypatch, mark, told, kind, saves):
    """There is no wireless interface here: what iw prints is as tests/machines/test_wifi.py has seen it."""
    (tmp_path / "wlan0" / mark).mkdir(parents=True)
    (tmp_path / "eth0").mkdir()
    asked = []
    info = f"Interface wlan0\n\tifindex 3\n\ttype {kind}\n\twiphy 0\n" if kind else ""
    answers = {"power_save": told, "info": info}
    monkeypatch.setattr(network, "run", lambda argv: asked.append(argv) or Answer(0, answers[argv[-1]].encode(), ""))
    assert network.saves_power("wlan0", str(tmp_path)) is saves
    assert network.saves_power("eth0", str(tmp_path)) is None and len(asked) == (2 if told.endswith("on\n") else 1)
