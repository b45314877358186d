# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The module firewall against a real kernel: a network namespace, and files in a folder. Killed at each change."""

import json
import os
import subprocess
import sys
from pathlib import Path

import ansible_collections
import pytest
from killed import UNTIL
from namespaces import why_not

TOOLS = ("nft", "unshare", "nsenter")
COLLECTIONS = Path(next(iter(ansible_collections.__path__))).parent
LIST = ["nft", "-s", "list", "ruleset"]
OPTIONS = {
    "members": [],
    "also": [],
    "networks": [],
    "guards": [],
    "open_ports": [],
    "ssh_ports": [],
    "backend": "auto",
}
FLEET = {"members": ["192.168.1.229", "192.168.1.239"]}
GATEWAY = {
    "members": ["192.168.1.201", "192.168.11.100", "fd00::/64"],
    "networks": ["192.168.11.0/24"],
    "guards": [{"networks": ["192.168.11.0/24", "fd00:11::/64"], "interface": "eth1"}],
    "ssh_ports": [2222],
}
FOREIGN = "add table inet foreign { chain input { type filter hook input priority 0; tcp dport 9 drop; }; }"

# Runs one after another in processes of their own, each ended, as by kill -9, before its change of this number (0: never).
RUNS = (
    UNTIL
    + """
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.firewall import run
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.firewall.backends import contract, nftables
contract.run_or_fail = until(contract.run_or_fail)
root = sys.argv[1]
run.has_systemd = lambda: False
run.BACKENDS = {"nftables": nftables.BackEnd}
nftables.RULES_FILE = root + "/etc/rosfleet-multimaster/firewall.nft"
nftables.UNIT_FILE = root + "/etc/systemd/system/multimaster-firewall.service"
nftables.DROP_IN = root + "/etc/systemd/system/nftables.service.d/rosfleet-multimaster.conf"
for options, left, half in json.load(sys.stdin):
    if os.fork() == 0:
        made = run.FirewallRun(dict(options, records=root + "/var/records"))
        undo, refusals = made.undo_steps(), made.refusals
        if refusals:
            pass
        elif half:
            made.apply_runtime()
        else:
            made.apply()
        print(json.dumps([made.changed, made.result(), undo, made.summary(False), refusals]), flush=True)
        os._exit(0)
    if os.WIFSIGNALED(os.wait()[1]):
        print(json.dumps("killed"), flush=True)
"""
)


pytestmark = pytest.mark.skipif(bool(why_not(*LIST)), reason=why_not(*LIST) or "can run")


class Computer:
    """A kernel's packet filter, and the files of nftables."""

    def __init__(self, root):
        self.root = root
        (root / "etc/systemd/system").mkdir(parents=True)
        (root / "var").mkdir()
        self.holder = subprocess.Popen(["unshare", "--net", "sleep", "300"])
        while os.readlink(f"/proc/{self.holder.pid}/ns/net") == os.readlink("/proc/self/ns/net"):
            pass
        self.inside("nft", FOREIGN)

    def inside(self, *words):
        command = ["nsenter", f"--net=/proc/{self.holder.pid}/ns/net", *words]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout

    def runs(self, *runs):
        """Run the module several times: (options, killed before which change[, only the run time])."""
        listed = [(dict(OPTIONS, **run[0]), run[1], run[2:] == (True,)) for run in runs]
        command = ["nsenter", f"--net=/proc/{self.holder.pid}/ns/net", sys.executable, "-c", RUNS, str(self.root)]
        done = subprocess.run(
            command,
            input=json.dumps(listed),
            capture_output=True,
            text=True,
            env={**os.environ, "PYTHONPATH": str(COLLECTIONS)},
            timeout=60,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        found = [json.loads(line) for line in done.stdout.splitlines()]
        assert len(found) == len(runs), done.stderr
        return found

    def state(self):
        files = {str(path): path.read_bytes() if path.is_file() else None for path in sorted(self.root.rglob("*"))}
        return files, self.inside(*LIST)


@pytest.fixture
def computer(tmp_path):
    made = Computer(tmp_path)
    yield made
    made.holder.kill()
    made.holder.wait()


@pytest.mark.slow
def test_apply_again_and_back(computer):
    untouched = computer.state()
    first, again = computer.runs((GATEWAY, 0), (GATEWAY, 0))
    assert first[0] and not again[0]
    assert [item["state"] for item in first[1]["members"] + first[1]["networks"]] == ["changed"] * 4
    assert [item["state"] for item in again[1]["members"] + again[1]["networks"]] == ["ok"] * 4
    assert (first[1]["backend"], first[1]["open_ports"]) == ("nftables", ["2222/tcp"])
    rules = computer.inside(*LIST)
    assert "table inet foreign" in rules and "hook forward" in rules and "tcp dport 2222 accept" in rules
    back, gone = computer.runs(({}, 0), ({}, 0))
    assert back[0] and not gone[0]
    assert back[1]["removed"] == ["nftables"]
    assert back[3] == "Our rules in nftables were removed."
    assert computer.state() == untouched


@pytest.mark.slow
def test_what_is_stored_is_what_runs(computer):
    computer.runs((GATEWAY, 0))
    before = computer.inside(*LIST)
    computer.inside(
        "nft", "-f", str(computer.root / "etc/rosfleet-multimaster/firewall.nft")
    )  # at boot, or by a reload
    assert computer.inside(*LIST) == before
    computer.inside("nft", "delete table inet rosfleet_multimaster")
    computer.inside("nft", "-f", str(computer.root / "etc/rosfleet-multimaster/firewall.nft"))
    assert computer.inside(*LIST) == before


@pytest.mark.slow
@pytest.mark.parametrize(
    "drift", ["flush chain inet rosfleet_multimaster input", "delete table inet rosfleet_multimaster"]
)
def test_what_somebody_removed_comes_back(computer, drift):
    computer.runs((FLEET, 0))
    good = computer.state()
    computer.inside("nft", drift)
    assert computer.runs((FLEET, 0))[0][0]
    assert computer.state() == good


@pytest.mark.slow
def test_a_robot_that_is_new_is_the_only_item_that_changes(computer):
    more = {"members": [*FLEET["members"], "192.168.1.240"]}
    found = computer.runs((FLEET, 0), (more, 0))[1]
    assert [item["changed"] for item in found[1]["members"]] == [False, False, True]


@pytest.mark.slow
@pytest.mark.parametrize(("first", "then"), [({}, GATEWAY), (FLEET, GATEWAY), (GATEWAY, {})])
def test_kill_at_any_moment_leaves_what_the_next_run_mends(computer, first, then):
    untouched = computer.state()
    step, killed = 1, True
    while killed:
        ended = computer.runs((first, 0), (then, step), (then, 0), (then, 0), ({}, 0))
        killed = ended[1] == "killed"
        assert not ended[3][0], step
        assert computer.state() == untouched, step
        step += 1
    assert step > 5


@pytest.mark.slow
@pytest.mark.parametrize(("first", "then"), [({}, GATEWAY), (FLEET, GATEWAY), (GATEWAY, {})])
def test_the_switch_takes_the_run_time_back(computer, first, then):
    computer.runs((first, 0))
    files, rules = computer.state()
    undo = computer.runs((then, 0, True))[0][2]
    assert computer.state()[0] == files and computer.inside(*LIST) != rules
    for command in undo:
        computer.inside(*command)
    assert computer.state() == (files, rules)


@pytest.mark.slow
def test_a_place_that_takes_no_file_is_told_before_a_change(computer):
    (computer.root / "etc/rosfleet-multimaster").symlink_to("/proc/sys/net")
    untouched = computer.state()
    for half in (True, False):
        refusals = computer.runs((FLEET, 0, half))[0][4]
        assert len(refusals) == 1 and "is no place for files" in refusals[0]
    assert computer.state() == untouched


@pytest.mark.slow
def test_traffic(computer, tmp_path):
    """Datagrams and connections in the kernel itself: from a member, from a stranger, from itself."""
    computer.runs(({"members": ["10.9.0.2"], "ssh_ports": [2222]}, 0))
    program = """
import socket, subprocess
def ip(*words): subprocess.run(["ip", *words], check=True)
ip("link", "set", "lo", "up")
ip("link", "add", "here", "type", "veth", "peer", "name", "there")
other = subprocess.Popen(["unshare", "--net", "sh", "-c", "echo; exec sleep 60"], stdout=subprocess.PIPE)
other.stdout.readline()
ip("link", "set", "there", "netns", str(other.pid))
ip("address", "add", "10.9.0.1/24", "dev", "here")
ip("link", "set", "here", "up")
def there(*words): return subprocess.run(["nsenter", "--net=/proc/%d/ns/net" % other.pid, *words], capture_output=True, text=True)
for address in ("10.9.0.2", "10.9.0.3"): there("ip", "address", "add", address + "/24", "dev", "there")
there("ip", "link", "set", "there", "up")
servers = [socket.create_server(("10.9.0.1", port)) for port in (80, 2222, 11311)]
udp = socket.socket(type=socket.SOCK_DGRAM); udp.bind(("10.9.0.1", 11511)); udp.settimeout(2)
CONNECT = "import socket,sys; s=socket.socket(); s.settimeout(2); s.bind((sys.argv[1],0)); print(s.connect_ex(('10.9.0.1',int(sys.argv[2]))))"
SEND = "import socket,sys; s=socket.socket(type=socket.SOCK_DGRAM); s.bind((sys.argv[1],0)); s.sendto(b'x',('10.9.0.1',11511))"
import sys
try:
    for address in ("10.9.0.2", "10.9.0.3"):
        reached = [there(sys.executable, "-c", CONNECT, address, str(port)).stdout.strip() == "0" for port in (80, 2222, 11311)]
        there(sys.executable, "-c", SEND, address)
        try: heard = udp.recvfrom(9)[1][0] == address
        except socket.timeout: heard = False
        print(address, reached, heard)
    print("itself", socket.create_connection(("10.9.0.1", 11311), 1).getpeername()[1])
finally:
    other.kill(); other.wait()
"""
    said = computer.inside(sys.executable, "-c", program).splitlines()
    assert said == ["10.9.0.2 [True, True, True] True", "10.9.0.3 [True, True, False] False", "itself 11311"]
