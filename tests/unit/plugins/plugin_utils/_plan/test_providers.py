# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Providers: the units and parameters of each distribution, upstream's decisions, and what it cannot do.

The files in golden/providers are written anew by UPDATE_GOLDEN=1 pytest tests/unit/plugins/plugin_utils/_plan/test_providers.py
"""

import copy
import hashlib
import json
import os
import pathlib
import re

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain import from_plain, to_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory import read
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import parameters as parameters_module
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import plan as plan_module
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import preflight, providers, units
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import ComputerPlan, LookAt
from hypothesis import given, settings
from hypothesis import strategies as st
from mentioned import mentions
from rosfleet_multimaster.protocol import filters

ROOT = pathlib.Path(__file__).resolve().parents[5]
GOLDEN = ROOT / "tests/unit/golden/providers"

# A fleet with upstream on the robot tibi, which has two computers and declares what it gives.
TIBI = {
    "multimaster_network": "192.168.11.0/24",
    "multimaster_gateway": "tibi-visio",
    "multimaster_common_address": "192.168.1.201",
    "multimaster_master": "tibi-visio",
    "multimaster_provider": "fkie_apt",
    "multimaster_exports": [{"topics": ["/tibi/pose", "/tibi/scan*"], "to": ["dabo"]}, {"services": ["/tibi/where"]}],
    "multimaster_filters": {"ignore_types": ["sensor_msgs/Image"], "ignore_services": ["/dabo/reset|/dabo/stop"]},
}
VARIABLES = {
    "tibi-visio": {**TIBI, "multimaster_address": "192.168.11.101"},
    "tibi-laser": {**TIBI, "multimaster_address": "192.168.11.102"},
    "dabo-pc": {"multimaster_address": "192.168.1.202", "multimaster_exports": [{"topics": ["/dabo/pose"]}]},
    "car-pc": {"multimaster_address": "192.168.1.203"},
}
ROBOTS = {"tibi": ["tibi-visio", "tibi-laser"], "dabo": ["dabo-pc"], "car": ["car-pc"]}


def plan(change=None, **shared):
    """The plan of the fleet, after a change of its variables."""
    variables = copy.deepcopy(VARIABLES)
    for values in variables.values():
        values.update({"multimaster_common_network": "192.168.1.0/24", **shared})
    if change:
        change(variables)
    return to_plain(plan_module.fleet_plan(read.read_fleet(read.Inventory(robots=ROBOTS, variables=variables))))[
        "computers"
    ]


def everywhere(robot, **values):
    return lambda variables: [variables[host].update(values) for host in ROBOTS[robot]]


def machine(distribution, computer="tibi-visio"):
    """The facts that multimaster_info finds on a computer with this distribution of ROS."""
    own = distribution == "debian"
    old = distribution not in ("noetic", "debian")
    addresses = {"tibi-visio": ("192.168.11.101", "192.168.1.201"), "dabo-pc": ("192.168.1.202",)}[computer]
    nodes = to_plain(LookAt(nodes=providers.nodes_to_look_for("fkie_existing")))["nodes"]
    return {
        "hostname": computer,
        "python": "3.11.2",
        "systemd": {"running": True, "net_admin": True},
        "multicast_routing": {"smcrouted": "", "others": []},
        "interfaces": [
            {
                "name": f"eth{number}",
                "up": True,
                "multicast": True,
                "loopback": False,
                "addresses": [{"address": address, "prefix": 24}],
            }
            for number, address in enumerate(addresses)
        ],
        "ros": {
            "problem": "",
            "chosen": {
                "environment": {},
                "kind": "debian" if own else "prefix",
                "setup": "" if own else f"/opt/ros/{distribution}/setup.bash",
                "distro": distribution,
                "missing": [],
                "python": "/usr/bin/python2.7" if old else "/usr/bin/python3",
                "python_version": "2.7.12" if old else "3.11.2",
                "commands": {"roscore": f"{'/usr' if own else '/opt/ros/' + distribution}/bin/roscore"},
                "nodes": [
                    {
                        **node,
                        "path": f"/home/robot/ws/src/{node['package']}/nodes/{node['executable']}",
                        "problem": "",
                        "lacks": [],
                    }
                    for node in nodes
                ],
            },
        },
        "packages": [
            {"name": name, "installed": "", "candidate": "1", "ours": False}
            for name in providers.packages_to_look_for("fkie_apt", True)
        ],
        "ports": [],
        "exports": [],
        "sshd": {"installed": False},
    }


def rendered(found):
    """The files that the roles nodes and services write for a checked plan."""
    made = units.render_services(
        found.services[1:],
        robot=found.robot,
        address=str(found.address),
        roscore_command="/opt/ros/x/bin/roscore",
        roscore_port=found.roscore_port,
        programs=found.programs,
        environment_digest="4567",
        files={},
    )
    digests = (hashlib.sha256(text).hexdigest() for text in (b"4567", b""))
    for digest in digests:
        made = [{**unit, "content": unit["content"].replace(digest, "0123")} for unit in made]
    files = {unit["name"]: unit["content"] for unit in made}
    for name in ("discovery", "sync"):
        files[f"master_{name}.json"] = json.dumps(getattr(found, name), indent=4, sort_keys=True) + "\n"
    files["packages"] = "\n".join(found.packages)
    return "".join(f"===== {name}\n{text.rstrip()}\n" for name, text in files.items())


CASES = {
    **{distribution: (distribution, "fkie_apt") for distribution in providers.DISTRIBUTIONS},
    "debian": ("debian", "fkie_existing"),
    "bundled": ("debian", "bundled"),
}


@pytest.mark.parametrize("case", CASES)
def test_what_is_written_for_each_distribution(case):
    distribution, provider = CASES[case]
    computers = plan(everywhere("tibi", multimaster_provider=provider))
    found = preflight.compare(from_plain(ComputerPlan, computers["tibi-visio"]), machine(distribution))
    assert found.problems == ()
    path = GOLDEN / f"{case}.txt"
    if os.environ.get("UPDATE_GOLDEN"):
        path.write_text(rendered(found.plan))
    assert rendered(found.plan) == path.read_text()


# An installation of your own


def with_fkie_mas(problem="", lacks=()):
    """A robot of the provider `fkie_existing`, whose ROS has fkie_mas alone."""
    found = machine("debian")
    for node in found["ros"]["chosen"]["nodes"]:
        if node["package"].startswith("fkie_mas_"):
            node.update(problem=problem, lacks=list(lacks))
        else:
            node["path"] = ""
    computers = plan(everywhere("tibi", multimaster_provider="fkie_existing"))
    return preflight.compare(from_plain(ComputerPlan, computers["tibi-visio"]), found)


def test_fkie_mas_is_an_installation_too():
    found = with_fkie_mas()
    assert found.problems == ()
    lines = found.plan.programs["discovery"].service
    assert "Environment=ROS_VERSION=1 ROS_DISTRO=noetic\n" in lines
    assert "nodes/mas-discovery __name:=master_discovery" in lines
    assert "nodes/mas-sync __name:=master_sync" in found.plan.programs["sync"].service
    assert found.plan.discovery["hide_topics"]
    assert not [warning for warning in found.warnings if "screen" in warning or 'cannot "hide' in warning]


def test_what_fkie_mas_needs_is_said_before():
    found = with_fkie_mas(
        "websockets.sync.server cannot be imported: ModuleNotFoundError: No module named 'websockets'"
    )
    (problem,) = found.problems
    assert problem.startswith("tibi-visio: ") and "; expected" in problem and "\n" not in problem
    assert "fkie_mas_discovery/mas-discovery does not run" in problem
    assert mentions(problem, "fkie_mas", "Python", "12")
    (warning,) = [text for text in with_fkie_mas(lacks=["screen"]).warnings if "screen" in text]
    assert warning.startswith("tibi-visio: ") and "install the Debian package screen" in warning


def test_multimaster_fkie_comes_before_its_successor():
    computers = plan(everywhere("tibi", multimaster_provider="fkie_existing"))
    found = preflight.compare(from_plain(ComputerPlan, computers["tibi-visio"]), machine("debian"))
    assert "fkie_master_discovery/nodes/master_discovery" in found.plan.programs["discovery"].service
    assert "ROS_VERSION" not in found.plan.programs["discovery"].service


def test_no_start_button_of_a_stranger_reaches_upstream():
    """Upstream knows its own names alone, so the parameters have those of its successor."""
    sync = plan()["tibi-visio"]["sync"]
    assert "/mas_daemon/*" in sync["ignore_services"] and "/mas_daemon" in sync["ignore_nodes"]
    assert "fkie_mas_msgs/*" in sync["ignore_type"]
    assert "/mas_daemon/*" not in plan()["car-pc"]["sync"].get("ignore_services", [])


@pytest.mark.parametrize("distribution", providers.DISTRIBUTIONS)
def test_packages_are_without_the_gui(distribution):
    names = providers.debian_packages(distribution, is_master=True)
    assert all(name.startswith(f"ros-{distribution}-") for name in names)
    assert not [name for name in names if name.endswith(("multimaster-fkie", "fkie-multimaster"))]
    assert not [name for name in names if "node-manager" in name]


def test_bundled_nodes_need_nothing_of_upstream():
    assert providers.packages_to_look_for("bundled", True) == providers.nodes_to_look_for("bundled") == ()
    computers = plan(everywhere("tibi", multimaster_provider="bundled"))
    assert [computer["limits"] for computer in computers.values()] == [[]] * 4


# Upstream's decisions, as the description of its behaviour has them


class Upstream:
    """The names that upstream's master_sync takes with these parameters."""

    def __init__(self, parameters):
        self.parameters = parameters

    def of(self, name, host):
        items = []
        for item in self.parameters.get(name, []):
            items += [item] if isinstance(item, str) else item.get(host, [])  # the key exactly, in lower case
        return "|".join(rf"\A{item.strip().replace('*', '.*')}\Z" for item in items)

    def matches(self, name, host, text):
        pattern = self.of(name, host)
        return bool(pattern) and re.match(pattern, text, re.IGNORECASE) is not None

    def host(self, host):
        if not self.of("ignore_hosts", host):
            return not self.of("sync_hosts", host) or self.matches("sync_hosts", host, host)
        return not self.matches("ignore_hosts", host, host) or self.matches("sync_hosts", host, host)

    def topic(self, host, node, topic, kind, publisher):
        side = "ignore_publishers" if publisher else "ignore_subscribers"
        ignored = ((side, topic), ("ignore_type", kind), ("ignore_nodes", node), ("ignore_topics", topic))
        return not any(self.matches(name, host, text) for name, text in ignored) and self.listed(
            host, sync_nodes=node, sync_topics=topic
        )

    def service(self, host, node, service):
        ignored = (("ignore_nodes", node), ("ignore_services", service))
        return not any(self.matches(name, host, text) for name, text in ignored) and self.listed(
            host, sync_nodes=node, sync_services=service
        )

    def listed(self, host, **texts):
        if any(self.matches(name, host, text) for name, text in texts.items()):
            return True
        return not any(self.of(name, host) for name in texts)


NAMES = ("/a", "/b", "/a/x", "/Tf", "/tf_static", "/ab")
PATTERNS = st.lists(st.sampled_from(["/a", "/A*", "/b|/a/x", "/tf", "*", " /ab ", "/x|/b"]), max_size=2)
HOSTS = ("alpha", "beta_11411", "gamma-pc")
HOST_PATTERNS = st.lists(st.sampled_from(["alpha", "BETA*", "*", "alpha|gamma-pc"]), max_size=2)
LISTS = st.fixed_dictionaries({}, optional=dict.fromkeys(parameters_module.UPSTREAM_FILTERS, PATTERNS))
SECTIONS = st.dictionaries(st.sampled_from(["alpha", "Beta_11411"]), LISTS, max_size=2)
BUNDLED = st.builds(
    lambda lists, hosts, sections: {**lists, **hosts, **sections},
    LISTS,
    st.fixed_dictionaries({}, optional={"ignore_hosts": HOST_PATTERNS, "sync_hosts": HOST_PATTERNS}),
    SECTIONS,
)


@pytest.mark.slow
@settings(max_examples=80, deadline=None)
@given(BUNDLED)
def test_upstream_decides_as_the_bundled_node(parameters):
    bundled, upstream = filters.Filters(parameters), Upstream(parameters_module._upstream_sync(parameters))
    for host in HOSTS:
        assert upstream.host(host) == bundled.wants_host(host)
        rules = bundled.rules(host)
        for node in NAMES:
            for name in NAMES:
                for publisher in (True, False):
                    assert upstream.topic(host, node, name, "/b", publisher) == rules.topic(node, name, "/b", publisher)
                assert upstream.service(host, node, name) == rules.service(node, name)


def hides(parameters, kind, name):
    return any(re.match(rf"\A{item.replace('*', '.*')}\Z", name, re.IGNORECASE) for item in parameters[f"hide_{kind}"])


@given(st.lists(st.sampled_from(["/a", "/a*", "/tf", "/b/*/c"]), max_size=3), st.sampled_from([*NAMES, "/b/x/c"]))
def test_what_goes_to_nobody_is_hidden(patterns, name):
    exports = [{"to": ["192.168.1.202"], "topics": patterns, "services": []}]
    given_away = any(re.fullmatch(item.replace("*", ".*"), name, re.IGNORECASE) for item in patterns)
    hidden = parameters_module._hide_names(exports)
    assert hides(hidden, "topics", name) is not given_away
    assert hides(hidden, "services", name)


def test_without_a_declaration_nothing_is_hidden():
    parameters = plan(lambda variables: [values.pop("multimaster_exports", 0) for values in variables.values()])
    assert not [name for name in parameters["tibi-visio"]["discovery"] if name.startswith("hide")]


@pytest.mark.parametrize(
    ("hz", "after", "factor", "removed"),
    [(1, 5, 2.0, 10), (1, 30, 6.0, 30), (2, 5, 1.0, 5), (4, 3, 0.6, 3), (0.5, 5, 2.0, 20), (0.2, 10, 2.6, 65)],
)
def test_silence_in_upstreams_words(hz, after, factor, removed):
    """Silent for longer than 5 s (below 1 Hz divided by the rate) times the factor is offline."""
    computers = plan(multimaster_heartbeat_hz=hz, multimaster_offline_after=after)
    parameters = computers["tibi-visio"]["discovery"]
    assert (parameters["timeout_factor"], parameters["remove_after"]) == (factor, removed)


def test_the_interface_is_pinned():
    discovery = plan()["tibi-visio"]["discovery"]
    assert discovery["mcast_group"] == "226.0.0.0@192.168.1.201"
    assert discovery["robot_hosts"] == ["192.168.1.202", "192.168.1.203"]


def test_nodes_of_further_computers_are_asked_for_by_all():
    assert [plan()[host]["sync"].get("sync_remote_nodes") for host in ("tibi-visio", "dabo-pc", "car-pc")] == [
        None,
        True,
        True,
    ]
    assert "sync_remote_nodes" not in plan(everywhere("tibi", multimaster_provider="bundled"))["car-pc"]["sync"]


def test_subscribers_that_upstream_shows_are_left_out():
    def undeclared(variables):
        for values in variables.values():
            values.pop("multimaster_exports", None)

    assert plan(undeclared)["car-pc"]["sync"]["tibi-visio"] == {"ignore_subscribers": ["*"]}
    assert plan(undeclared)["tibi-visio"]["sync"]["ignore_subscribers"] == ["*"]
    assert plan()["car-pc"]["sync"]["ignore_subscribers"] == ["*"]


LIMITS = {
    "strangers": (None, "multimaster_strangers is 'ignore', .* which exchanges with whoever is heard"),
    "collisions": (
        None,
        "whose nodes register whatever they find; expected names of nodes and services that are unique",
    ),
    "offline": (None, "multimaster_offline_after is 5 s, .* cannot ask a silent robot; expected to wait 10 s here"),
    "exports": (
        None,
        "which serves /tibi/pose, /tibi/scan\\* to every robot alike, and hides topics for nobody only",
    ),
    "computers": (
        None,
        "which reports the nodes on tibi-laser as remote ones; expected the parameter sync_remote_nodes",
    ),
    "roscore": (
        everywhere("tibi", multimaster_roscore="existing"),
        "multimaster_roscore is 'existing', .* do not notice that a roscore was started again",
    ),
}


@pytest.mark.parametrize("case", LIMITS)
def test_what_upstream_cannot_do_is_said_in_one_sentence(case):
    change, expected = LIMITS[case]
    said = [limit for limit in plan(change)["tibi-visio"]["limits"] if re.search(expected, limit)]
    assert len(said) == 1, plan(change)["tibi-visio"]["limits"]
    assert said[0].startswith("tibi-visio: ") and "; expected" in said[0] and "\n" not in said[0]


def test_limits_are_said_where_they_are():
    computers = plan()
    assert [computers[host]["limits"] for host in ("tibi-laser", "dabo-pc", "car-pc")] == [[], [], []]
    assert len(computers["tibi-visio"]["limits"]) == 5
    quick = plan(everywhere("tibi", multimaster_exports=None), multimaster_heartbeat_hz=2)["tibi-visio"]["limits"]
    assert len(quick) == 3
