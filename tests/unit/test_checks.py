# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Observations of a fleet, good and broken, and what is found: the plan is the planner's own."""

import copy
import time

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils import _checks, _fleet, _plan
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._checks import (
    FAILED,
    OK,
    UNKNOWN,
    WARNING,
    Observation,
)

ONE, TWO = "kobuki1computer", "kobuki2computer"


def plan(robots=2, computers=1, **variables):
    """The plan of a fleet of robots kobuki1, kobuki2, ... with addresses from 192.168.1.1 on."""
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
        }
        for n, host in enumerate(names)
    }
    return _plan.plan(_fleet.read_fleet(_fleet.Inventory(robots=hosts, variables=values)))


def good(fleet, name):
    """What a computer sees of a fleet in which everything works."""
    own = fleet["computers"][name]
    others = [member for member in fleet["members"] if member["name"] != name]
    alive = {"ok": True, "rtt_ms": 0.4, "error": ""}
    probe = {
        "members": [{"name": name, "address": own["address"], "addresses": [own["address"]], "resolve_error": ""}]
        + [
            {
                "name": other["name"],
                "address": other["address"],
                "addresses": [other["address"]],
                "resolve_error": "",
                "route": {"device": "eth0", "source": own["address"], "gateway": None, "error": ""},
                "ping_address": dict(alive),
                "ping_name": dict(alive),
            }
            for other in others
        ],
        "default_routes": [{"device": "eth0", "gateway": "192.168.1.254", "source": None}],
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
            "uri": own["environment"]["ROS_MASTER_URI"],
            "answer": own["environment"]["ROS_MASTER_URI"] + "/",
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
                "computer": master["computer"],
                "topic": "/multimaster_verify/" + master["computer"],
                "publishers": [{"node": "/rostopic_1_1", "uri": f"http://{master['computer']}:41233/"}],
                "registered_s": 0.1,
                "heard": True,
                "text": "run " + master["computer"],
                "error": "",
            }
            for master in fleet["masters"]
            if master["computer"] != name
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
        "talker": {"running": True, "error": ""},
        "problems": [],
    }
    multicast = {
        "udp": [
            {
                "name": other["name"],
                "address": other["address"],
                "heard_from": True,
                "heard": 30,
                "source_address": other["address"],
                "other_interfaces": [],
                "loss": 0.0,
                "unicast": True,
            }
            for other in others
        ],
        "icmp": {
            "group": "224.0.0.1",
            "error": None,
            "rounds": [{"round": 1, "answered": [other["name"] for other in others]}],
        },
        "send_errors": {"count": 0, "last": None},
        "unexpected": [],
    }
    return Observation(multicast=multicast, probe=probe)


def evaluate(change=None, fleet=None):
    """The findings of two good robots after a change of the observations {name: (probe, multicast)}."""
    fleet = fleet or plan()
    seen = {name: good(fleet, name) for name in fleet["computers"]}
    if change:
        change({name: (observation.probe, observation.multicast) for name, observation in seen.items()})
    return list(_checks.evaluate(fleet, seen))


def notable(findings):
    return {(finding.check, finding.observer, finding.target): finding for finding in findings if finding.verdict != OK}


def of(entries, name, key="name"):
    return next(entry for entry in entries if entry[key] == name)


def test_everything_is_checked_and_good():
    findings = evaluate()
    assert {finding.check for finding in findings} == {check.id for check in _checks.CHECKS}
    assert not notable(findings)
    pairs = {(finding.observer, finding.target) for finding in findings}
    assert pairs == {(ONE, ONE), (ONE, TWO), (TWO, ONE), (TWO, TWO)}


def test_every_check_is_explained_by_an_earlier_one():
    earlier = set()
    for check in _checks.CHECKS:
        assert {reference.rpartition(":")[2] for reference in check.explained_by} <= earlier
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
    for check in _checks.CHECKS:
        texts = [cause.cause + cause.remedy for cause in check.causes]
        for text in texts:
            rows = [part for other, part in told if other == check.id and part in text]
            assert rows or (check.id, text) in UNTOLD, (check.id, text)


# What the other tests of this file bring about.
UNTOLD = {
    (check.id, cause.cause + cause.remedy)
    for check in _checks.CHECKS
    for cause in check.causes
    if check.id in ("reachable", "default_routes", "strangers")
    or cause.when in (_checks._target_down, _checks._left_out)
    or (check.id in ("ping_address", "udp_multicast", "icmp_rounds", "list_masters") and cause.when is _checks._always)
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
    found = notable(_checks.evaluate(fleet, seen))
    assert [key for key, finding in found.items() if not finding.because] == [("reachable", TWO, TWO)]
    assert "no route to host" in found["reachable", TWO, TWO].found
    assert not any({observer, target} == {ONE, "kobuki3computer"} for _check, observer, target in found)


def test_a_computer_without_a_result_is_named():
    fleet = plan()
    seen = {ONE: good(fleet, ONE), TWO: Observation(problem="MODULE FAILURE")}
    found = notable(_checks.evaluate(fleet, seen))
    assert found["measured", TWO, TWO].found == "MODULE FAILURE"
    assert {observer for _check, observer, _target in found} == {TWO}


def test_with_limit_only_the_computers_of_the_run_are_judged():
    fleet = plan()
    seen = copy.deepcopy(good(fleet, ONE))
    seen.probe["topics"].clear()  # nobody talks there, and nobody listens
    of(seen.multicast["udp"], TWO).update(heard_from=False, unicast=None)
    findings = list(_checks.evaluate(fleet, {ONE: seen}))
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
        seen[ONE][0]["default_routes"].append({"device": "wlan0", "gateway": None, "source": None})

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
        probe["list_masters"] = {"masters": [], "seconds": 0, "error": "no file"}
        probe["topics"] = []

    findings = evaluate(change, fleet)
    assert not notable(findings)
    assert not {"list_masters", "topic_heard"} & {finding.check for finding in findings if finding.observer == second}


def test_the_cost_grows_with_the_observations():
    fleet = plan(robots=60)
    seen = {name: good(fleet, name) for name in fleet["computers"]}
    began = time.process_time()
    findings = list(_checks.evaluate(fleet, seen))
    assert len(findings) > 60 * 59 * 10
    assert time.process_time() - began < 0.0005 * len(findings)  # some 10 microseconds each on a PC
