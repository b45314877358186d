# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Sentences that modules, nodes and the planner make of foreign names: one line, with the name within quotes.

Each place makes its sentence with real code, once with a harmless name and once with one that a seed draws. What stands outside
of quotes is then the same.
"""

import random
import re
import types

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.firewall import access, packet_filter
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.firewall.backends import (
    contract,
    nftables,
    ufw,
)
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.hosts import run as hosts_run
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes import kernel
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes import options as route_options
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes import plan as routes_plan
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes import run as routes_run
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes.managers import networkmanager
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.sysctl import run as sysctl_run
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction import files, systemctl, units
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base import problem, trust
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.plain_text import VALUE, plain
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import network, ros
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.facts import machine
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.measure import topics
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.multicast import multicast
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain_text import is_plain, quote
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import preflight
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report import run
from rosfleet_multimaster.discovery.core import outsiders
from rosfleet_multimaster.discovery.core.report import outsiders as diagnose_outsiders
from rosfleet_multimaster.protocol.messages import Registration
from rosfleet_multimaster.roscore.core import name_guard
from rosfleet_multimaster.sync.core import report, sync

from tests.unit.test_hostile_texts import FRAGMENTS, MARK, masked

SEEDS = range(30)
#: words that are no name: whoever has one of them as a name would have a word of ours
WORDS = (
    "PASSED",
    "FAILED",
    "none",
    "nothing",
    "nobody",
    "ok",
    "ok=1",
    "failed=0",
    "changed=0",
    "unreachable=0",
    "all",
    "not",
)
MORE = (
    *WORDS,
    "ok: [robot1]",
    "PLAY RECAP *****",
    "PASSED: none of 5 checks failed.",
    "\n  1. ",
    "1. robot1 is down",
    "\nWarnings:\n",
)


def names(seed):
    """A name that nobody would give: several lines, blanks in runs, quotes, words of ours."""
    draw = random.Random(seed)
    for _number in range(12):
        parts = [draw.choice((*FRAGMENTS, *MORE)) for _part in range(draw.randint(1, 4))]
        yield "z " + "".join(f"{part}{draw.choice((MARK, f' {MARK} ', f'  {MARK}'))}" for part in parts)


def outside(text):
    """A text without what stands in quotes; a name of several lines may be several quotations."""
    return re.sub(r'"(?: ")+', '"', masked(text))


def raised(call, *arguments):
    """The sentence with which a call ends."""
    with pytest.raises(Exception) as caught:  # noqa: PT011  # of each kind
        call(*arguments)
    return str(caught.value)


# Places: (what is named there) -> its sentence. `there`: tmp_path and monkeypatch


def of_a_folder(name, there):
    """trust.py: a folder on the way that everybody can change."""
    folder = there.folder / re.sub(r"[/\0]", "|", name).encode()[:200].decode(errors="ignore")
    folder.mkdir(exist_ok=True)
    folder.chmod(0o777)
    return trust.TrustCheck().doubts(str(folder))[-1].words


def of_a_link(name, there):
    """files.py: a symbolic link in the way of a planned file."""
    path = there.folder / "planned"
    path.unlink(missing_ok=True)
    path.symlink_to(name.replace("\0", "|"))
    return files.look(str(path)).kind


def of_a_unit_file(name, _there):
    unit = units.Unit(**{**dict.fromkeys(units.Unit._fields, ""), "name": "a.service"})
    state = units.UnitState(LoadState="loaded", FragmentPath=name, ActiveState="active")
    return raised(units.check, [unit], {"a.service": state}, ())


def of_a_journal(name, there):
    """systemctl.py: the last lines that the unit's programs wrote."""
    shown = "Id=a.service\nActiveState=failed\nSubState=failed\nInvocationID=abc\n"
    texts = {"journalctl": f"one\n{name}\nlast", "systemctl": shown}

    def answers(argv, **_more):
        return systemctl.commands.Answer(0, texts[argv[0]].encode(), "")

    there.patch.setattr(systemctl.commands, "run", answers)
    return systemctl.Systemd(1).explain("a.service")


def of_systemctl(name, there):
    there.patch.setattr(systemctl.commands, "run", lambda *_argv, **_more: systemctl.commands.Answer(1, b"", name))
    return raised(systemctl.Systemd(1).call, "enable", "a.service")


def of_a_program(name, _there):
    """contract.py: what a command prints, here of a real one."""
    return raised(contract.run_or_fail, ["sh", "-c", 'printf "%s" "$1" >&2; exit 1', "sh", name.replace("\0", "|")])


def of_a_route(name, _there):
    """_routes: words of a route that somebody else has made."""
    route = kernel.RouteSpec("0.0.0.0/0", "192.168.11.101", "eth0", 0)
    foreign = kernel.KernelRoute(route._replace(gateway="192.168.11.1"), "boot", ("default", "dev", name), ())
    planned = routes_plan.plan_routes([route], {route.key: [foreign]}, {}, False, {"eth0"})
    return planned.results[0].problem


def of_a_route_that_stays(name, _there):
    item = {"state": "left", "before": f"default dev {name}", "after": None, "destination": "default"}
    return routes_run._write_sentence(item)


def of_an_interface(name, _there):
    own = network.Address("10.0.0.1", 24, "inet")
    return route_options._list_addresses({name: network.NetworkInterface(name, addresses=(own,))})


def of_the_roscore(name, there):
    """ros.py: two set-up files below /opt/ros."""
    found = {"version": "1", "kind": "prefix", "problem": ""}
    return ros.choose([{**found, "setup": "/opt/ros/noetic/setup.sh"}, {**found, "setup": name}])[1]


def of_the_own_name(name, _there):
    self = types.SimpleNamespace(own_name="kobuki1computer")
    item = {"state": "changed", "line": 2, "before": f"127.0.1.1 {name}", "after": f"127.0.1.1 {name}"}
    return hosts_run.HostsRun._replacement_sentence(self, item)


def of_a_file_of_settings(name, _there):
    conflict = {"file": f"/etc/sysctl.d/{name}", "line": 3, "value": name, "masks": False}
    item = {"name": "net.ipv4.ip_forward", "value": "1", "conflict": conflict}
    return sysctl_run._conflict_sentence(item, "/etc/sysctl.d/90-rosfleet.conf")


def of_a_part(name, there):
    """machine.py: whatever a strange machine makes of a look."""

    def strange():
        raise OSError(name)

    there.patch.setattr(machine, "PARTS", [machine.FactPart("interfaces", strange, 1)])
    return machine.look({"parts": ["interfaces"]})["problems"][0]


def refused_by_nodes(name, _there):
    """The nodes: a name that another robot has in use."""
    item = sync.RegistrationConflict("node", name, "kobuki2", f"http://{name}", name)
    return " | ".join(
        [report.describe_refusal(item), report.describe_refusal_end(item), *_entries(report.diagnoses([item]))]
    )


def _entries(entries):
    return [
        text
        for entry in entries
        for text in (entry.name, entry.message, *(part for pair in entry.values for part in pair))
    ]


def ignored_by_nodes(name, _there):
    told = diagnose_outsiders([outsiders.Outsider("10.0.0.6", name, f"http://{name}", "it is no robot of the fleet")])
    return " | ".join(_entries([told]))


def named_twice(name, _there):
    guard = name_guard.NameGuard()
    guard.set_imports([(name, "http://b:1/")])
    return guard.judge(name, f"http://{name}/", "http://b:1/", 0.0).refusal


PLACES = {
    **{
        call.__name__: call
        for call in (of_a_folder, of_a_link, of_a_unit_file, of_a_journal, of_systemctl, of_a_program)
    },
    **{
        call.__name__: call
        for call in (of_a_route, of_a_route_that_stays, of_an_interface, of_the_roscore, of_the_own_name)
    },
    **{
        call.__name__: call
        for call in (of_a_file_of_settings, of_a_part, refused_by_nodes, ignored_by_nodes, named_twice)
    },
    "a missing file": lambda name, _there: problem.unreadable(OSError(2, "No such file", name)),
    "a file that is not written": lambda name, _there: problem.sentence(OSError(13, "Permission denied", f"/x/{name}")),
    "nft": lambda name, _there: nftables._explain_failure(name),
    "ufw": lambda name, _there: raised(ufw._parse_rule, f"a {name} b c d e f g h"),
    "a program with a port": lambda name, _there: access.Access([], [access.Session(5986, "10.0.0.5", name)]).refusal(
        packet_filter.PacketFilter((), (), ())
    ),
    "a profile": lambda name, _there: raised(networkmanager.parse_lines, 4, f"{{ {name} }}", "7a9f2a3e"),
    "interfaces": lambda name, _there: route_options._list_names(["eth0", name]),
    "a member of the group": lambda name, _there: multicast.describe(
        {"memberships": [{"interface": name, "group": "226.0.0.0"}]}, "226.0.0.0"
    ),
    "a message": lambda name, _there: topics._topic("kobuki2", "/talk", {"text": name}, "expected")["error"],
    "a registration": lambda name, _there: str(Registration("publisher", name, name, "http://b:1/")),
    "logs of a bundle": lambda name, _there: run._lines({"problems": [name], "logs": {name: ["one", name]}}),
    "ROS of a robot": lambda name, _there: preflight._check_ros(
        types.SimpleNamespace(computer="kobuki1", is_master=False), {"ros": {"problem": name}}
    )[0],
    "last words of a robot": lambda name, _there: preflight.explain_failure(
        "kobuki1", {"msg": f"kobuki1: {' '.join(name.split())}"}, "2.19"
    ),
}


@pytest.fixture
def there(tmp_path, monkeypatch):
    return types.SimpleNamespace(folder=tmp_path, patch=monkeypatch)


@pytest.mark.slow
@pytest.mark.parametrize("place", PLACES)
def test_a_foreign_name_stands_in_quotes_on_one_line(place, there):
    lines = (
        str.splitlines if place == "logs of a bundle" else lambda text: [plain(text, VALUE)]
    )  # as a module ends with it
    harmless = [outside(line) for line in lines(PLACES[place]("z harmless words", there))]
    for seed in SEEDS:
        for name in names(seed):
            said = lines(PLACES[place](name, there))
            assert any(MARK in line for line in said), "the name is told"
            for line in said:
                assert is_plain(line) and MARK not in masked(line), (name, line)
            assert [outside(line) for line in said] == harmless, name


@pytest.mark.parametrize("word", WORDS)
def test_a_name_that_is_a_word_of_ours_stands_in_quotes(word):
    assert quote(word) == f'"{word}"' and route_options._list_names([word]) == f'"{word}"'
    assert str(Registration("publisher", word, word, "http://b:1/")) == f'publisher "{word}" of "{word}"'


@pytest.mark.parametrize(
    "name",
    [
        "/talker",
        "eth0",
        "wlan0.5",
        "a.service",
        "/opt/ros/noetic",
        "10.0.0.1/24",
        "http://robot1:11311/",
        "node_exporter",
    ],
)
def test_a_name_is_itself(name):
    assert quote(name) == name
