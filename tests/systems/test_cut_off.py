# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The dead-man's switch on real systems: a change that cuts the controller off takes itself back.

The controller is a computer of the lab in a network of its own, and reaches the robot by ssh through the router and the
robot's gateway: a way that a wrong route or kernel setting cuts. (The lab's own way in, through the container engine, is
never cut; here it only looks.)
"""

import json
import re
import subprocess
import sys
import sysconfig
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from machines import containers, root_files
from machines.layout import Extra, hosts_of, read_inventory

ROOT = Path(__file__).resolve().parents[2]
LAB, INVENTORY = "systems-cut-off", ROOT / "tests" / "systems" / "cut_off"
PLAYBOOK = "tests/systems/cut_off.yml"
INNER, OTHER, GATEWAY, ROUTER = "tibi-nav", "tibi-monitor", "tibi-visio", "router"
WITHIN = 5  # seconds, for what is to be taken back
ENOUGH = 120  # seconds, for what is to be confirmed, also on a busy machine

# Where the controller has ansible-core and this collection.
ANSIBLE, COLLECTIONS = "/opt/ansible", "/opt/collections"
HERE = f"{COLLECTIONS}/ansible_collections/rosfleet/multimaster"
MOUNTS = (f"{sysconfig.get_path('purelib')}:{ANSIBLE}", f"{ROOT}:{HERE}")
EXTRAS = {
    "controller": Extra(("192.168.77.10/24",), MOUNTS),
    ROUTER: Extra(("192.168.77.1/24",)),
    INNER: Extra((), MOUNTS),  # to run a module there by hand
}
BY_SSH = {
    "ansible_user": "root",
    "ansible_ssh_private_key_file": "/root/key",
    "ansible_ssh_common_args": "-o StrictHostKeyChecking=no -o UserKnownHostsFile=/dev/null -o LogLevel=ERROR",
    "ansible_python_interpreter": "/usr/bin/python3",
}
ENVIRONMENT = (
    f"LC_ALL=C.UTF-8 ANSIBLE_NOCOLOR=1 PYTHONDONTWRITEBYTECODE=1 PYTHONPATH={ANSIBLE} "
    f"ANSIBLE_COLLECTIONS_PATH={COLLECTIONS} ANSIBLE_CONFIG={HERE}/ansible.cfg"
)
BY_HAND = (
    f"PYTHONPATH={ANSIBLE}:{COLLECTIONS} python3 -B -m ansible_collections.rosfleet.multimaster.plugins.modules.%s "
    "/run/arguments"
)
DEFAULT = {"destination": "default", "gateway": "192.168.11.101"}
MORE = {"destination": "10.99.0.0/16", "gateway": "192.168.11.101"}  # a good route, to nowhere
WRONG = {"destination": "default", "gateway": "192.168.11.99"}
SENTENCE = (
    "The %s were not confirmed over a new connection within %s s, so the machine has taken them back and is as it was"
)
EARLIER = "The %s of an earlier run, not confirmed within %s s, were taken back."
SLOW = 60  # seconds that the pace of a busy machine may make of WITHIN


class Fleet:
    """A robot, its router, and the controller inside the lab."""

    together = False  # kernel settings and routes in one run, or in one after the other

    def run(self, host, command, stdin=None, check=True):
        """Run a shell command as root, past the network; returns what it printed."""
        words = ["podman", "exec", "-i", containers.container(LAB, host), "bash", "-c", command]
        done = subprocess.run(words, input=stdin, capture_output=True, text=True, timeout=600, check=False)
        assert not check or done.returncode == 0, f"{host}: {command}: {done.stdout}{done.stderr}"
        return done.stdout + done.stderr

    def play(self, **variables):
        """Run the playbook from the controller with more variables per host (`-` for `_` in their names)."""
        return self._ansible(f"playbook {HERE}/{PLAYBOOK}", variables)

    def module(self, host, name, _options="", **arguments):
        """Run one module from the controller."""
        return self._ansible(f"adhoc {_options} {host} -m rosfleet.multimaster.{name} -a '{json.dumps(arguments)}'", {})

    def _ansible(self, words, variables):
        hosts = {host.replace("_", "-"): own for host, own in variables.items()}
        inventory = {"all": {"vars": {**BY_SSH, "together": self.together}, "hosts": hosts}}
        self.run("controller", "cat >/root/hosts.json", stdin=json.dumps(inventory))
        command = f"{ENVIRONMENT} python3 -m ansible {words} -i {HERE}/tests/systems/cut_off -i /root/hosts.json"
        return " ".join(self.run("controller", command, check=False).split())

    def by_hand(self, name, **arguments):
        """Run a module on the inner computer without a controller; returns its result."""
        self.run(INNER, "cat >/run/arguments", stdin=json.dumps({"ANSIBLE_MODULE_ARGS": arguments}))
        return json.loads(self.run(INNER, BY_HAND % name, check=False))

    def state(self, host):
        """Everything that a run may change, and that nothing of the switch is left."""
        assert self.run(host, "systemctl list-units --all --no-legend 'multimaster-rollback*'") == ""
        return json.loads(self.run(host, "python3 -", stdin=(ROOT / "lab/snapshot.py").read_text()))

    def eventually(self, host, command, wanted, seconds=180):
        """Wait until a command prints something."""
        deadline = time.monotonic() + seconds
        while wanted not in (seen := self.run(host, command, check=False)):
            assert time.monotonic() < deadline, f"{host}: {command}: {seen}"
            time.sleep(0.2)

    def reboot(self, host):
        containers.restart(LAB, host)
        # A container comes back with another hardware address; whoever hears from it knows that one.
        self.eventually(host, "ping -c 1 -W 1 192.168.77.1", " 0% packet loss")


def is_taken_back(output, what, sentence=SENTENCE, least=WITHIN):
    """Return True if a sentence says so, with the seconds that were given, or with more on a busy machine."""
    said = re.search(re.escape(sentence % (what, "N")).replace("N", r"(\d+)", 1), output)
    return bool(said) and least <= int(said[1]) <= SLOW


def recap(output, host):
    """The summary of a play for a host: name -> number."""
    line = re.search(rf"\b{host} : ((?:\w+=\d+ ?)+)", output)
    assert line, output
    return {name: int(number) for name, number in re.findall(r"(\w+)=(\d+)", line[1])}


@pytest.fixture(scope="module")
def fleet():
    """After a first good run from outside, without which nobody reaches the inner computers."""
    hosts = hosts_of(read_inventory(INVENTORY), EXTRAS)
    with containers.remove_at_end(LAB):
        containers.bring_up(LAB, hosts)
        fleet = Fleet()
        connection = containers.write_inventory(LAB, hosts)
        words = [Path(sys.executable).with_name("ansible-playbook"), "-i", INVENTORY, "-i", connection, PLAYBOOK]
        done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, timeout=600, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
        fleet.run("controller", "umask 077; cat >/root/key", stdin=root_files.ssh_key().read_text())
        for host in (INNER, OTHER, GATEWAY):
            fleet.run(host, "echo 'operator ALL=(ALL) NOPASSWD: ALL' >/etc/sudoers.d/operator")
        yield fleet


ONE_BY_ONE = pytest.param(False, id="one_by_one", marks=pytest.mark.costly)


@pytest.fixture(name="way", params=[ONE_BY_ONE, pytest.param(True, id="together")])
def _way(fleet, request):
    """Both ways in which site.yml brings kernel settings and routes."""
    fleet.together = request.param
    yield
    fleet.together = False


def wrong_default(gateway, **more):
    routes = [{"destination": "default", "gateway": gateway}]
    return {"routes_list": routes, "routes_on_conflict": "replace", "routes_confirm_within": WITHIN, **more}


@pytest.mark.usefixtures("way")
def test_a_good_run_from_inside_changes_nothing(fleet):
    output = fleet.play()
    for host in (INNER, OTHER, GATEWAY, ROUTER):
        assert (recap(output, host)["changed"], recap(output, host)["failed"]) == (0, 0), output


@pytest.mark.usefixtures("way")
def test_a_wrong_default_gateway_and_setting_inside_a_robot(fleet):
    """Two ways to be cut off in one play; one of them as a person with sudo, and without pipelining."""
    before = {host: fleet.state(host) for host in (INNER, OTHER, GATEWAY)}
    no_way = [{"name": "net.ipv4.ip_default_ttl", "value": "1"}]  # no packet gets past the gateway
    output = fleet.play(
        tibi_nav=wrong_default("192.168.11.99", ansible_user="operator", ansible_pipelining=False),
        tibi_monitor={"sysctl_settings": no_way, "sysctl_confirm_within": WITHIN},
    )
    assert is_taken_back(output, "routes")
    assert is_taken_back(output, "kernel settings")
    numbers = {host: recap(output, host) for host in (INNER, OTHER, GATEWAY, ROUTER)}
    assert {host: own["failed"] for host, own in numbers.items()} == {INNER: 1, OTHER: 1, GATEWAY: 0, ROUTER: 0}
    assert not any(own["unreachable"] for own in numbers.values())
    assert {host: fleet.state(host) for host in before} == before
    test_a_good_run_from_inside_changes_nothing(fleet)


@pytest.mark.usefixtures("way")
def test_a_wrong_default_gateway_on_the_gateway(fleet):
    before = {host: fleet.state(host) for host in (INNER, GATEWAY)}
    output = fleet.play(tibi_visio=wrong_default("192.168.1.99"))
    assert is_taken_back(output, "routes")
    assert {host: recap(output, host)["failed"] for host in (INNER, GATEWAY, ROUTER)} == {
        INNER: 0,
        GATEWAY: 1,
        ROUTER: 0,
    }
    assert {host: fleet.state(host) for host in before} == before
    test_a_good_run_from_inside_changes_nothing(fleet)


def test_what_is_brought_together_is_taken_back_together(fleet):
    """Only one of the two changes cuts the controller off."""
    before, fleet.together = fleet.state(INNER), True
    try:
        good = {"sysctl_settings": [{"name": "net.ipv4.ip_default_ttl", "value": "63"}]}
        output = fleet.play(tibi_nav=wrong_default("192.168.11.99", sysctl_confirm_within=WITHIN, **good))
        assert is_taken_back(output, "kernel settings"), output
        assert "So the routes were taken back, too." in output
        assert recap(output, INNER)["failed"] == 1
        assert fleet.state(INNER) == before
        test_a_good_run_from_inside_changes_nothing(fleet)
    finally:
        fleet.together = False


def connections(fleet, host, since):
    """The TCP connections (the client's ports) over which somebody has come in since then."""
    log = fleet.run(host, f"journalctl --unit ssh --since '{since}' --output cat")
    return set(re.findall(r"Accepted publickey for root from 192\.168\.77\.10 port (\d+)", log))


@pytest.mark.costly  # the one of all concerns has it, too
def test_a_good_change_is_confirmed_by_a_new_connection(fleet):
    before = fleet.state(INNER)
    assert "pong" in fleet._ansible(f"adhoc {INNER} -m ansible.builtin.ping", {})  # the connection that is kept
    since = fleet.run(INNER, "sleep 1; date '+%F %T'").strip()
    output = fleet.module(INNER, "routes", "--diff", routes=[DEFAULT, MORE], confirm_within=ENOUGH)
    assert "CHANGED" in output and "+10.99.0.0/16 via 192.168.11.101" in output, output
    assert len(connections(fleet, INNER, since)) == 1  # the first run had the kept one, the second a new one
    fleet.state(INNER)  # no timer waits

    since = fleet.run(INNER, "sleep 1; date '+%F %T'").strip()
    assert '"changed": false' in fleet.module(INNER, "routes", routes=[DEFAULT, MORE], confirm_within=ENOUGH)
    assert len(connections(fleet, INNER, since)) == 0  # nothing to confirm, so no second run

    fleet.reboot(INNER)
    assert "10.99.0.0/16 via 192.168.11.101" in fleet.run(INNER, "ip route")
    assert recap(fleet.play(), INNER)["changed"] == 1  # what is not in the plan is taken back
    assert fleet.state(INNER) == before


def test_a_kept_connection_confirms_nothing(fleet):
    """Two sessions over one TCP connection, then another connection."""
    before = fleet.state(INNER)
    address = f"-i /root/key {BY_SSH['ansible_ssh_common_args']} root@192.168.11.100"
    fleet.run("controller", f"ssh -o ControlMaster=yes -o ControlPath=/tmp/kept -o ControlPersist=60 {address} true")

    def session(kept, **arguments):
        fleet.run(INNER, "cat >/run/arguments", stdin=json.dumps({"ANSIBLE_MODULE_ARGS": arguments}))
        way = "-o ControlPath=/tmp/kept" if kept else "-o ControlPath=none"
        return json.loads(fleet.run("controller", f"ssh {way} {address} '{BY_HAND % 'routes'}'"))

    routes = {"routes": [DEFAULT, MORE], "confirmation": "word"}
    assert session(True, confirm_within=600, **routes)["unconfirmed"]
    again = session(True, **routes)
    assert (again["unconfirmed"], again["same_connection"], again["changed"]) == (True, True, False)
    new = session(False, **routes)
    assert (new["unconfirmed"], new["changed"]) == (False, True)
    assert '"changed": true' in fleet.module(INNER, "routes", routes=[DEFAULT], confirm_within=ENOUGH)
    assert fleet.state(INNER) == before


def test_all_concerns_are_confirmed_over_a_new_connection(fleet):
    before = fleet.state(INNER)
    assert "pong" in fleet._ansible(f"adhoc {INNER} -m ansible.builtin.ping", {})  # the connection that is kept
    since = fleet.run(INNER, "sleep 1; date '+%F %T'").strip()
    output = fleet.module(INNER, "multimaster_computer", routes={"routes": [DEFAULT, MORE], "confirm_within": ENOUGH})
    assert '"confirmed": true' in output, output
    assert len(connections(fleet, INNER, since)) == 1
    output = fleet.module(INNER, "multimaster_computer", routes={"routes": [DEFAULT], "confirm_within": ENOUGH})
    assert '"confirmed": true' in output, output
    assert fleet.state(INNER) == before


def test_the_controller_loses_its_power(fleet):
    before = fleet.state(INNER)
    within = 20  # long enough to be seen
    arguments = {"routes": [WRONG], "on_conflict": "replace", "confirm_within": within}
    with ThreadPoolExecutor() as pool:
        pool.submit(fleet.module, INNER, "routes", **arguments)
        try:
            fleet.eventually(INNER, "ip route show default", "192.168.11.99")
        finally:
            fleet.reboot("controller")
    fleet.eventually(INNER, "ip route show default", "192.168.11.101")
    # The next run says what happened, and is a good one.
    output = fleet.play()
    assert is_taken_back(output, "routes", EARLIER, within)
    assert recap(output, INNER)["failed"] == 0
    assert fleet.state(INNER) == before


def test_the_machine_loses_its_power_before_the_confirmation(fleet):
    before = fleet.state(INNER)
    changes = {
        "routes": {"routes": [DEFAULT, MORE]},
        "sysctl": {"settings": [{"name": "net.ipv4.ip_default_ttl", "value": "63"}]},
    }
    for name, arguments in changes.items():
        assert fleet.by_hand(name, confirm_within=600, confirmation="word", **arguments)["unconfirmed"]
    assert fleet.run(INNER, "cat /proc/sys/net/ipv4/ip_default_ttl; ip route").startswith("63\n")
    fleet.reboot(INNER)
    assert fleet.state(INNER) == before
    late = fleet.by_hand("routes", confirmation="word", **changes["routes"])
    assert late["failed"] and "can no longer be confirmed: the machine has been restarted" in late["msg"]
    assert fleet.state(INNER) == before


def test_a_broken_off_run_is_taken_back_by_the_next_one(fleet):
    before = fleet.state(INNER)
    assert fleet.by_hand("routes", confirm_within=600, confirmation="word", routes=[DEFAULT, MORE])["unconfirmed"]
    assert "10.99.0.0/16" in fleet.run(INNER, "ip route")
    units = fleet.run(INNER, "systemctl list-units --all --no-legend 'multimaster-rollback*'")
    assert "multimaster-rollback-routes.timer" in units and "multimaster-rollback-routes.service" in units
    output = fleet.play()
    assert "The routes of an earlier run, not confirmed within 600 s, were taken back first." in output
    assert recap(output, INNER)["failed"] == 0
    assert fleet.state(INNER) == before


KILLED = """
import os, signal, subprocess
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction import deadman
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes import run as routes
options = {"routes": [%(route)s], "backends": {}, "on_conflict": "replace", "root": "/", "records": "/var/lib/rosfleet-multimaster"}
run = routes.RoutesRun(options)
deadman.Switch("routes").arm("word", %(within)d, run.undo_steps(), run.memory)
if %(half)s:
    run.apply_runtime()
subprocess.run(["ip", "route", "show", "default"])  # here: another command may come after the switch has rung
os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.parametrize("half", [pytest.param(False, marks=pytest.mark.costly), True])
def test_the_module_is_killed(fleet, half):
    before = fleet.state(INNER)
    full = dict(WRONG, device=None, metric=None, table=254, source=None, on_link=False, type="unicast", backend="auto")
    program = KILLED % {"route": full, "half": half, "within": WITHIN}
    said = fleet.run(INNER, f"PYTHONPATH={ANSIBLE}:{COLLECTIONS} python3 -B -", stdin=program, check=False)
    assert "default via" in said and ("192.168.11.99" in said) == half, said
    fleet.eventually(INNER, "ls /run/rosfleet-multimaster/rollback-routes", "rolled_back")
    output = fleet.module(INNER, "routes", routes=[DEFAULT], confirm_within=ENOUGH)
    assert f"not confirmed within {WITHIN} s, were taken back." in output and '"changed": false' in output, output
    assert fleet.state(INNER) == before


# The packet filter

FILTERED = dict.fromkeys(("tibi_nav", "tibi_monitor", "tibi_visio"), {"multimaster_firewall": "fleet"})
MEMBERS = ["192.168.11.100", "192.168.11.101"]
# What a person has in front of the ssh server: a relay, which no filter can tell from any other program.
RELAY = """
import socket, threading
def pass_on(here, there):
    while data := here.recv(65536):
        there.sendall(data)
    there.shutdown(socket.SHUT_WR)
server = socket.create_server(("0.0.0.0", 2222))
while True:
    outer, inner = server.accept()[0], socket.create_connection(("127.0.0.1", 22))
    for pair in ((outer, inner), (inner, outer)):
        threading.Thread(target=pass_on, args=pair, daemon=True).start()
"""


def by_port(fleet, port):
    """Run the module on the inner computer over another port, which the inventory does not know as one of ssh."""
    arguments = json.dumps({"members": MEMBERS, "confirm_within": WITHIN})
    way = {"ansible_ssh_common_args": f"{BY_SSH['ansible_ssh_common_args']} -o Port={port}"}
    return fleet._ansible(f"adhoc {INNER} -m rosfleet.multimaster.firewall -a '{arguments}'", {"tibi_nav": way})


@pytest.mark.costly
def test_a_controller_outside_the_fleet_passes_filters_by_ssh(fleet):
    """Its way leads through the filters of the router and of the gateway to that of the inner computer."""
    hosts = (INNER, OTHER, GATEWAY, ROUTER)
    for variables, there in ((FILTERED, True), ({}, False)):
        output = fleet.play(**variables)
        for host in hosts:
            assert (recap(output, host)["failed"], recap(output, host)["unreachable"]) == (0, 0), output
            rules = fleet.run(host, "nft list ruleset")
            assert ("rosfleet_multimaster" in rules) is there, host
            assert ("hook forward" in rules) is (there and host in (GATEWAY, ROUTER)), host


def test_a_packet_filter_that_cuts_the_controller_is_taken_back(fleet):
    before = fleet.state(INNER)
    fleet.run(INNER, "cat >/run/relay.py; systemd-run --quiet --unit relay python3 /run/relay.py", stdin=RELAY)
    try:
        output = by_port(fleet, 2222)
    finally:
        fleet.run(INNER, "systemctl stop relay; rm /run/relay.py")
    assert is_taken_back(output, "packet filter rules"), output
    assert fleet.state(INNER) == before


# A way in that is no ssh: it runs what it is sent, once.
AGENT = """
import socket, subprocess
server = socket.create_server(("0.0.0.0", 2223))
connection = server.accept()[0]
command = connection.recv(65536).decode()
connection.sendall(subprocess.run(["sh", "-c", command], stdout=-1, stderr=-2).stdout)
"""
CALL = """
import socket, sys
connection = socket.create_connection(("192.168.11.100", 2223))
connection.sendall(sys.argv[1].encode())
while data := connection.recv(65536):
    print(data.decode(), end="")
"""


def test_a_way_in_that_is_no_ssh_is_refused_before_any_change(fleet):
    before = fleet.state(INNER)
    fleet.run(
        INNER, "cat >/run/agent.py; systemd-run --quiet --collect --unit agent python3 /run/agent.py", stdin=AGENT
    )
    fleet.run(INNER, "cat >/run/arguments", stdin=json.dumps({"ANSIBLE_MODULE_ARGS": {"members": MEMBERS}}))
    fleet.eventually(INNER, "ss -Hltn 'sport = :2223'", "2223")
    output = fleet.run("controller", f"python3 - '{BY_HAND % 'firewall'}'", stdin=CALL)
    fleet.run(INNER, "rm /run/agent.py /run/arguments")
    assert "192.168.77.10 reaches this computer on TCP port 2223 of python3, which is no ssh server" in output, output
    assert fleet.state(INNER) == before


def test_a_teardown_stops_when_the_controller_needs_the_routes(fleet):
    """The gateway and the router go on forwarding, or nobody would reach the inner computers again."""
    quick = {"routes_confirm_within": WITHIN, "sysctl_confirm_within": WITHIN, "firewall_confirm_within": WITHIN}
    hosts = dict.fromkeys((INNER, OTHER, GATEWAY, ROUTER), quick)
    output = fleet._ansible(f"playbook {HERE}/playbooks/teardown.yml", hosts)
    assert is_taken_back(output, "kernel settings") and "So the routes were taken back, too." in output
    assert "The machines are as they were before" not in output
    for host in (GATEWAY, ROUTER):
        assert fleet.run(host, "cat /proc/sys/net/ipv4/ip_forward") == "1\n"
    output = fleet.play()
    assert not any(recap(output, host)["failed"] + recap(output, host)["unreachable"] for host in hosts), output
