# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Observations of a fleet, good and broken, and what is found: the plan is the planner's own."""

import copy
import time
from collections import Counter

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet import read as fleet_module
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import plan as plan_module
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify import checks
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify import exchange as exchange_module
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify import ways as ways_module
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks import (
    FAILED,
    OK,
    UNKNOWN,
    WARNING,
    Observation,
)

ONE, TWO = "kobuki1computer", "kobuki2computer"


def plan(robots=2, computers=1, exports=None, **variables):
    """The plan of a fleet of robots kobuki1, kobuki2, ... with addresses from 192.168.1.1 on; `exports` by robot."""
    hosts = {
        f"kobuki{n}": [f"kobuki{n}computer" + (f"-{c}" if c else "") for c in range(computers)]
        for n in range(1, robots + 1)
    }
    names = [host for of_robot in hosts.values() for host in of_robot]
    shared = {"multimaster_common_network": "192.168.0.0/16", "multimaster_multicast_group": "226.0.0.0", **variables}
    values = {
        host: {
            **shared,
            "multimaster_address": f"192.168.{1 + n // 200}.{1 + n % 200}",
            "multimaster_master": f"{host.partition('computer')[0]}computer",
            **({} if exports is None else {"multimaster_exports": exports.get(host.partition("computer")[0], [])}),
        }
        for n, host in enumerate(names)
    }
    return plan_module.plan(fleet_module.read_fleet(fleet_module.Inventory(robots=hosts, variables=values)))


def good(fleet, name):
    """What a computer sees of a fleet in which everything works."""
    own = fleet["computers"][name]
    me = next((member for member in fleet["members"] if member["name"] == name), None)
    others = [member for member in fleet["members"] if member["name"] != name]
    layout, flows = ways_module.Layout(fleet), exchange_module.Flows(fleet)
    ways = {other["name"]: layout.way(own, other["name"]) for other in others}
    alive = {"ok": True, "rtt_ms": 0.4, "error": ""}
    probe = {
        "members": [{"name": name, "address": own["address"], "addresses": [own["address"]], "resolve_error": ""}]
        + [
            {
                "name": other["name"],
                "address": other["address"],
                "addresses": [other["address"]],
                "resolve_error": "",
                "route": {
                    "device": "eth0",
                    "source": ways[other["name"]].source,
                    "gateway": ways[other["name"]].hop or None,
                    "error": "",
                },
                "ping_address": dict(alive),
                "ping_name": dict(alive),
            }
            for other in others
        ],
        "default_routes": [{"device": "eth0", "gateway": "192.168.1.254", "source": None, "metric": None}],
        "forwarding": {
            "ip_forward": int(own["is_gateway"] or own["is_router"]),
            "interfaces": [
                {
                    "interface": f"eth{number}",
                    "addresses": [entry["address"]],
                    "forwarding": 1,
                    "rp_filter": 2,
                    "send_redirects": int(not own["is_router"]),
                }
                for number, entry in enumerate(own["networks"])
            ],
        },
        "ros_missing": "",
        "masters": [
            {
                "computer": master["computer"],
                "address": master["address"],
                "port": master["rpc_port"],
                "open": True,
                "connect_ms": 0.3,
                "error": "",
                "clock_offset_s": 0.001,
                "clock_uncertainty_s": 0.001,
                "clock_error": "",
            }
            for master in fleet["masters"]
        ],
        "roscore": {
            "uri": own["environment"].get("ROS_MASTER_URI", ""),
            "answer": own["environment"].get("ROS_MASTER_URI", "") + "/",
            "error": "",
        },
        "list_masters": {
            "masters": [
                {"name": master["name"], "uri": master["uri"], "online": True, "monitoruri": master["monitor_uri"]}
                for master in fleet["masters"]
            ],
            "seconds": 0.7,
            "error": "",
        },
        "topics": [
            {
                "computer": other["name"],
                "topic": "/multimaster_verify/" + other["name"],
                "publishers": [{"node": "/talker", "uri": f"http://{other['name']}:41233/"}],
                "heard": True,
                "text": "run " + other["name"],
                "seconds": 0.1,
                "error": "",
            }
            for other in others
            if not (me and other["robot"] != me["robot"] and flows.declared_away(other["robot"], me["robot"]))
        ],
        "services": [
            {
                "name": service,
                "unit": f"multimaster-{service}.service",
                "load_state": "loaded",
                "active_state": "active",
                "sub_state": "running",
                "restarts": 0,
                "differing": [],
            }
            for service in own["services"]
        ],
        "exchange": exchange(fleet, own["robot"]) if own["is_master"] else dict(NO_EXCHANGE),
        "talker": {"running": True, "error": ""},
        "problems": [],
    }
    multicast = {
        "udp": [
            {
                "name": other["name"],
                "address": other["discovery_address"],
                "multicast": other["multicast"] and me["multicast"],
                "heard_from": other["multicast"] and me["multicast"],
                "heard": 30,
                "source_address": other["discovery_address"],
                "own_source_address": me["discovery_address"],
                "other_interfaces": [],
                "loss": 0.0,
                "unicast": True,
            }
            for other in others
            if me and me["discovery"] and other["discovery"]
        ],
        "callers": [
            {"address": layout.way(plan, name).source, "datagrams": 3}
            for caller, plan in fleet["computers"].items()
            if me and caller != name
        ],
        "icmp": {
            "group": "224.0.0.1",
            "error": None,
            "rounds": [{"round": 1, "answered": [other["name"] for other in others]}],
        },
        "send_errors": {"count": 0, "last": None},
        "unexpected": [],
    }
    if own["is_router"]:
        parts = ("members", "default_routes", "forwarding", "problems")
        empty = {
            "masters": [],
            "topics": [],
            "services": [],
            "list_masters": {"masters": [], "error": "", "seconds": 0},
        }
        silent = {
            "roscore": {"uri": "", "answer": "", "error": "not looked at"},
            "ros_missing": "not looked at",
            "exchange": dict(NO_EXCHANGE),
        }
        probe = {**{part: probe[part] for part in parts}, **empty, **silent}
    return Observation(multicast=multicast if me and me["discovery"] else None, probe=probe)


SUMS = {"std_msgs/String": "992ce8a1687cec8c8bd883ec73ca41d1", "nav_msgs/Odometry": "cd5e73d190d741a2f92e81eda573aca7"}
NO_EXCHANGE = {
    "error": "not looked at",
    "types_error": "",
    "topics": [],
    "services": [],
    "imports": [],
    "silent": [],
    "connections": [],
}


def topic(name, kind, publishers=(), subscribers=(), **more):
    return {"name": name, "type": kind, "publishers": [*publishers], "subscribers": [*subscribers], **more}


def registered(robot):
    """What the nodes of a robot have registered: a base with a service, a talker on a topic that all have, and rosout."""
    nodes = [f"/{robot}/base", f"/{robot}/talker"]
    return {
        "topics": [
            topic(f"/{robot}/odom", "nav_msgs/Odometry", [nodes[0]]),
            topic("/chatter", "std_msgs/String", [nodes[1]], [nodes[0]]),
            topic("/rosout", "rosgraph_msgs/Log", nodes, ["/rosout"]),
            topic(f"/multimaster_verify/{robot}", "std_msgs/String", [f"/multimaster_verify_talker_{robot}"]),
        ],
        "services": [
            {"name": f"/{robot}/reset", "node": nodes[0]},
            {"name": f"{nodes[0]}/get_loggers", "node": nodes[0]},
        ],
    }


def exchange(fleet, robot):
    """What the roscore of a robot holds where everything works: what the plan lets pass, and one connection with each."""
    flows = exchange_module.Flows(fleet)
    own = registered(robot)
    imports, connections = [], []
    for master in fleet["masters"]:
        other = master["robot"]
        if other == robot:
            continue
        its, rules = registered(other), flows.rules(other, robot)
        topics = []
        for entry in its["topics"]:
            ends = {
                kind: [
                    node
                    for node in entry[kind + "s"]
                    if rules.passes(exchange_module.Item(kind, entry["name"], node), entry["type"])
                ]
                for kind in ("publisher", "subscriber")
            }
            if any(ends.values()):
                topics.append(topic(entry["name"], entry["type"], ends["publisher"], ends["subscriber"]))
            if entry["name"] == "/chatter" and ends["publisher"]:
                connections.append(
                    {
                        "node": f"/{robot}/base",
                        "topic": "/chatter",
                        "direction": "in",
                        "peer": f"/{other}/talker",
                        "host": master["computer"],
                        "robot": other,
                    }
                )
        services = [
            entry
            for entry in its["services"]
            if rules.passes(exchange_module.Item("service", entry["name"], entry["node"]), "")
        ]
        if topics or services:
            imports.append({"master": master["uri"], "topics": topics, "services": services})
    for entry in own["topics"]:
        entry["md5sum"] = SUMS.get(entry["type"], "")
    return {**NO_EXCHANGE, **own, "error": "", "imports": imports, "connections": connections}


def evaluate(change=None, fleet=None):
    """The findings of two good robots after a change of the observations {name: (probe, multicast)}."""
    fleet = fleet or plan()
    seen = {name: good(fleet, name) for name in fleet["computers"]}
    if change:
        change({name: (observation.probe, observation.multicast) for name, observation in seen.items()})
    return list(checks.evaluate(fleet, seen))


def notable(findings):
    return {(finding.check, finding.observer, finding.target): finding for finding in findings if finding.verdict != OK}


def of(entries, name, key="name"):
    return next(entry for entry in entries if entry[key] == name)


def test_everything_is_checked_and_good():
    findings = evaluate()
    between_networks = {"forwarding", "reverse_path", "redirects", "source"}
    assert {finding.check for finding in findings} == {check.id for check in checks.CHECKS} - between_networks
    assert not notable(findings)
    pairs = {(finding.observer, finding.target) for finding in findings}
    assert pairs == {(ONE, ONE), (ONE, TWO), (TWO, ONE), (TWO, TWO)}


def test_every_check_is_explained_by_an_earlier_one():
    earlier = set()
    for check in checks.CHECKS:
        for reference in check.explained_by:
            side, _colon, other = reference.rpartition(":")
            assert side in checks.SIDES
            # Gateways are looked at first, so they may explain others in the same check.
            assert other in earlier or (other == check.id and "gateway" in side), (check.id, reference)
        earlier.add(check.id)


# One row per cause: the change, the check that names it, and a part of cause or remedy.
def _name(addresses, error=""):
    def change(seen):
        member = of(seen[ONE][0]["members"], TWO)
        member.update(addresses=addresses, resolve_error=error)

    return change


def _udp(verdict_of_unicast, **values):
    def change(seen):
        of(seen[ONE][1]["udp"], TWO).update(unicast=verdict_of_unicast, **values)

    return change


def _master(**values):
    def change(seen):
        of(seen[ONE][0]["masters"], TWO, "computer").update(values)

    return change


def _listed(**values):
    def change(seen):
        of(seen[ONE][0]["list_masters"]["masters"], TWO).update(values)

    return change


def _unlisted(seen):
    seen[ONE][0]["list_masters"]["masters"].pop()


def _topic(**values):
    def change(seen):
        of(seen[ONE][0]["topics"], TWO, "computer").update(values)

    return change


def _service(**values):
    def change(seen):
        seen[ONE][0]["services"][1].update(values)

    return change


def _roscore(**values):
    def change(seen):
        seen[ONE][0]["roscore"].update(values)

    return change


def _member(key, **values):
    def change(seen):
        of(seen[ONE][0]["members"], TWO)[key].update(values)

    return change


def _no_list(seen):
    seen[ONE][0]["list_masters"] = {"masters": [], "seconds": 0, "error": "ERROR: Service is not available."}


def _talker_ended(seen):
    seen[TWO][0]["talker"] = {"running": False, "error": "killed"}
    _topic(heard=False, publishers=[], error="the topic is not registered")(seen)


def _refusing_kernel(seen):
    seen[TWO][1]["send_errors"] = {"count": 9, "last": "226.0.0.0:11511: Operation not permitted"}
    _udp(True, heard_from=False, source_address=None)(seen)


def _lossy(seen):
    of(seen[TWO][1]["udp"], ONE)["loss"] = 0.3  # TWO counts what ONE has heard of it


def _icmp(seen):
    seen[ONE][1]["icmp"]["rounds"][0]["answered"] = []


def _exchange_of(computer, **values):
    def change(seen):
        seen[computer][0]["exchange"].update(values)

    return change


def _renamed(seen):
    """The base of the second robot has the name of the first one's, so its registrations are refused on both."""
    for robot, computer in (("kobuki1", ONE), ("kobuki2", TWO)):
        part = seen[computer][0]["exchange"]
        other = next(iter(part["imports"]))
        other["topics"] = [entry for entry in other["topics"] if "base" not in str(entry["publishers"])]
        for entry in other["topics"]:
            entry["subscribers"] = []
        other["services"] = []
        for entry in part["topics"]:
            for kind in ("publishers", "subscribers"):
                entry[kind] = [node.replace(f"/{robot}/base", "/base") for node in entry[kind]]
        for entry in part["services"]:
            entry["node"] = entry["node"].replace(f"/{robot}/base", "/base")


def _same_service(seen):
    """Both have the service /reset, and neither is registered at the other."""
    for computer in (ONE, TWO):
        part = seen[computer][0]["exchange"]
        part["services"][0]["name"] = "/reset"
        part["imports"][0]["services"] = []


def _other_type(kind="std_msgs/Header", md5sum="4d9af5aeee4e9d8e2d1d0c0e6c6a7ee3"):
    def change(seen):
        for computer in (ONE, TWO):
            part = seen[computer][0]["exchange"]
            part["imports"][0]["topics"] = [
                entry for entry in part["imports"][0]["topics"] if entry["name"] != "/chatter"
            ]
            part["connections"] = []
        of(seen[TWO][0]["exchange"]["topics"], "/chatter").update(type=kind, md5sum=md5sum)

    return change


def _not_registered(seen):
    imported = seen[ONE][0]["exchange"]["imports"][0]["topics"]
    imported.remove(of(imported, "/kobuki2/odom"))


def _against_the_plan(seen):
    seen[ONE][0]["exchange"]["imports"][0]["topics"].append(topic("/rosout", "rosgraph_msgs/Log", ["/kobuki2/base"]))


def _stranger_of_a_node(seen):
    """A connection on a topic that is exchanged with nobody."""
    seen[ONE][0]["exchange"]["connections"].append(
        {
            "node": "/rosout",
            "topic": "/rosout",
            "direction": "in",
            "peer": "http://kobuki2computer:1234/",
            "host": TWO,
            "robot": "kobuki2",
        }
    )


CAUSES = [
    (_name([], "Name or service not known"), "name", FAILED, "not known"),
    (_name(["127.0.1.1"]), "name", FAILED, "loopback"),
    (_name(["192.168.1.2", "192.168.7.7"]), "name", FAILED, "second address"),
    (_name(["192.168.7.7"]), "name", FAILED, "older address"),
    (_service(load_state="not-found", active_state="inactive", sub_state="dead"), "services", FAILED, "not set up"),
    (_service(active_state="failed", sub_state="failed"), "services", FAILED, "journalctl"),
    (_service(restarts=4), "services", WARNING, "ends by itself"),
    (_service(differing=None), "environment", UNKNOWN, "containers"),
    (_service(differing=["ROS_HOSTNAME"]), "environment", FAILED, "after the service started"),
    (_roscore(answer="http://localhost:11311/"), "master_uri", FAILED, "only its own computer understands"),
    (_roscore(answer="http://old:11311/"), "master_uri", FAILED, "another host name"),
    (_roscore(answer="", error="Connection refused"), "master_uri", FAILED, "no roscore answers"),
    (_member("route", source="10.0.0.7"), "route", FAILED, "another interface"),
    (_member("ping_address", ok=False, error="no answer to 3 requests"), "ping_address", FAILED, "firewall drops ICMP"),
    (_member("ping_name", ok=False, error="no answer to 3 requests"), "ping_name", FAILED, "leads elsewhere"),
    (_udp(True, heard_from=False), "udp_multicast", WARNING, "IGMP snooping"),
    (_udp(True, heard_from=False, other_interfaces=["eth1"]), "udp_multicast", WARNING, "another interface"),
    (_udp(True, source_address="10.0.2.2"), "udp_multicast", FAILED, "NAT"),
    (_refusing_kernel, "udp_multicast", WARNING, "refuses to send"),
    (_lossy, "udp_multicast", WARNING, "wireless"),
    (_udp(False), "udp_unicast", WARNING, "firewall"),
    (_icmp, "icmp_rounds", WARNING, "does not depend on it"),
    (
        _master(open=False, error="Connection refused", clock_offset_s=None),
        "rpc_port",
        FAILED,
        "no discovery node listens",
    ),
    (_master(open=False, error="no answer within 2 s", clock_offset_s=None), "rpc_port", FAILED, "firewall drops TCP"),
    (
        _master(clock_offset_s=None, clock_error="getCurrentTime failed"),
        "clock",
        FAILED,
        "no discovery node that answers",
    ),
    (_master(clock_offset_s=0.3), "clock", WARNING, "chrony"),
    (_master(clock_offset_s=-3600.0), "clock", FAILED, "chrony"),
    (_no_list, "list_masters", FAILED, "cannot be called"),
    (_listed(online=False), "list_masters", FAILED, "no longer hears"),
    (_listed(monitoruri="http://10.0.2.2:11611"), "list_masters", FAILED, "NAT"),
    (_listed(uri="http://localhost:11311/"), "list_masters", FAILED, "calls itself otherwise"),
    (_unlisted, "list_masters", FAILED, "heartbeats"),
    (_talker_ended, "topic_heard", FAILED, "verify_lifetime"),
    (_topic(heard=False, publishers=[]), "topic_heard", FAILED, "sync node"),
    (_topic(heard=False), "topic_heard", FAILED, "TCP ports of nodes"),
    (_topic(publishers=[{"node": "/n", "uri": "http://localhost:1/"}]), "direct_connection", FAILED, "localhost"),
    (_topic(publishers=[{"node": "/n", "uri": "http://kobuki1computer:1/"}]), "direct_connection", FAILED, "elsewhere"),
    (_exchange_of(ONE, silent=["/dead"]), "nodes_answer", WARNING, "rosnode cleanup"),
    (_renamed, "names", FAILED, "one name, two nodes"),
    (_same_service, "names", FAILED, "one name, two nodes"),
    (_other_type(), "types", FAILED, "same version of the message package"),
    (_other_type("std_msgs/String", "0123"), "types", FAILED, "same version of the message package"),
    (_exchange_of(ONE, types_error="ImportError: no module named rospy"), "types", UNKNOWN, "rosmsg md5"),
    (
        _exchange_of(ONE, error="/master_sync/get_sync_info does not answer"),
        "flow",
        UNKNOWN,
        "does not tell what it has",
    ),
    (_not_registered, "flow", FAILED, "has not registered it"),
    (_exchange_of(ONE, imports=[]), "flow", FAILED, "has registered nothing of"),
    (_against_the_plan, "flow", FAILED, "runs with other parameters"),
    (_stranger_of_a_node, "cross_link", FAILED, "start these nodes again"),
]


@pytest.mark.parametrize(("change", "check", "verdict", "part"), CAUSES)
def test_each_cause_is_told(change, check, verdict, part):
    found = [finding for finding in notable(evaluate(change)).values() if not finding.because]
    assert {(finding.check, finding.verdict) for finding in found} == {(check, verdict)}
    for finding in found:
        assert part in finding.cause + finding.remedy
        assert finding.expected and finding.found and finding.remedy
        assert "{" not in finding.cause + finding.remedy + finding.expected + finding.found


def test_every_cause_has_a_row():
    told = {(check, part) for _change, check, _verdict, part in CAUSES}
    for check in checks.CHECKS:
        texts = [cause.cause + cause.remedy for cause in check.causes]
        for text in texts:
            rows = [part for other, part in told if other == check.id and part in text]
            assert rows or (check.id, text) in UNTOLD, (check.id, text)


# Section 4 of the report: Fig. 10 and 12, with a router that is a computer.
ROBOTS = {
    "tibi": (11, 201, "tibi-visio", {"tibi-nav": 100, "tibi-visio": 101, "tibi-monitor": 202}),
    "dabo": (10, 202, "dabo-nav", {"dabo-nav": 100, "dabo-visio": 101, "dabo-monitor": 202}),
    "car": (12, 203, "car-visio", {"car-nav": 100, "car-visio": 101, "car-ext": 102}),
}


def fig12(**variables):
    """The plan of the three robots; one robot may have only some of its computers in the tests' interest."""
    values = {
        host: {
            "multimaster_common_network": "192.168.1.0/24",
            "multimaster_multicast_group": "239.255.0.1",
            "multimaster_network": f"192.168.{network}.0/24",
            "multimaster_gateway": f"{robot}-visio",
            "multimaster_common_address": f"192.168.1.{common}",
            "multimaster_master": master,
            "multimaster_address": f"192.168.{network}.{address}",
            **variables,
        }
        for robot, (network, common, master, hosts) in ROBOTS.items()
        for host, address in hosts.items()
    }
    return plan_module.plan(
        fleet_module.read_fleet(
            fleet_module.Inventory(
                robots={robot: list(hosts) for robot, (*_numbers, hosts) in ROBOTS.items()},
                variables={**values, "router": {"multimaster_address": "192.168.1.1"}},
                routers=["router"],
            )
        )
    )


SILENT = {"ok": False, "rtt_ms": None, "error": "no answer to 3 requests"}


def silent(seen, observers, targets, **values):
    """No observer hears any of the targets, by ping and by what depends on it."""
    for observer in observers:
        probe = seen[observer][0]
        for target in targets:
            if target != observer:
                of(probe["members"], target).update(ping_address={**SILENT, **values}, ping_name={**SILENT, **values})
                for topic in probe["topics"]:
                    if topic["computer"] == target:
                        topic.update(heard=False, publishers=[], error="not registered")


def outside(robot):
    return [host for name, (*_numbers, hosts) in ROBOTS.items() if name != robot for host in hosts]


INNER_TIBI, INNER_CAR = ["tibi-nav", "tibi-monitor"], ["car-nav", "car-ext"]


def _closed_gateway(seen):
    """tibi-visio does not forward."""
    seen["tibi-visio"][0]["forwarding"]["ip_forward"] = 0
    _wall(seen)


def _wall(seen):
    """A firewall on tibi-visio drops what is forwarded."""
    silent(seen, INNER_TIBI, outside("tibi"))
    silent(seen, [*outside("tibi"), "router"], INNER_TIBI)


def _lost_route(seen):
    """tibi-nav has lost its default route."""
    for target in outside("tibi"):
        of(seen["tibi-nav"][0]["members"], target)["route"].update(
            device=None, source=None, gateway=None, error="Network is unreachable"
        )
    silent(seen, ["tibi-nav"], outside("tibi"))
    silent(seen, outside("tibi"), ["tibi-nav"])


def _lost_route_and_only_the_router_sees_it(seen):
    _lost_route(seen)
    silent(seen, ["router"], ["tibi-nav"])


def _dhcp(seen):
    """A second default route of car-ext comes first."""
    for target in outside("car"):
        of(seen["car-ext"][0]["members"], target)["route"].update(gateway="192.168.12.1")
    seen["car-ext"][0]["default_routes"].append(
        {"device": "eth0", "gateway": "192.168.12.1", "source": None, "metric": "100"}
    )


def _gateway_off(seen):
    """car-visio has lost its inner interface: its robot no longer reaches it, nor anybody else."""
    silent(seen, INNER_CAR, ["car-visio", *outside("car")])
    silent(seen, [*outside("car"), "car-visio", "router"], INNER_CAR)


def _masquerading(seen):
    """tibi-visio translates the addresses of its robot."""
    for computer in ("dabo-visio", "dabo-nav", "car-visio"):
        multicast = seen[computer][1]
        multicast["callers"] = [
            entry for entry in multicast["callers"] if not entry["address"].startswith("192.168.11.")
        ]


def _strange_gateway(seen):
    """Somebody on the common network translates the address of dabo-visio for car-visio."""
    multicast = seen["car-visio"][1]
    multicast["callers"] = [entry for entry in multicast["callers"] if entry["address"] != "192.168.1.202"]


def _lonely(seen):
    """tibi-nav answers neither car-nav nor anybody of its own robot."""
    for observer in ("car-nav", "tibi-monitor", "tibi-visio"):
        of(seen[observer][0]["members"], "tibi-nav")["ping_address"].update(SILENT)


def _masquerading_master(seen):
    """dabo-visio translates the address of dabo-nav, so that its datagrams are not known as its own."""
    for computer in ("tibi-visio", "car-visio"):
        of(seen[computer][1]["udp"], "dabo-nav").update(unicast=None, own_source_address=None, source_address=None)
        of(seen["dabo-nav"][1]["udp"], computer).update(own_source_address="192.168.1.202", unicast=False)


def _upstream(seen):
    """car-visio takes over what tibi-visio's nodes publish, but not what those of tibi-nav do."""
    of(seen["car-nav"][0]["topics"], "tibi-nav", "computer").update(heard=False, publishers=[], error="not registered")


def _talker_at_home(seen):
    of(seen["tibi-nav"][0]["topics"], "tibi-monitor", "computer").update(heard=False, publishers=[], error="no")


def _listener(seen):
    for entry in seen["tibi-nav"][0]["topics"]:
        entry.update(heard=False, error="the listener failed: ImportError")


def _ping(observer, target, **values):
    def change(seen):
        of(seen[observer][0]["members"], target)["ping_address"].update({**SILENT, **values})

    return change


def _port(seen):
    of(seen["tibi-nav"][0]["masters"], "tibi-visio", "computer").update(
        open=False, error="Network is unreachable", clock_offset_s=None
    )


def _kernel(computer, **values):
    def change(seen):
        seen[computer][0]["forwarding"]["interfaces"][0].update(values)

    return change


# The change, the only check that fails by itself, its verdict, what tells it (or None), whom and a part of the texts.
BETWEEN_NETWORKS = [
    (_closed_gateway, "forwarding", FAILED, checks._always, {"tibi-visio"}, "run site.yml"),
    (_kernel("router", forwarding=0), "forwarding", FAILED, checks._always, {"router"}, "run site.yml"),
    (_kernel("car-visio", rp_filter=1), "reverse_path", WARNING, checks._always, {"car-visio"}, "rp_filter"),
    (_kernel("router", send_redirects=1), "redirects", WARNING, checks._always, {"router"}, "send_redirects"),
    (_lost_route, "route", FAILED, checks._no_route, {"tibi-nav"}, "tibi-nav has no way out"),
    (_wall, "ping_address", FAILED, checks._nothing_leaves, None, "tibi-visio is reached, but passes nothing on"),
    (_wall, "ping_address", FAILED, checks._nothing_enters, None, "tibi-visio is reached, but passes nothing on"),
    (_gateway_off, "ping_address", FAILED, checks._own_gateway_silent, None, ""),
    (_ping("car-nav", "tibi-nav"), "ping_address", FAILED, checks._only_from_outside, {"car-nav"}, "do not find back"),
    (
        _ping("car-nav", "tibi-nav", error="192.168.1.203 reports: communication administratively prohibited"),
        "ping_address",
        FAILED,
        checks._refused_on_the_way,
        {"car-nav"},
        "refuses",
    ),
    (
        _ping("car-nav", "tibi-nav", error="192.168.1.201 reports: host unreachable"),
        "ping_address",
        FAILED,
        checks._gateway_finds_nobody,
        {"car-nav"},
        "its gateway tibi-visio is reached, and finds nobody",
    ),
    (
        _ping("car-nav", "tibi-nav", error="192.168.1.1 reports: time to live exceeded"),
        "ping_address",
        FAILED,
        checks._in_a_circle,
        {"car-nav"},
        "back to where they came from",
    ),
    (_masquerading, "source", WARNING, checks._leaves_by_gateway, set(INNER_TIBI), "tibi-visio translates"),
    (_masquerading_master, "udp_unicast", FAILED, checks._translated_here, None, "masquerade"),
    (_strange_gateway, "source", WARNING, checks._always, {"dabo-visio"}, "NAT"),
    (_ping("car-nav", "car-ext"), "ping_address", FAILED, checks._always, {"car-nav"}, "client isolation"),
    (_lonely, "ping_address", FAILED, checks._crosses, None, "its gateway tibi-visio"),
    (_upstream, "topic_heard", FAILED, checks._only_the_master, {"car-nav"}, "sync_remote_nodes"),
    (_talker_at_home, "topic_heard", FAILED, checks._not_registered_at_home, {"tibi-nav"}, "roscore on tibi-visio"),
    (_listener, "topic_heard", FAILED, checks._listener_failed, {"tibi-nav"}, "overloaded"),
    (_port, "rpc_port", FAILED, checks._unreachable, {"tibi-nav"}, "common network"),
]


def causes(check):
    return next(entry.causes for entry in checks.CHECKS if entry.id == check)


@pytest.mark.parametrize(("change", "check", "verdict", "when", "observers", "part"), BETWEEN_NETWORKS)
def test_each_cause_between_networks_is_told(change, check, verdict, when, observers, part):
    found = [finding for finding in notable(evaluate(change, fig12())).values() if not finding.because]
    assert {(finding.check, finding.verdict) for finding in found} == {(check, verdict)}
    if observers is not None:
        assert {finding.observer for finding in found} == observers
    assert any(part in finding.cause + finding.remedy for finding in found)
    starts = [cause.cause.partition("{")[0] for cause in causes(check) if cause.when is when]
    assert any(finding.cause.startswith(start) for finding in found for start in starts)
    assert all(finding.remedy and "{" not in finding.cause + finding.remedy for finding in found)


def test_a_silent_device_is_never_said_to_be_reached():
    """The gateway of tibi is a device of another make, which nobody asked: it may be off."""
    fleet = fig12()
    fleet["computers"]["tibi-visio"].update(is_gateway=False, common_address="", is_master=True)
    next(member for member in fleet["members"] if member["name"] == "tibi-visio").update(multicast=False)

    def change(seen):
        silent(seen, [*INNER_TIBI, "tibi-visio"], outside("tibi"))
        silent(seen, [*outside("tibi"), "router"], [*INNER_TIBI, "tibi-visio"])

    found = [finding for finding in evaluate(change, fleet) if finding.check == "ping_address" and finding.cause]
    device = "the gateway 192.168.11.101, a device of another make, is off"
    assert found and all(finding.cause.startswith(device) for finding in found), {finding.cause for finding in found}
    assert {finding.observer for finding in found} >= {"tibi-nav", "car-nav"}


def test_everything_is_good_between_three_robot_networks():
    findings = evaluate(fleet=fig12())
    assert not notable(findings)
    numbers = Counter(finding.check for finding in findings)
    assert numbers["topic_heard"] == numbers["direct_connection"] == 9 * 8
    assert (numbers["forwarding"], numbers["reverse_path"], numbers["redirects"]) == (4, 4, 1)
    assert (numbers["udp_multicast"], numbers["udp_unicast"]) == (3 * 2, 4 * 3)  # the gateways, and dabo-nav by unicast
    router = {finding.check for finding in findings if finding.observer == "router"}
    assert router == {"forwarding", "reachable", "measured", "reverse_path", "redirects"} | {
        "default_routes",
        "route",
        "ping_address",
        "source",
    }


def test_with_multicast_routing_inner_masters_hear_the_group_too():
    findings = evaluate(fleet=fig12(multimaster_multicast_routing="smcroute"))
    assert not notable(findings)
    assert Counter(finding.check for finding in findings)["udp_multicast"] == 4 * 3


WAYS = [
    ("tibi-nav", "tibi-visio", "192.168.11.100", ""),
    ("tibi-visio", "tibi-nav", "192.168.11.101", ""),
    ("tibi-nav", "dabo-nav", "192.168.11.100", "192.168.11.101"),
    ("tibi-nav", "dabo-visio", "192.168.11.100", "192.168.11.101"),
    ("tibi-visio", "dabo-nav", "192.168.1.201", "192.168.1.202"),
    ("tibi-visio", "car-visio", "192.168.1.201", "192.168.1.203"),
    ("router", "car-visio", "192.168.1.1", "192.168.1.203"),
    ("router", "dabo-monitor", "192.168.1.1", "192.168.1.202"),
]


@pytest.mark.parametrize(("observer", "target", "source", "hop"), WAYS)
def test_way(observer, target, source, hop):
    fleet = fig12()
    way = ways_module.Layout(fleet).way(fleet["computers"][observer], target)
    assert (way.source, way.hop) == (source, hop)

    def other_source(seen):
        of(seen[observer][0]["members"], target)["route"]["source"] = "10.9.8.7"

    def other_hop(seen):
        of(seen[observer][0]["members"], target)["route"]["gateway"] = "10.9.8.1"

    for change in (other_source, other_hop):
        assert [key[:3] for key in notable(evaluate(change, fleet))] == [("route", observer, target)]


@pytest.mark.parametrize("names", [["tibi-nav"], ["router"], list(ROBOTS["dabo"][3]), ["car-visio", "router"]])
def test_with_limit_any_part_of_the_fleet_is_judged(names):
    fleet = fig12()
    findings = list(checks.evaluate(fleet, {name: good(fleet, name) for name in names}))
    assert not notable(findings)
    assert {finding.observer for finding in findings} == set(names)


def test_a_second_computer_without_ros_keeps_nobody_waiting():
    fleet = fig12()

    def change(seen):
        for name, (probe, _multicast) in seen.items():
            probe["topics"] = [entry for entry in probe["topics"] if entry["computer"] != "tibi-nav"]
            if name == "tibi-nav":
                probe.update(ros_missing="there is no command rostopic", topics=[])
                probe["list_masters"] = {"masters": [], "seconds": 0, "error": "there is no command rosservice"}
                probe["talker"] = {"running": False, "error": "there is no command rostopic"}

    findings = evaluate(change, fleet)
    assert not notable(findings)
    assert Counter(finding.check for finding in findings)["topic_heard"] == 8 * 7


def test_existing_routes_may_go_by_the_router():
    fleet = fig12(multimaster_routes="existing")

    def by_router(seen):
        for computer in ("tibi-visio", "tibi-nav"):
            of(seen[computer][0]["members"], "car-nav")["route"]["gateway"] = "192.168.1.1"

    assert [key[:3] for key in notable(evaluate(by_router, fleet))] == [("route", "tibi-nav", "car-nav")]


def test_a_second_default_route_of_an_inner_computer_is_told_with_its_way_out():
    found = [finding for finding in notable(evaluate(_dhcp, fig12())).values() if not finding.because]
    assert {finding.check for finding in found} == {"default_routes", "route"}
    routes = next(finding for finding in found if finding.check == "default_routes")
    assert "metric 100" in routes.found and "multimaster_routes to networks" in routes.remedy
    assert "second default route" in next(finding for finding in found if finding.check == "route").cause


def test_a_route_that_only_the_router_misses_is_told_too():
    found = [
        finding
        for finding in notable(evaluate(_lost_route_and_only_the_router_sees_it, fig12())).values()
        if finding.observer == "router"
    ]
    assert [finding.check for finding in found] == ["ping_address"]
    assert "tibi-nav has no way out" in found[0].cause


def test_behind_a_gateway_that_is_down_nobody_is_named():
    fleet = fig12()
    seen = {name: good(fleet, name) for name in fleet["computers"]}
    silent(
        {name: (one.probe, one.multicast) for name, one in seen.items()}, [*outside("car"), "router"], ROBOTS["car"][3]
    )
    for name in ROBOTS["car"][3]:
        seen[name] = Observation(unreachable=True, problem="no route to host")
    for name, one in seen.items():
        if one.probe:
            one.probe["topics"] = [entry for entry in one.probe["topics"] if not entry["computer"].startswith("car")]
            for entry in one.probe["masters"]:
                if entry["computer"] == "car-visio":
                    entry.update(open=False, error="no answer", clock_offset_s=None)
        for entry in (one.multicast or {"udp": ()})["udp"]:
            if entry["name"] == "car-visio":
                entry.update(heard_from=False, unicast=None, source_address=None, own_source_address=None)
    found = [finding for finding in notable(checks.evaluate(fleet, seen)).values() if not finding.because]
    assert [(finding.check, finding.observer) for finding in found] == [("reachable", "car-visio")]


# What the other tests of this file bring about.
UNTOLD = {
    (check.id, cause.cause + cause.remedy)
    for check in checks.CHECKS
    for cause in check.causes
    if check.id in ("reachable", "default_routes", "strangers")
    or cause.when in (checks._target_down, checks._left_out)
    or (check.id, cause.when) in {(row[1], row[3]) for row in BETWEEN_NETWORKS}
    or cause.when in (checks._other_hop, checks._no_way_back)
    or cause.when in (checks._device_passes_nothing_out, checks._device_passes_nothing_in)
    or (check.id in ("ping_address", "udp_multicast", "icmp_rounds", "list_masters") and cause.when is checks._always)
}


def test_a_failure_that_follows_names_its_reason_and_no_cause_of_its_own():
    def change(seen):
        _member("ping_address", ok=False, error="no answer")(seen)
        _member("ping_name", ok=False, error="no answer")(seen)
        _master(open=False, error="no answer", clock_offset_s=None)(seen)
        _unlisted(seen)
        _topic(heard=False, publishers=[], error="not registered")(seen)
        _udp(None, heard_from=False, source_address=None)(seen)

    found = notable(evaluate(change))
    assert {check: finding.because for (check, _one, _two), finding in found.items()} == {
        "ping_address": "",
        "ping_name": "ping_address",
        "udp_multicast": "ping_address",
        "udp_unicast": "ping_address",
        "rpc_port": "ping_address",
        "clock": "rpc_port",
        "list_masters": "rpc_port",
        "topic_heard": "list_masters",
    }
    assert all(not finding.cause for finding in found.values() if finding.because)


@pytest.mark.parametrize(
    ("transport", "heard", "unicast", "multicast_verdict", "unicast_verdict"),
    [
        ("both", False, True, WARNING, OK),
        ("both", True, False, OK, WARNING),
        ("both", False, None, FAILED, FAILED),
        ("multicast", False, True, FAILED, None),
        ("unicast", False, True, None, OK),
        ("unicast", True, False, None, FAILED),
    ],
)
def test_what_the_transport_needs(transport, heard, unicast, multicast_verdict, unicast_verdict):
    change = _udp(unicast, heard_from=heard, source_address="192.168.1.2" if heard else None)
    findings = evaluate(change, plan(multimaster_transport=transport))
    verdicts = {
        finding.check: finding.verdict for finding in findings if (finding.observer, finding.target) == (ONE, TWO)
    }
    assert (verdicts.get("udp_multicast"), verdicts.get("udp_unicast")) == (multicast_verdict, unicast_verdict)


def test_by_plan_nobody_answers_a_ping_of_the_group():
    findings = evaluate(_icmp, plan(multimaster_answer_broadcast_pings=False))
    assert not notable(findings) and "icmp_rounds" not in {finding.check for finding in findings}


def test_a_computer_that_is_down_is_named_once():
    fleet = plan(robots=3)
    seen = {name: good(fleet, name) for name in fleet["computers"]}
    seen[TWO] = Observation(unreachable=True, problem="no route to host")
    for name in (ONE, "kobuki3computer"):
        probe, multicast = seen[name].probe, seen[name].multicast
        of(probe["members"], TWO)["ping_address"].update(ok=False, error="no answer")
        of(probe["members"], TWO)["ping_name"].update(ok=False, error="no answer")
        of(probe["masters"], TWO, "computer").update(open=False, error="no answer", clock_offset_s=None)
        probe["list_masters"]["masters"].remove(of(probe["list_masters"]["masters"], TWO))
        probe["topics"].remove(of(probe["topics"], TWO, "computer"))
        of(multicast["udp"], TWO).update(heard_from=False, unicast=None, source_address=None)
    found = notable(checks.evaluate(fleet, seen))
    assert [key for key, finding in found.items() if not finding.because] == [("reachable", TWO, TWO)]
    assert "no route to host" in found["reachable", TWO, TWO].found
    assert not any({observer, target} == {ONE, "kobuki3computer"} for _check, observer, target in found)


def test_a_computer_without_a_result_is_named():
    fleet = plan()
    seen = {ONE: good(fleet, ONE), TWO: Observation(problem="MODULE FAILURE")}
    found = notable(checks.evaluate(fleet, seen))
    assert found["measured", TWO, TWO].found == "MODULE FAILURE"
    assert {observer for _check, observer, _target in found} == {TWO}


def test_with_limit_only_the_computers_of_the_run_are_judged():
    fleet = plan()
    seen = copy.deepcopy(good(fleet, ONE))
    seen.probe["topics"].clear()  # nobody talks there, and nobody listens
    of(seen.multicast["udp"], TWO).update(heard_from=False, unicast=None)
    findings = list(checks.evaluate(fleet, {ONE: seen}))
    assert not notable(findings)
    assert {finding.observer for finding in findings} == {ONE}
    assert {"name", "ping_name", "list_masters"} <= {finding.check for finding in findings if finding.target == TWO}


@pytest.mark.parametrize(
    ("filters", "left_out"),
    [
        ({}, False),
        ({"sync_topics": ["/odom"]}, False),
        ({"ignore_topics": ["/MULTI*"]}, True),
        ({"ignore_types": ["std_msgs/*"]}, True),
        ({"ignore_topics": ["/tf"]}, False),
    ],
)
def test_a_topic_that_the_filters_leave_out_is_no_failure(filters, left_out):
    fleet = plan(multimaster_filters=filters)
    found = notable(evaluate(_topic(heard=False, publishers=[], error="not registered"), fleet))
    assert found["topic_heard", ONE, TWO].verdict == (UNKNOWN if left_out else FAILED)
    assert ("multimaster_filters" in found["topic_heard", ONE, TWO].cause) == left_out


def test_strangers_and_two_default_routes_are_warnings():
    def change(seen):
        seen[ONE][1]["unexpected"].append({"address": "192.168.1.77", "interface": "eth0", "datagrams": 3})
        seen[ONE][0]["list_masters"]["masters"].append(
            {"name": "guest", "uri": "http://guest:11311/", "online": True, "monitoruri": "http://192.168.1.77:11611"}
        )
        seen[ONE][0]["default_routes"].append({"device": "wlan0", "gateway": None, "source": None, "metric": "600"})

    found = notable(evaluate(change))
    assert {key[0]: finding.verdict for key, finding in found.items()} == {
        "strangers": WARNING,
        "default_routes": WARNING,
    }
    assert "guest" in found["strangers", ONE, ONE].found and "192.168.1.77" in found["strangers", ONE, ONE].found


def test_a_second_computer_may_be_without_ros():
    fleet = plan(computers=2)
    second = ONE + "-1"

    def change(seen):
        probe = seen[second][0]
        probe["roscore"] = {"uri": "", "answer": "", "error": "no file"}
        probe["ros_missing"] = "no file"
        probe["talker"] = {"running": False, "error": "no file"}
        for name, (other, _multicast) in seen.items():
            other["topics"] = [entry for entry in other["topics"] if entry["computer"] != second]
        probe["list_masters"] = {"masters": [], "seconds": 0, "error": "no file"}
        probe["topics"] = []

    findings = evaluate(change, fleet)
    assert not notable(findings)
    assert not {"list_masters", "topic_heard"} & {finding.check for finding in findings if finding.observer == second}


# kobuki1 gives its odometry to kobuki2, which gives /chatter to kobuki3; nothing else flows.
DECLARED = {
    "kobuki1": [{"topics": ["/kobuki1/odom"], "to": ["kobuki2"]}],
    "kobuki2": [{"topics": ["/chatter"], "services": ["/kobuki2/reset"], "to": ["kobuki3"]}],
}


def test_a_declared_flow_and_nothing_else_is_expected():
    findings = evaluate(fleet=plan(robots=3, exports=DECLARED))
    assert not notable(findings)
    heard = {(finding.observer, finding.target) for finding in findings if finding.check == "topic_heard"}
    assert heard == {(TWO, ONE), ("kobuki3computer", TWO)}
    assert {finding.check for finding in findings} >= {"direct_connection", "flow", "cross_link", "names", "types"}


def _leak(seen):
    """kobuki3 has the odometry of kobuki1, and a connection with it, though nothing flows there."""
    part = seen["kobuki3computer"][0]["exchange"]
    part["imports"].append(
        {
            "master": "http://kobuki1computer:11311/",
            "topics": [topic("/kobuki1/odom", "nav_msgs/Odometry", ["/kobuki1/base"])],
            "services": [],
        }
    )
    part["connections"].append(
        {
            "node": "/kobuki3/base",
            "topic": "/kobuki1/odom",
            "direction": "in",
            "peer": "/kobuki1/base",
            "host": ONE,
            "robot": "kobuki1",
        }
    )


def test_what_is_not_declared_and_there_nevertheless_is_told_with_its_names():
    found = notable(evaluate(_leak, plan(robots=3, exports=DECLARED)))
    assert set(found) == {("flow", "kobuki3computer", ONE), ("cross_link", "kobuki3computer", ONE)}
    flow, link = found["flow", "kobuki3computer", ONE], found["cross_link", "kobuki3computer", ONE]
    assert flow.verdict == link.verdict == FAILED
    assert flow.found == "there against the plan: the publisher /kobuki1/odom of /kobuki1/base"
    assert link.found == "/kobuki3/base hears /kobuki1/base of kobuki1 on /kobuki1/odom"


def test_a_declared_topic_that_does_not_arrive_is_told():
    def change(seen):
        seen[TWO][0]["exchange"]["imports"] = []
        seen[TWO][0]["topics"][0].update(heard=False, publishers=[], error="the topic is not registered")

    found = notable(evaluate(change, plan(robots=3, exports=DECLARED)))
    assert set(found) == {("topic_heard", TWO, ONE), ("flow", TWO, ONE)}
    assert found["flow", TWO, ONE].found == "not there: the publisher /kobuki1/odom of /kobuki1/base"


def test_names_and_types_are_told_with_both_robots():
    names = notable(evaluate(_renamed))
    assert {finding.found for finding in names.values()} == {"the node /base is of kobuki1 and of kobuki2"}
    types = notable(evaluate(_other_type()))
    assert {finding.found for finding in types.values()} == {
        "/chatter is std_msgs/String on kobuki1 and std_msgs/Header on kobuki2"
    }
    sums = notable(evaluate(_other_type("std_msgs/String", "0123")))
    text = f"the md5 sum {SUMS['std_msgs/String']} on kobuki1 and 0123 on kobuki2"
    assert all(finding.found.endswith(text) for finding in sums.values())


def test_a_silent_sync_node_of_another_provider_is_no_failure():
    found = notable(evaluate(_exchange_of(ONE, error="no answer")))
    assert {(finding.check, finding.verdict) for finding in found.values()} == {("flow", UNKNOWN)}


def test_many_names_are_counted():
    def change(seen):
        seen[ONE][0]["exchange"]["silent"] = [f"/dead{number}" for number in range(9)]

    found = notable(evaluate(change))["nodes_answer", ONE, ONE].found
    assert found == "no answer of /dead0, /dead1, /dead2, /dead3 and 5 more"


def test_the_cost_grows_with_the_observations():
    fleet = plan(robots=60)
    seen = {name: good(fleet, name) for name in fleet["computers"]}
    began = time.process_time()
    findings = list(checks.evaluate(fleet, seen))
    assert len(findings) > 60 * 59 * 10
    assert time.process_time() - began < 0.0005 * len(findings)  # some 10 microseconds each on a PC
