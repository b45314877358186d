# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The module routes against real kernels: each test has a network namespace with two links, and files in a folder."""

import json
import os
import random
import select
import shutil
import subprocess
import sys
import time
from pathlib import Path

import ansible_collections
import pytest
from killed import UNTIL
from mentioned import mentions
from namespaces import why_not
from planned_routes import DEFAULTS

from tests.unit import module_server

TOOLS = ("ip", "unshare", "nsenter")
COLLECTIONS = Path(next(iter(ansible_collections.__path__))).parent
MODULE = "routes"
HOOK = "etc/network/if-up.d/rosfleet-multimaster"

# Runs one after another in processes of their own, each ended, as by kill -9, before its change of this number (0: never).
RUNS = (
    UNTIL
    + """
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes import run as routes_run
routes_run.kernel.change_route = until(routes_run.kernel.change_route)
for options, left in json.load(sys.stdin):
    if os.fork() == 0:
        run = routes_run.RoutesRun(options)
        run.apply()
        print(json.dumps([run.changed, run.refusals]), flush=True)
        os._exit(0)
    if os.WIFSIGNALED(os.wait()[1]):
        print(json.dumps("killed"), flush=True)
"""
)


pytestmark = pytest.mark.skipif(bool(why_not()), reason=why_not() or "can run")


class Computer:
    """A kernel's routes, and the files of ifupdown."""

    def __init__(self, root):
        self.root = root
        self.holder = subprocess.Popen(["unshare", "--net", "sleep", "300"])
        own = os.readlink("/proc/self/ns/net")
        while os.readlink(f"/proc/{self.holder.pid}/ns/net") == own:
            time.sleep(0.005)
        self.as_user = []  # what makes another user of root
        self.enter = [shutil.which("nsenter"), "--target", str(self.holder.pid), "--net"]
        for number, port in enumerate(("eth0", "eth1"), 11):
            self.ip(f"link add {port} type veth peer name {port}peer")
            self.ip(f"link set {port} up")
            self.ip(f"link set {port}peer up")
            self.ip(f"address add 192.168.{number}.100/24 dev {port}")
            self.ip(f"address add fd00:{number}::100/64 dev {port} nodad")
        (root / "etc/network/if-up.d").mkdir(parents=True)
        (root / "run/network").mkdir(parents=True)
        (root / "run/network/ifstate").write_text("eth0=eth0\neth1=eth1\n")
        self.monitor = None

    def ip(self, words):
        return subprocess.run([*self.enter, "ip", *words.split()], check=True, capture_output=True, text=True).stdout

    def routes(self):
        """The kernel's routes without those that it makes itself."""
        tables = [self.ip(f"-{version} route show") for version in (4, 6)]
        lines = [line.strip() for text in tables for line in text.splitlines() if "proto kernel" not in line]
        return sorted(lines)

    def options(self, routes, **options):
        given = {"routes": routes, "root": str(self.root), "records": str(self.root / "var"), **options}
        return {"ANSIBLE_MODULE_ARGS": {"_ansible_diff": True, **given}}

    def python(self, *arguments, **options):
        environment = {**os.environ, "PYTHONPATH": str(COLLECTIONS)}
        argv = [*self.enter, *self.as_user, sys.executable, *arguments]
        return subprocess.run(argv, env=environment, capture_output=True, text=True, check=False, **options)

    def run(self, *routes, **options):
        """One run of the module."""
        given = self.options(list(routes), **options)
        if self.as_user:
            done = self.python(*module_server.command(MODULE)[1:], input=json.dumps(given))
        else:
            done = module_server.run(MODULE, given["ANSIBLE_MODULE_ARGS"], f"/proc/{self.holder.pid}/ns/net")
        assert done.stdout, done.stderr
        return json.loads(done.stdout)

    def at_once(self, lists, pause):
        """Runs of the module at the same time, each with its list, the second one a pause after the first."""
        many = [self.options(routes)["ANSIBLE_MODULE_ARGS"] for routes in lists]
        ended = module_server.at_once(MODULE, many, f"/proc/{self.holder.pid}/ns/net", [pause])
        return [json.loads(done.stdout) for done in ended]

    def full(self, routes):
        """The options with which the module makes its Run."""
        items = [{**DEFAULTS, **item} for item in routes]
        return {
            "routes": items,
            "backends": {},
            "on_conflict": "replace",
            "root": str(self.root),
            "records": str(self.root / "var"),
        }

    def sequence(self, *runs):
        """Runs of (routes, the number of the change before which it is killed or 0): whether each changed something."""
        done = self.python("-c", RUNS, input=json.dumps([(self.full(routes), step) for routes, step in runs]))
        assert not done.stderr, done.stderr
        return [json.loads(line) for line in done.stdout.splitlines()]

    def files(self):
        return {str(p.relative_to(self.root)): p.read_text() for p in self.root.rglob("*") if p.is_file()}

    def watch(self):
        """Have `ip monitor` watch. It does when it has seen a route that comes and goes."""
        self.monitor = subprocess.Popen([*self.enter, "ip", "monitor", "route"], stdout=subprocess.PIPE, text=True)
        while not select.select([self.monitor.stdout], [], [], 0.05)[0]:
            self.ip("route add 203.0.113.78 dev eth0")
            self.ip("route delete 203.0.113.78 dev eth0")

    def seen(self):
        """Return what `ip monitor` has seen, without the routes of the kernel and those of `watch`."""
        self.ip("route add 203.0.113.77 dev eth0")  # the end of what is to be seen
        lines = []
        for line in self.monitor.stdout:
            if "203.0.113.77" in line:
                break
            if "table local" not in line and "203.0.113.78" not in line:  # the first the kernel keeps by itself
                lines.append(line.strip())
        self.monitor.kill()
        self.monitor.wait()
        self.ip("route delete 203.0.113.77 dev eth0")
        return lines

    def end(self):
        self.holder.kill()
        self.holder.wait()


@pytest.fixture
def computer(tmp_path):
    made = Computer(tmp_path)
    yield made
    made.end()


FOUR = {"destination": "default", "gateway": "192.168.11.101"}
SIX = {"destination": "::/0", "gateway": "fd00:11::101"}
HOLE = {"destination": "10.66.0.0/16", "type": "blackhole"}
OTHERS = ["10.9.0.0/16 via 192.168.11.7 dev eth0", "fd00:99::/64 via fd00:11::7 dev eth0 metric 1024 pref medium"]


def others(computer):
    computer.ip("route add 10.9.0.0/16 via 192.168.11.7")
    computer.ip("route add fd00:99::/64 via fd00:11::7")


def test_routes_are_found_again_and_removed_without_a_trace(computer):
    others(computer)
    files = computer.files()
    planned = computer.run(FOUR, SIX, HOLE, _ansible_check_mode=True)
    assert (computer.routes(), computer.files()) == (OTHERS, files)

    made = computer.run(FOUR, SIX, HOLE)
    assert planned == made
    assert made["changed"]
    assert [(r["state"], r["device"], r["backend"]) for r in made["routes"]] == [
        ("changed", "eth0", "ifupdown"),
        ("changed", "eth0", "ifupdown"),
        ("changed", None, "ifupdown"),
    ]
    assert computer.routes() == sorted(
        [*OTHERS, *(r["after"] + (" pref medium" if ":" in r["after"] else "") for r in made["routes"])]
    )
    assert [d["before_header"] for d in made["diff"]] == ["routes at run time", f"/{HOOK} (absent)"]

    again = computer.run(FOUR, SIX, HOLE)
    assert (again["changed"], again["diff"], {r["state"] for r in again["routes"]}) == (False, [], {"ok"})

    gone = computer.run()
    assert (gone["changed"], {t["state"] for t in gone["taken_back"]}) == (True, {"removed"})
    assert (computer.routes(), computer.files()) == (OTHERS, files)
    assert not computer.run()["changed"]


def test_after_a_reboot_the_hook_brings_them_back(computer):
    far = {
        "destination": "10.67.0.0/16",
        "gateway": "10.8.8.8",
        "device": "eth1",
        "on_link": True,
        "metric": 7,
        "table": 100,
    }
    listed = (FOUR, SIX, HOLE, far, {"destination": "226.0.0.0/8", "device": "eth1", "source": "192.168.12.100"})
    computer.run(*listed)
    routes, table = computer.routes(), computer.ip("route show table 100")
    for version in "46":
        computer.ip(f"-{version} route flush table main proto static")
    computer.ip("route flush table 100")
    assert computer.routes() == []
    for interface in ("eth1", "eth0", "eth0"):
        environment = {"IFACE": interface, "PATH": "/nowhere"}
        done = subprocess.run([*computer.enter, computer.root / HOOK], env=environment, capture_output=True, check=True)
        assert (done.stdout, done.stderr) == (b"", b"")
    assert (computer.routes(), computer.ip("route show table 100")) == (routes, table)
    assert not computer.run(*listed)["changed"]


def test_the_hook_acts_for_its_interface_alone(computer):
    computer.run(FOUR)
    computer.ip("route delete default")
    for interface in ("eth1", "lo", "--all", ""):
        subprocess.run([*computer.enter, computer.root / HOOK], env={"IFACE": interface}, check=True)
    assert computer.routes() == []
    computer.ip("link set eth0 down")
    done = subprocess.run(
        [*computer.enter, computer.root / HOOK], env={"IFACE": "eth0"}, capture_output=True, check=True
    )
    assert (done.stdout, done.stderr) == (b"", b"")


@pytest.mark.parametrize("route", [FOUR, SIX], ids=["IPv4", "IPv6"])
def test_another_gateway_leaves_no_moment_without_a_route(computer, route):
    computer.run(route)
    computer.watch()
    moved = {**route, "gateway": route["gateway"].replace("101", "102")}
    assert computer.run(moved)["changed"]
    seen = computer.seen()
    assert len(seen) == 1
    assert seen[0].startswith(f"default via {moved['gateway']} dev eth0 proto static")
    assert len(computer.routes()) == 1


@pytest.mark.slow
@pytest.mark.parametrize("route", [FOUR, SIX], ids=["IPv4", "IPv6"])
def test_another_metric_leaves_no_moment_without_a_route(computer, route):
    computer.run(route)
    computer.watch()
    assert computer.run({**route, "metric": 7})["changed"]
    added, deleted = computer.seen()
    assert (added.startswith("default"), "metric 7" in added) == (True, True)
    assert (deleted.startswith("Deleted default"), "metric 7" in deleted) == (True, False)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["blackhole", "unreachable", "prohibit"])
@pytest.mark.parametrize("destination", ["10.5.0.0/16", "fd00:5::/64"])
def test_a_way_becomes_none_and_comes_back(computer, kind, destination):
    way = {"destination": destination, "gateway": "fd00:11::9" if ":" in destination else "192.168.11.9"}
    computer.run(way)
    assert computer.run({"destination": destination, "type": kind})["changed"]
    assert [line.split()[:2] for line in computer.routes()] == [[kind, destination]]
    assert not computer.run({"destination": destination, "type": kind})["changed"]
    computer.run(way)
    assert [line.split()[:2] for line in computer.routes()] == [[destination, "via"]]


def test_a_right_route_of_somebody_else_is_adopted_and_stays(computer):
    computer.ip("route add default via 192.168.11.101")
    made = computer.run(FOUR)
    assert made["routes"][0]["before"] == "default via 192.168.11.101 dev eth0 proto boot"
    assert (made["routes"][0]["state"], HOOK in computer.files()) == ("changed", True)  # the boot part
    assert not computer.run(FOUR)["changed"]
    computer.run()
    assert computer.routes() == ["default via 192.168.11.101 dev eth0"]
    assert HOOK not in computer.files()


@pytest.mark.slow
@pytest.mark.parametrize(
    "before",
    [
        ["default via 192.168.11.1 dev eth0 mtu 1400"],
        ["default via 192.168.12.1 dev eth1 proto dhcp src 192.168.12.100"],
        ["default nexthop via 192.168.11.3 dev eth0 weight 1 nexthop via 192.168.11.4 dev eth0 weight 2"],
        ["default via 192.168.11.1 dev eth0", "default via 192.168.11.2 dev eth0"],
        ["::/0 via fd00:12::1 dev eth1 metric 1024"],
        ["::/0 via fd00:11::1 dev eth0 metric 1024", "::/0 via fd00:11::2 dev eth0 metric 1024"],
        ["::/0 dev eth0 metric 1024"],
    ],
)
def test_another_way_of_others_is_a_conflict_or_given_back(computer, before):
    for words in before:
        computer.ip(f"route append {words}")
    listed = SIX if "::" in before[0] else FOUR
    routes, files = computer.routes(), computer.files()

    refused = computer.run(listed)
    assert refused["failed"]
    assert "set on_conflict to replace" in refused["msg"]
    assert (refused["routes"][0]["state"], len(refused["conflicts"])) == ("conflict", 1)
    assert (computer.routes(), computer.files()) == (routes, files)

    made = computer.run(listed, on_conflict="replace")
    assert made["changed"]
    assert len([line for line in computer.routes() if line.startswith("default")]) == 1
    assert not computer.run(listed)["changed"]  # it is ours now
    back = computer.run()
    assert back["taken_back"][0]["state"] == "restored"
    assert (computer.routes(), computer.files()) == (routes, files)


@pytest.mark.parametrize(("protocol", "state"), [("static", "refused"), ("dhcp", "refused"), ("boot", "changed")])
def test_what_a_manager_would_make_again_at_boot_is_not_replaced(computer, protocol, state):
    (computer.root / "run/network/ifstate").unlink()
    index = json.loads(computer.ip("-json link show eth0"))[0]["ifindex"]
    links = computer.root / "run/systemd/netif/links"
    links.mkdir(parents=True)
    (links / str(index)).write_text("ADMIN_STATE=configured\nNETWORK_FILE=/etc/systemd/network/50-robot.network\n")
    computer.ip(f"route add default via 192.168.11.1 proto {protocol}")
    done = computer.run(FOUR, on_conflict="replace")
    assert [r["state"] for r in done["routes"]] == [state]
    assert (state == "changed") or "comes from networkd" in done["msg"]


def test_connected_routes_are_never_replaced(computer):
    for destination in ("192.168.11.0/24", "fd00:11::/64"):
        item = {"destination": destination, "device": "eth0", "metric": 256 if ":" in destination else 0}
        refused = computer.run(item, on_conflict="replace")
        assert "never replaced" in refused["msg"]


def test_a_second_default_route_is_reported(computer):
    computer.ip("route add default via 192.168.12.1 proto dhcp metric 100")
    computer.ip("route add ::/0 via fd00:12::1 metric 5")
    made = computer.run(FOUR)
    assert [other["text"] for other in made["other_defaults"]] == [
        "default via 192.168.12.1 dev eth1 proto dhcp metric 100"
    ]
    assert len([sentence for sentence in made["warnings"] if "second default route" in str(sentence)]) == 1
    assert computer.run({"destination": "10.0.0.0/8", "gateway": "192.168.11.1"})["other_defaults"] == []


def test_a_run_that_the_kernel_refuses_half_way_is_undone(computer):
    computer.run(FOUR, HOLE)
    routes, files = computer.routes(), computer.files()
    moved = {**FOUR, "gateway": "192.168.11.102"}
    wrong = {"destination": "10.7.0.0/16", "gateway": "224.0.0.9", "device": "eth0", "on_link": True}
    failed = computer.run(moved, {"destination": "10.8.0.0/16", "gateway": "192.168.11.7"}, wrong)
    assert mentions(failed["msg"], "-4", "10.7.0.0/16")
    assert failed["msg"].endswith("Everything is as it was before.")
    assert (computer.routes(), computer.files()) == (routes, files)


def test_a_boot_part_that_cannot_be_written_puts_the_kernel_back(computer):
    others(computer)
    (computer.root / "etc/network/if-up.d").rmdir()
    (computer.root / "etc/network/if-up.d").write_text("in the way")
    files = computer.files()
    failed = computer.run(FOUR, SIX)
    assert "if-up.d" in failed["msg"]
    assert computer.routes() == OTHERS
    assert HOOK not in computer.files()
    assert set(computer.files()) == set(files)


@pytest.mark.slow
@pytest.mark.parametrize("step", range(1, 13))
def test_what_a_killed_run_leaves_is_mended_or_taken_back(computer, step):
    others(computer)
    computer.ip("route add default via 192.168.11.1")
    routes, files = computer.routes(), computer.files()
    old = (FOUR, {"destination": "10.8.0.0/16", "gateway": "192.168.11.7"})
    new = ({**FOUR, "gateway": "192.168.11.102"}, SIX, HOLE)
    runs = [(old, step), (old, 0), (old, 0), (new, step), (new, 0), (new, 0), ((), step), ((), 0), ((), 0)]
    done = computer.sequence(*runs)
    # At every stage a killed run is followed by the same one, and then nothing is left to do.
    assert [result for result, (routes_, step_) in zip(done, runs, strict=True) if not step_][1::2] == [[False, []]] * 3
    assert step > 7 or done[0] == "killed"
    assert (computer.routes(), computer.files()) == (routes, files)


@pytest.mark.slow
@pytest.mark.parametrize("step", range(1, 13))
def test_a_killed_run_can_be_followed_by_the_removal(computer, step):
    others(computer)
    computer.ip("route add default via 192.168.11.1")
    routes, files = computer.routes(), computer.files()
    computer.sequence(((FOUR, SIX, HOLE), step), ((), 0))
    assert (computer.routes(), computer.files()) == (routes, files)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_two_runs_at_once_leave_no_route_without_an_owner(computer, seed):
    chance = random.Random(seed)
    others(computer)
    routes, files = computer.routes(), computer.files()
    for _round in range(2):
        lists = [
            [{"destination": f"10.{100 + number}.0.0/16", "gateway": "192.168.11.7"} for number in numbers]
            for numbers in (chance.sample(range(8), 4), chance.sample(range(8), 4))
        ]
        ended = computer.at_once(lists, chance.random() * 0.3)
        assert [bool(result.get("failed")) for result in ended] == [False, False], ended
        # One came after the other, so what it wanted is there and nothing else.
        there = {line.split()[0] for line in computer.routes()} - {line.split()[0] for line in OTHERS}
        assert there in [{route["destination"] for route in one} for one in lists]
    assert not computer.run()["msg"].startswith("No routes are ours.")
    assert (computer.routes(), computer.files()) == (routes, files)


def test_an_unknown_interface_is_one_sentence_before_a_change(computer):
    (computer.root / "run/network/ifstate").write_text("")
    failed = computer.run(FOUR, SIX)
    assert "manages eth0" in failed["msg"]
    assert "set backend to none" in failed["msg"]
    assert computer.routes() == []
    made = computer.run({**FOUR, "backend": "none"})
    assert (made["routes"][0]["boot_file"], HOOK in computer.files()) == (None, False)
    assert computer.run(SIX, backends={"eth0": "none"})["changed"]
    assert [line.split()[:3] for line in computer.routes()] == [["default", "via", "fd00:11::101"]]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"backends": {"eth9": "networkd"}}, "no interface eth9"),
        ({"backends": {"eth0": "dhcpcd"}}, "expected one of auto"),
        ({"records": "var"}, "absolute"),
    ],
)
def test_wrong_options_are_one_sentence(computer, options, words):
    assert words in computer.run(FOUR, **options)["msg"]
    assert computer.routes() == []


def test_the_switch_brings_the_kernel_back_from_half_way(computer):
    computer.ip("route add default via 192.168.11.1")
    before = computer.routes()
    program = """
import json, subprocess, sys
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes.kernel import change_route
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes.run import RoutesRun
run = RoutesRun(json.load(sys.stdin))
for half in range(len(run.plan.changes) + 1):
    for change in run.plan.changes[:half]:
        change_route(change.command)
    for argv in run.undo_steps():
        subprocess.run(argv, check=True)
"""
    done = computer.python("-c", program, input=json.dumps(computer.full((FOUR, SIX, HOLE))))
    assert done.stderr == ""
    assert computer.routes() == before


@pytest.mark.slow
@pytest.mark.parametrize("status", [2, -1])
def test_a_route_that_is_not_removed_stays_ours(computer, status):
    """`ip route del` fails, or gives no answer: the sentence says so, and the next run removes the route."""
    computer.run(FOUR)
    program = """
import json, sys
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes import kernel
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes.run import RoutesRun
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.commands import Answer
options, status = json.load(sys.stdin)
run, really = RoutesRun(options), kernel.run
kernel.run = lambda argv, **more: Answer(status, b"", "Device or resource busy") if "del" in argv else really(argv, **more)
try:
    run.apply()
except Exception as problem:
    print(type(problem).__name__, problem)
"""
    files, routes = computer.files(), computer.routes()
    done = computer.python("-c", program, input=json.dumps([computer.full(()), status]))
    assert done.stdout.startswith("StepFailure routes: the kernel ") and "default via" in done.stdout, done.stderr
    assert (computer.files(), computer.routes()) == (files, routes)
    assert computer.run()["changed"] and computer.routes() == []


@pytest.mark.slow
def test_the_run_time_alone_writes_no_file(computer):
    files = computer.files()
    program = """
import json, sys
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes.run import RoutesRun
options = json.load(sys.stdin)
first = RoutesRun(options)
first.apply_runtime()
print(json.dumps(first.memory))
"""
    done = computer.python("-c", program, input=json.dumps(computer.full((FOUR, SIX))))
    assert computer.files() == files
    assert len(computer.routes()) == 2
    program = """
import json, sys
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes.run import RoutesRun
options, memory = json.load(sys.stdin)
run = RoutesRun(options, memory)
print(run.runtime_changes, run.changed)
run.apply()
"""
    given = [computer.full((FOUR, SIX)), json.loads(done.stdout)]
    assert computer.python("-c", program, input=json.dumps(given)).stdout == "False True\n"
    assert HOOK in computer.files()
    computer.run()
    assert (computer.routes(), computer.files()) == ([], files)


def test_the_way_back_makes_the_link_network_first(computer):
    """A default route sorts first, and its gateway is in a network that is ours too."""
    listed = (
        {"destination": "172.16.0.0/24", "device": "eth0"},
        {"destination": "default", "gateway": "172.16.0.1", "device": "eth0"},
    )
    assert computer.run(*listed)["changed"]
    before = computer.routes()
    program = """
import json, subprocess, sys
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes.run import RoutesRun
run = RoutesRun(json.load(sys.stdin))
run.apply_runtime()
for argv in run.undo_steps():
    subprocess.run(argv, check=True)
"""
    done = computer.python("-c", program, input=json.dumps(computer.full(())))
    assert done.stderr == ""
    assert computer.routes() == before


def test_a_route_that_cannot_be_given_back_blocks_no_removal(computer):
    """The robot's network has another address since."""
    files = computer.files()
    computer.ip("route add default via 192.168.11.1")
    assert computer.run(FOUR, on_conflict="replace")["changed"]
    computer.ip("address add 192.168.21.100/24 dev eth0")
    renumbered = {"destination": "default", "gateway": "192.168.21.101"}
    assert computer.run(renumbered, on_conflict="replace")["changed"]
    computer.ip("address delete 192.168.11.100/24 dev eth0")
    back = computer.run()
    assert back["changed"], back
    assert back["taken_back"][0]["state"] == "lost"
    assert "cannot be given back" in back["msg"]
    assert (computer.routes(), computer.files()) == ([], files)


def test_of_the_routes_in_its_place_the_last_one_comes_back(computer):
    for last in (1, 2, 3):
        computer.ip(f"route replace default via 192.168.11.{last}")
        assert computer.run(FOUR, on_conflict="replace")["changed"]
    computer.run()
    assert computer.routes() == ["default via 192.168.11.3 dev eth0"]


def test_a_hook_that_has_lost_its_permissions_gets_them_back(computer):
    computer.run(FOUR)
    hook = computer.root / HOOK
    hook.chmod(0o644)
    checked = computer.run(FOUR, _ansible_check_mode=True)
    assert checked["changed"] and not os.access(hook, os.X_OK)
    repaired = computer.run(FOUR)
    assert (repaired["diff"], [(one["before"], one["after"]) for one in repaired["diff"]]) == (
        checked["diff"],
        [("mode 0644\n", "mode 0755\n")],
    )
    assert repaired["changed"] and repaired["routes"][0]["state"] == "changed"
    assert os.access(hook, os.X_OK)
    assert not computer.run(FOUR)["changed"]


def drawn(chance, number):
    """A route of any kind, with a destination of its own."""
    version = chance.choice((4, 6))
    length = chance.choice((16, 24, 32)) if version == 4 else chance.choice((48, 64, 128))
    address = f"10.{number}.0.0" if version == 4 else f"fd00:1{number:02}::"
    route = {
        "destination": f"{address}/{length}",
        "metric": chance.choice((None, 7)),
        "table": chance.choice((254, 77)),
    }
    if chance.random() < 0.2:
        return {**route, "type": chance.choice(("blackhole", "unreachable", "prohibit", "throw"))}
    near, own = ("192.168.11.9", "192.168.11.100") if version == 4 else ("fd00:11::9", "fd00:11::100")
    if chance.random() < 0.7:
        route.update(gateway=near, on_link=chance.random() < 0.4)
    if "gateway" not in route or route["on_link"] or chance.random() < 0.3:
        route["device"] = "eth0"
    if chance.random() < 0.4:
        route["source"] = own
    if version == 4 and chance.random() < 0.5:
        route["scope"] = "global" if "gateway" in route else chance.choice(("link", "host"))
    for name, most in (("mtu", 1500), ("advmss", 1460), ("initcwnd", 30)):
        if chance.random() < 0.5:
            route[name] = chance.randrange(1280 if name == "mtu" else 4, most)
    return route


@pytest.mark.costly
@pytest.mark.parametrize("seed", range(6))
def test_check_mode_says_in_the_same_words_what_the_run_does(computer, seed):
    chance = random.Random(seed)
    lists = [[drawn(chance, number) for number in range(10, 22)] for _list in range(3)]
    lists.append(
        [{**route, "on_link": "gateway" in route, "device": "eth0"} for route in lists[-1] if "type" not in route]
    )
    for listed in [*lists, []]:
        options = {"backends": {"eth0": "none", "eth1": "none"}}
        checked = computer.run(*listed, **options, _ansible_check_mode=True)
        assert "failed" not in checked, checked["msg"]
        made = computer.run(*listed, **options)
        for name in ("changed", "routes", "taken_back", "diff"):
            assert made[name] == checked[name]
        again = computer.run(*listed, **options)
        assert (again["changed"], again["diff"], {item["state"] for item in again["routes"]} <= {"ok"}) == (
            False,
            [],
            True,
        )
        assert [item["after"] for item in again["routes"]] == [item["after"] for item in made["routes"]]


@pytest.mark.slow
@pytest.mark.parametrize("route", [FOUR, SIX], ids=["IPv4", "IPv6"])
def test_on_link_comes_and_goes_with_the_option(computer, route):
    computer.run(route)
    on_link = {**route, "device": "eth0", "on_link": True}
    for listed, there in ((on_link, True), (route, False), (on_link, True)):
        assert computer.run(listed)["routes"][0]["state"] == "changed"
        assert [line.split("proto")[1].count("onlink") for line in computer.routes()] == [int(there)]
        assert not computer.run(listed)["changed"]
    # What a manager has added to a route of ours stays.
    computer.run(route)
    version = "-6" if ":" in route["gateway"] else "-4"
    computer.ip(f"{version} route replace {computer.run(route)['routes'][0]['after']} onlink")
    assert not computer.run(route)["changed"]


FINE = {"destination": "10.5.0.0/16", "gateway": "192.168.11.101", "mtu": 1400, "advmss": 1360, "initcwnd": 20}
SIX_FINE = {"destination": "fd00:5::/64", "gateway": "fd00:11::101", "mtu": 1400}


def test_the_finer_points_of_a_way_are_made_changed_and_removed(computer):
    far = {"destination": "10.6.0.0/16", "device": "eth0", "scope": "global"}
    assert computer.run(FINE, SIX_FINE, far)["changed"]
    lines = [
        "10.5.0.0/16 via 192.168.11.101 dev eth0 proto static mtu 1400 advmss 1360 initcwnd 20",
        "10.6.0.0/16 dev eth0 proto static",
        "fd00:5::/64 via fd00:11::101 dev eth0 proto static metric 1024 mtu 1400 pref medium",
    ]
    assert computer.routes() == lines
    assert "replace -4 10.5.0.0/16 via 192.168.11.101 dev eth0 proto static mtu 1400 advmss 1360" in (
        (computer.root / HOOK).read_text()
    )
    again = computer.run(FINE, SIX_FINE, far)
    assert not again["changed"], again
    assert computer.run({**FINE, "mtu": 1300}, far)["changed"]
    assert computer.routes()[0].split()[8] == "1300" and len(computer.routes()) == 2
    plain = {name: FINE[name] for name in ("destination", "gateway")}
    assert computer.run(plain)["changed"]
    assert computer.routes() == ["10.5.0.0/16 via 192.168.11.101 dev eth0 proto static"]
    assert not computer.run(plain)["changed"]
    computer.run()
    assert computer.routes() == [] and HOOK not in computer.files()


def test_a_route_of_others_with_options_comes_back_with_them(computer):
    theirs = "default via 192.168.11.101 dev eth0 mtu lock 1400"
    computer.ip(f"route add {theirs}")
    assert computer.run(FOUR)["routes"][0]["state"] == "changed"  # at boot alone
    assert computer.routes() == [theirs]
    computer.run()
    assert computer.routes() == [theirs]
    other = {"destination": "default", "gateway": "192.168.11.102"}
    assert "the foreign route " in computer.run(other)["msg"]
    assert computer.run(other, on_conflict="replace")["changed"]
    computer.run()
    assert computer.routes() == [theirs]


def test_a_table_by_its_name_and_what_it_has_no_answer_for(computer):
    for path, text in (
        ("usr/share/iproute2/rt_tables", "255 local\n0x64 robots\n# 7 nobody\n"),
        ("etc/iproute2/rt_tables.d/site.conf", "101\tfleet  # ours\n"),
    ):
        (computer.root / path).parent.mkdir(parents=True, exist_ok=True)
        (computer.root / path).write_text(text)
    rest = {"destination": "10.0.0.0/8", "type": "throw", "table": "fleet"}
    done = computer.run({**FOUR, "table": "robots"}, rest)
    assert [item["table"] for item in done["routes"]] == [100, 101], done
    assert computer.ip("route show table 100").strip() == "default via 192.168.11.101 dev eth0 proto static"
    assert computer.ip("route show table 101").strip() == "throw 10.0.0.0/8 proto static"
    assert not computer.run({**FOUR, "table": 100}, {**rest, "table": "101"})["changed"]
    assert "no routing table nobody" in computer.run({**FOUR, "table": "nobody"})["msg"]
    computer.run()
    assert computer.ip("route show table 100") + computer.ip("route show table 101") == ""


def test_the_other_end_of_a_point_to_point_link_is_a_gateway(computer):
    computer.ip("address add 10.7.0.1 peer 10.7.0.2/32 dev eth1")
    for table in (254, 100):
        done = computer.run({"destination": "10.8.0.0/16", "gateway": "10.7.0.2", "table": table})
        assert [(item["device"], item["state"]) for item in done["routes"]] == [("eth1", "changed")], done
        assert "10.8.0.0/16 via 10.7.0.2 dev eth1" in computer.ip(f"route show table {table}")
    computer.run()


def test_check_mode_refuses_what_the_run_refuses(computer):
    broadcast = {"destination": "10.8.0.0/16", "gateway": "192.168.11.255"}
    for check in (True, False):
        assert "broadcast or multicast" in computer.run(broadcast, _ansible_check_mode=check)["msg"]
    # Another user in the same network namespace.
    computer.as_user = [shutil.which("setpriv") or "setpriv", "--reuid=65534", "--regid=65534", "--clear-groups"]
    if computer.python("-c", "import ansible").returncode:
        pytest.skip("another user cannot run this Python")
    for check in (True, False):
        message = computer.run(FOUR, _ansible_check_mode=check)["msg"]
        assert "run as root (become: true)" in message and computer.files().keys() == {"run/network/ifstate"}


def test_a_link_in_the_place_of_the_hook_is_named_as_one(computer):
    computer.run(FOUR)
    hook = computer.root / HOOK
    hook.rename(hook.with_name("other"))
    hook.symlink_to("other")
    assert mentions(computer.run(FOUR)["msg"], "regular", "writes")


@pytest.mark.parametrize("record", [{"routes": [{}]}, {"routes": None}, {"boot": []}, {"boot": {"places": {"x": {}}}}])
def test_a_record_of_another_shape_is_one_sentence(computer, record):
    (computer.root / "var").mkdir()
    (computer.root / "var/routes.json").write_text(json.dumps(record))
    failed = computer.run(FOUR)
    assert failed["failed"] and mentions(failed["msg"], "routes.json")
