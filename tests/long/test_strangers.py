# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Masters and datagrams of strangers, and a member that lies about its nodes, against a running fleet. Takes three minutes.

The strangers are on a computer of the common network that is in no inventory. What the first robot connects to is counted
by its kernel. All of it stays in the lab's internal network, and is bounded in number.
"""

import contextlib
import json
import os
import subprocess
import time
from pathlib import Path
from typing import NamedTuple

import pytest
from machines import containers
from machines.layout import Extra
from proofs.busy import Busy
from setups.links import Watch, wait_until
from subject import NODES, lab_of

HERE = Path(__file__).parent
ROOT = HERE.parents[1]

LAB = os.environ.get("STRANGERS_LAB", "long-strangers")
VICTIM, PEER, STRANGER = "kobuki1computer", "kobuki2computer", "stranger"
ROBOTS, GROUP = {VICTIM: "192.168.1.229", PEER: "192.168.1.239"}, "224.0.0.1"
# Each attack has an address of its own, since whom a robot has asked it does not ask again for minutes.
ROGUE, THIEF, PATIENT_THIEF, LIAR, GUEST = (f"192.168.1.{number}" for number in range(66, 71))
NOBODY = "192.168.1.77"
DISCOVERY, SYNC = "multimaster-discovery", "multimaster-sync"
OFFLINE_AFTER = 5.0  # seconds, the default
LOOK = 0.2  # seconds that a change of the list may have been there when it is seen
IS_PEER = f"{PEER} http://{PEER}:11311/ http://{ROBOTS[PEER]}:11611"

# Each attempt to connect, also one that has no answer, with its user: the port of its own is another for each.
ATTEMPTS = """
table inet attempts {
  set seen { type uid . ipv4_addr . inet_service . inet_service; flags dynamic; size 65535; }
  chain out {
    type filter hook output priority 0;
    tcp flags & (syn | ack) == syn update @seen { meta skuid . ip daddr . tcp dport . tcp sport };
  }
}
"""
# Heartbeats in the name of this computer itself, which no network would carry.
FROM_HERE = f"""
import socket, struct
for source in ("127.0.0.1", "127.0.0.9"):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        sender.bind((source, 0))
        for port in range(20021, 20041):
            beat = struct.pack("<cBBxiiHxxii", b"R", 2, 10, port, 0, port, port, 0)
            sender.sendto(beat, ("{ROBOTS[VICTIM]}", 11511))
"""
# Nodes of the second robot where none of its can be, and why they are refused. Each has a port of its own.
HERE_ITSELF, NO_COMPUTER = "it is on this computer itself", "is no computer of kobuki2"
PLACES = {
    "http://127.0.0.1:9001/any/path": "it is more than a host and a port",
    f"http://{PEER}:9002/any/path": "it is more than a host and a port",
    "http://127.0.0.1:9003/": HERE_ITSELF,
    "http://localhost:9004/": HERE_ITSELF,
    f"http://{ROBOTS[VICTIM]}:9005/": HERE_ITSELF,
    f"http://{VICTIM}:9006/": HERE_ITSELF,
    f"http://{ROGUE}:9007/": f"{ROGUE} {NO_COMPUTER}",
    "http://8.8.8.8:9008/": f"8.8.8.8 {NO_COMPUTER}",
    "http://127.1:9009/": "its host is neither a name nor an IPv4 address",
    f"http://{PEER}:11311/": "port 11311 there is its roscore's or its discovery's",
}
SERVICE = "rosrpc://127.0.0.1:9010"
LIES = """
import sys, xmlrpc.client
verb, *uris = sys.argv[1:]
roscore = xmlrpc.client.ServerProxy("http://localhost:11311")
for number, uri in enumerate(uris):
    words = ["std_msgs/Int32"] if verb == "register" else []
    call = getattr(roscore, verb + "Publisher")
    assert call(f"/liar/node{number}", f"/liar/topic{number}", *words, uri)[0] == 1
words = ["http://%s:9011/"] if verb == "register" else []
assert getattr(roscore, verb + "Service")("/liar/server", "/liar/service", "%s", *words)[0] == 1
""" % (PEER, SERVICE)


class Attempt(NamedTuple):
    """One attempt to connect."""

    user: int
    address: str
    port: int
    own_port: int


class Fleet:
    """The lab, and what its robots see and do."""

    def __init__(self, lab):
        self.lab, self.run = lab, lab.run
        self.roscores = {host: Watch(lab, host, 10) for host in ROBOTS}
        self.lists = {host: Watch(lab, host, 10, "observers/masters.py") for host in ROBOTS}
        lab.run(VICTIM, "nft -f -", stdin=ATTEMPTS)

    def attempts(self):
        """Every attempt of the first robot to connect, so far."""
        listed = json.loads(self.run(VICTIM, "nft -j list set inet attempts seen"))["nftables"]
        entries = next(part["set"] for part in listed if "set" in part).get("elem", [])
        return {Attempt(*entry["concat"]) for entry in entries}

    def user(self, unit):
        """The user of a service of the first robot."""
        return int(self.run(VICTIM, f"stat -c %u /proc/$(systemctl show --value --property MainPID {unit})"))

    def log(self, host, unit, since):
        return self.run(host, f"journalctl --quiet --output cat --unit {unit} --since @{since:.0f}")

    def diagnosed(self, host, text):
        """Wait until a node of a robot says so on /diagnostics. The last message of each stays for who comes later."""

        def said():
            entries = self.run(host, "cat /run/diagnostics.out").split("level:")
            return any(text in entry and f'/{host}"' in entry for entry in entries)

        self.lab.start(host, "diagnostics", "rostopic echo /diagnostics")
        wait_until(said, 15, f"{text} on /diagnostics of {host}")
        self.lab.stop(host, "diagnostics")

    def outsiders(self):
        """Whom the first robot ignores: address -> name, URI, why."""
        ask = f"import json, xmlrpc.client as x; s = x.ServerProxy('http://{ROBOTS[VICTIM]}:11611')"
        found = self.run(VICTIM, f'python3 -c "{ask}; print(json.dumps(s.getOutsiders()[1]))"')
        return {address: tuple(rest) for address, *rest in json.loads(found)}

    @contextlib.contextmanager
    def stopped(self):
        """The second robot's discovery does nothing, as one on a busy computer."""
        process = self.run(PEER, f"systemctl show --value --property MainPID {DISCOVERY}").strip()
        self.run(PEER, f"kill -STOP {process}")
        try:
            yield
        finally:
            self.run(PEER, f"kill -CONT {process}")

    def unchanged(self, since, *hosts):
        """Nothing was registered or withdrawn on these robots since then, and their lists of masters are the same."""
        for host in hosts:
            assert self.roscores[host].events(since) == []
            assert self.lists[host].events(since) == []

    def data(self):
        """The ends of the connections from the second robot's nodes to the first one's that stay."""
        command = f"ss -tnH state established dst {ROBOTS[PEER]} | awk '{{print $3, $4}}'"
        first = set(self.run(VICTIM, command).splitlines())
        time.sleep(1)
        return first & set(self.run(VICTIM, command).splitlines())


def attack(lab, script, *arguments):
    """Start one of the scripts on the stranger's computer."""
    words = ["podman", "exec", "-i", containers.container(LAB, STRANGER), "python3", "-", *map(str, arguments)]
    with open(script, encoding="utf-8") as program:
        return subprocess.Popen(words, stdin=program, stdout=subprocess.PIPE, text=True)


def result(name, running):
    """The counts of a script."""
    output, _errors = running.communicate(timeout=60)
    print(f"\n{name}:", output.strip())
    assert running.returncode == 0
    return json.loads(output)


def rogue(lab, name, address, target, seconds, who="rogue"):
    return attack(lab, NODES / "hostile/rogue.py", address, target, f"http://{who}:11311/", who, seconds)


def spoofed(lab, count, seconds, rate, ports, *sources):
    return attack(lab, HERE / "spoofed_beats.py", ROBOTS[VICTIM], count, seconds, rate, ports, *sources)


@pytest.fixture(scope="module")
def slack():
    with Busy() as busy:
        yield busy.slack


@pytest.fixture(scope="module")
def fleet():
    extras = {STRANGER: Extra((f"{ROGUE}/24",))}
    with lab_of(LAB, ROOT / "inventory" / "single_computer", extras) as lab:
        for address in (THIEF, PATIENT_THIEF, LIAR, GUEST):
            lab.run(STRANGER, f"ip address add {address}/24 dev eth0")
        status, output = lab.play("site.yml")
        assert status == 0, output
        lab.start(PEER, "data", "rostopic pub -r 5 /real/data std_msgs/Int32 1")
        lab.start(VICTIM, "hears", "rostopic echo /real/data")
        found = Fleet(lab)
        for host in ROBOTS:
            wait_until(lambda host=host: len(found.lists[host].registrations()) == 2, 30, f"both masters on {host}")
            wait_until(
                lambda host=host: "publisher /real/data" in str(found.roscores[host].registrations()),
                30,
                f"data on {host}",
            )
        wait_until(found.data, 20, "a connection between nodes of both robots")
        time.sleep(3)  # what starts has been told everywhere
        yield found


def test_a_rogue_master_is_named_and_nothing_of_it_is_taken(fleet):
    since, at = time.time(), time.monotonic()
    called = result("rogue", rogue(fleet.lab, "rogue", ROGUE, GROUP, 12))
    fleet.unchanged(at, *ROBOTS)
    assert 1 <= called["connections"] <= 2 * len(ROBOTS) and set(called["methods"]) == {"masterContacts"}
    assert called["answers"] == 0
    said = f"rogue (http://rogue:11311/) at {ROGUE} is ignored: it is no robot of the fleet"
    for host in ROBOTS:
        assert fleet.log(host, DISCOVERY, since - 1).count(said) == 1
        fleet.diagnosed(host, said)
    status, output = fleet.lab.play("playbooks/verify.yml")
    assert status == 0, output
    assert f"rogue at {ROGUE} is ignored: it is no robot of the fleet" in output


@pytest.mark.parametrize(("thief", "late"), [(THIEF, 2.5), (PATIENT_THIEF, 8.0)])
def test_a_thief_does_not_become_a_robot_whose_heartbeat_is_late(fleet, thief, late):
    """2.5 s: one heartbeat or two. 8 s: the robot counts as lost, and comes back."""
    wait_until(lambda: f"{IS_PEER} online" in fleet.lists[VICTIM].registrations(), 20, "the robot is online")
    data = fleet.data()
    assert data
    since, at = time.time(), time.monotonic()
    running = rogue(fleet.lab, "thief", thief, ROBOTS[VICTIM], late + 4, PEER)
    time.sleep(1)
    with fleet.stopped():
        time.sleep(late)
    called = result("thief", running)
    assert 1 <= called["connections"] <= 2 and set(called["methods"]) == {"masterContacts"}
    wait_until(lambda: f"{IS_PEER} online" in fleet.lists[VICTIM].registrations(), 10, "the robot is back")
    seen = [text for _at, text in fleet.lists[VICTIM].events(at)]
    print(f"{late} s late:", seen)
    if late < OFFLINE_AFTER - 1:
        fleet.unchanged(at, VICTIM)
        assert data <= fleet.data()  # the same ends
    else:
        assert {text[2:] for text in seen} == {f"{IS_PEER} online", f"{IS_PEER} offline"}
        wait_until(
            lambda: "publisher /real/data" in str(fleet.roscores[VICTIM].registrations()), 10, "its topics are back"
        )
        wait_until(fleet.data, 10, "its data is back")
    why = f"it says that it is {PEER}, which is at {ROBOTS[PEER]}"
    assert fleet.log(VICTIM, DISCOVERY, since - 1).count(f"at {thief} is ignored: {why}") == 1


def test_spoofed_stamps_cost_one_fetch_in_ten_seconds(fleet):
    before, at = fleet.attempts(), time.monotonic()
    running, listed = spoofed(fleet.lab, 226, 9, 10, "11611-11611", ROBOTS[PEER]), set()
    for _look in range(5):
        listed.add(fleet.run(VICTIM, f"rosservice call /master_discovery/list_masters | grep -A 8 'name: .*{PEER}'"))
        time.sleep(1)
    sent = result("stamps", running)
    assert len(listed) > 1, "the stamps in the datagrams are seen"
    new = [one for one in fleet.attempts() - before if (one.address, one.port) == (ROBOTS[PEER], 11611)]
    fetches = sum(one.user == fleet.user(SYNC) for one in new)
    print(f"{sent['sent']} datagrams in {sent['seconds']} s: {fetches} fetches, {len(new) - fetches} other calls")
    assert fetches <= sent["seconds"] / 10 + 2
    assert len(new) - fetches <= sent["seconds"] + 2
    fleet.unchanged(at, *ROBOTS)


def test_a_spoofed_rate_of_zero_delays_no_loss(fleet, slack):
    wait_until(lambda: f"{IS_PEER} online" in fleet.lists[VICTIM].registrations(), 20, "the robot is online")
    began = time.monotonic()
    running = spoofed(fleet.lab, 30, 6, 0, "11611-11611", ROBOTS[PEER])
    time.sleep(4)
    with fleet.stopped():
        stopped = time.monotonic()
        last = result("rate 0", running)["last"]
        assert last > stopped, "the last that was heard is a rate of 0"
        lost = wait_until(
            lambda: [at for at, text in fleet.lists[VICTIM].events(began) if text == f"+ {IS_PEER} offline"],
            12,
            "the robot is lost",
        )[0]
        print(f"lost {lost - last:.2f} s after the last datagram")
        assert lost - last <= OFFLINE_AFTER + LOOK + slack(began)
    wait_until(lambda: f"{IS_PEER} online" in fleet.lists[VICTIM].registrations(), 10, "the robot is back")
    wait_until(lambda: "publisher /real/data" in str(fleet.roscores[VICTIM].registrations()), 10, "its topics are back")


def test_invented_senders_are_asked_twice_at_most(fleet):
    wait_until(fleet.data, 20, "data again")
    time.sleep(3)
    near, far = {LIAR, NOBODY, ROBOTS[PEER]}, {"8.8.8.8", "10.1.2.3", "192.168.99.5"}
    odd = {"127.0.0.1", ROBOTS[VICTIM], "255.255.255.255", GROUP}
    before, at = fleet.attempts(), time.monotonic()
    running = spoofed(fleet.lab, 440, 14, 10, "20001-20020", *sorted(near | far | odd))
    fleet.run(VICTIM, "python3 -", stdin=FROM_HERE)
    result("invented", running)
    asked = [one for one in fleet.attempts() - before if 20001 <= one.port <= 20040]
    counts = {address: sum(one.address == address for one in asked) for address in {one.address for one in asked}}
    print("asked:", counts)
    assert set(counts) == near
    assert all(count <= 2 for count in counts.values())
    ignored = fleet.outsiders()
    assert far | {"127.0.0.1", "127.0.0.9"} <= set(ignored), "they have been heard"
    fleet.unchanged(at, *ROBOTS)


def test_a_member_that_lies_about_its_nodes_misleads_no_other(fleet):
    before, since, at = fleet.attempts(), time.time(), time.monotonic()
    fleet.run(PEER, f"python3 - register {' '.join(PLACES)}", stdin=LIES)
    wanted = {**PLACES, SERVICE: HERE_ITSELF}

    def missing():
        log = fleet.log(VICTIM, SYNC, since - 1)
        return [uri for uri, why in wanted.items() if f"at {uri} is refused: {why}" not in log]

    with contextlib.suppress(AssertionError):
        wait_until(lambda: not missing(), 20, "all of them are refused")
    assert missing() == []
    fleet.lab.start(PEER, "honest", "rostopic pub -r 5 /honest std_msgs/Int32 1")
    wait_until(lambda: "publisher /honest" in str(fleet.roscores[VICTIM].registrations()), 20, "what is honest crosses")
    for text in (f"is refused: {HERE_ITSELF}", f"is refused: 8.8.8.8 {NO_COMPUTER}"):
        fleet.diagnosed(VICTIM, text)
    taken = [text for _at, text in fleet.roscores[VICTIM].events(at) if "/liar/" in text]
    assert taken == []
    there = [one for one in fleet.attempts() - before if 9001 <= one.port <= 9011]
    assert there == []
    fleet.run(PEER, f"python3 - unregister {' '.join(PLACES)}", stdin=LIES)
    wait_until(lambda: "is no longer refused" in fleet.log(VICTIM, SYNC, since - 1), 20, "it says that they are gone")
    fleet.lab.stop(PEER, "honest")


def test_a_rogue_that_is_allowed_is_taken(fleet):
    """The same master, and all that it offers is registered: so the tests above would see it."""
    status, output = fleet.lab.play("site.yml", variables={"multimaster_allow": [GUEST]})
    assert status == 0, output
    running = rogue(fleet.lab, "guest", GUEST, GROUP, 15)
    offered = {
        "publisher /cmd_vel /rogue",
        "publisher /tf /rogue",
        "publisher /rogue/cmd_vel /rogue",
        "service /rogue/stop /rogue",
    }
    for host in ROBOTS:
        wait_until(
            lambda host=host: offered <= fleet.roscores[host].registrations(), 15, f"the guest's topics on {host}"
        )
    called = result("guest", running)
    assert "masterInfoFiltered" in called["methods"]
