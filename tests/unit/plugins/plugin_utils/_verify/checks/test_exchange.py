# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks of the exchange between robots: names, types, flows and connections."""

import time
from collections import Counter
from dataclasses import replace

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.engine import (
    FAILED,
    OK,
    UNKNOWN,
    WARNING,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.exchange import MOST_COMPONENTS
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import (
    AnnouncedHost,
    CrossingParameter,
    FilterChain,
    FilterChains,
    FilterRule,
    GivenTopics,
    Import,
    NodeConnection,
    NodeHost,
    RefusedName,
    RegisteredService,
    SilentNode,
    TopicPublisher,
    UnreachedNode,
    UnregisteredNodes,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.outcomes import Outcome
from fleets import (
    ONE,
    SUMS,
    TALKS,
    TWO,
    assert_told,
    components,
    diagnosed,
    evaluate,
    fig12,
    no_answer,
    notable,
    of,
    plan,
    topic,
    update,
    without,
)
from mentioned import mentions

THREE = "kobuki3computer"


def _exchange_of(computer, **values):
    return lambda seen: update(seen[computer].probe.exchange, **values)


def _renamed(seen):
    """The base of the second robot has the name of the first one's, so its registrations are refused on both."""
    for robot, computer in (("kobuki1", ONE), ("kobuki2", TWO)):
        component = seen[computer].probe.exchange
        other = component.imports[0]
        update(other, topics=[entry for entry in other.topics if "base" not in str(entry.publishers)], services=())
        for entry in other.topics:
            update(entry, subscribers=())
        for entry in component.topics:
            for kind in ("publishers", "subscribers"):
                nodes = [node.replace(f"/{robot}/base", "/base") for node in getattr(entry, kind)]
                update(entry, **{kind: nodes})
        for entry in component.services:
            update(entry, node=entry.node.replace(f"/{robot}/base", "/base"))


def _same_service(seen):
    """Both have the service /reset, and neither is registered at the other."""
    for computer in (ONE, TWO):
        component = seen[computer].probe.exchange
        update(component.services[0], name="/reset")
        update(component.imports[0], services=())


def _other_type(kind="std_msgs/Header", md5sum="4d9af5aeee4e9d8e2d1d0c0e6c6a7ee3"):
    def change(seen):
        for computer in (ONE, TWO):
            component = seen[computer].probe.exchange
            update(component.imports[0], topics=without(component.imports[0].topics, "/chatter"))
            update(component, connections=())
        update(of(seen[TWO].probe.exchange.topics, "/chatter"), type=kind, md5sum=md5sum)

    return change


def _not_registered(seen):
    component = seen[ONE].probe.exchange.imports[0]
    update(component, topics=without(component.topics, "/kobuki2/odom"))


def _not_followed(seen):
    """Nothing of the other robot is registered, which its discovery node gives when it is asked."""
    update(seen[ONE].probe.exchange, imports=[])
    talker = f"/multimaster_verify/{TWO}"
    source = GivenTopics(TWO, (talker,), (talker,), outcome=Outcome.ANSWERED)
    update(seen[ONE].probe, sources=[*seen[ONE].probe.sources, source])


def _heard_all_the_same(seen):
    """The other robot has registered the subscriber, so its talker calls."""
    _not_followed(seen)
    update(of(seen[ONE].probe.topics, TWO, "computer"), publishers=[TopicPublisher("/talker", "")])


def _refused(seen):
    _not_registered(seen)
    update(of(seen[ONE].probe.services, "sync"), refused=["/kobuki2/odom", "/other"])


def _against_the_plan(seen):
    component = seen[ONE].probe.exchange.imports[0]
    update(component, topics=[*component.topics, topic("/rosout", "rosgraph_msgs/Log", ["/kobuki2/base"])])


def _too_many(seen):
    component = seen[ONE].probe.exchange.imports[0]
    flood = [topic(f"/flood/{number}", "std_msgs/String", ["/kobuki2/base"]) for number in range(5000)]
    update(component, topics=[*without(component.topics, "/kobuki2/odom"), *flood])
    own = seen[TWO].probe.exchange
    update(own, topics=[*own.topics, *flood])


def _stranger_of_a_node(seen):
    """A connection on a topic that is exchanged with nobody."""
    component = seen[ONE].probe.exchange
    stranger = NodeConnection("/rosout", "/rosout", "in", "http://kobuki2computer:1234/", TWO, "kobuki2")
    update(component, connections=[*component.connections, stranger])


def _announces(host, process=True, computer=TWO):
    """The base of the second robot was started with a wrong host, so the first robot does not take it."""

    def change(seen):
        _refused(seen)
        refusal = RefusedName("/kobuki2/base", "place", f"http://{host}:41233/", TWO, "it is no computer of kobuki2")
        update(of(seen[ONE].probe.services, "sync"), refused=["/kobuki2/base"], refusals=[refusal])
        node = AnnouncedHost("/kobuki2/base", host, 41233)
        silence = SilentNode("/kobuki2/base", host, "Connection refused", Outcome.REFUSED)
        own = seen[TWO].probe.exchange
        update(own, announced=[node], silent=["/kobuki2/base"], silences=[silence])
        if process:
            update(
                seen[computer].probe,
                node_hosts=[NodeHost(host, "ROS_IP", "session-4.scope", (41233, 46011), "base", starter="shell")],
            )

    return change


def _is_apart(seen):
    """The base of the second robot runs in a container with a network of its own, and announces its computer."""
    silence = SilentNode("/kobuki2/base", TWO, "Connection refused", Outcome.REFUSED, port=41233)
    update(seen[TWO].probe.exchange, silent=["/kobuki2/base"], silences=[silence])
    process = NodeHost(TWO, "ROS_HOSTNAME", "docker-77.scope", (41233, 46011), "base", starter="container", apart=True)
    update(seen[TWO].probe, node_hosts=[process])


ROBOTS = "kobuki1 and kobuki2"

# The change, a check that tells it, its verdict, and the part that is named.
FAULTS = [
    (_exchange_of(ONE, silent=["/dead"]), "nodes_answer", WARNING, "registration", ONE, "ghost"),
    (_is_apart, "node_hosts", FAILED, "node", TWO, "network"),
    (_announces("127.0.0.1"), "node_hosts", FAILED, "node", TWO, "loopback"),
    (_announces("localhost"), "node_hosts", FAILED, "node", TWO, "loopback"),
    (_announces("10.9.8.7"), "node_hosts", FAILED, "node", TWO, "address"),
    (_announces("laptop7"), "node_hosts", FAILED, "node", TWO, "name"),
    (_announces("kobuki1computer"), "node_hosts", FAILED, "node", TWO, "name"),
    (_announces("127.0.0.1", process=False), "node_hosts", FAILED, "node", TWO, "loopback"),
    (_renamed, "names", FAILED, "registration", ROBOTS, "twin"),
    (_same_service, "names", FAILED, "registration", ROBOTS, "twin"),
    (_other_type(), "types", FAILED, "messages", ROBOTS, "differ"),
    (_other_type(TALKS, "0123"), "types", FAILED, "messages", ROBOTS, "differ"),
    (_exchange_of(ONE, types_error="ImportError: no module named rospy"), "types", UNKNOWN, "messages", ONE, "unknown"),
    (
        _exchange_of(ONE, types_error="nothing within 20 s", types_outcome=Outcome.NO_ANSWER),
        *("types", UNKNOWN, "computer", ONE, "overloaded"),
    ),
    (_exchange_of(ONE, error="get_sync_info does not answer"), "flow", UNKNOWN, "sync", ONE, "untold"),
    (_not_followed, "flow", FAILED, "sync", ONE, "stale"),
    (_heard_all_the_same, "direct_connection", FAILED, "sync", ONE, "stale"),
    (_not_registered, "flow", FAILED, "sync", ONE, "stale"),
    (_refused, "flow", FAILED, "sync", ONE, "refuses"),
    (_too_many, "flow", FAILED, "sync", ONE, "limit"),
    (_against_the_plan, "flow", FAILED, "sync", ONE, "configuration"),
    (_stranger_of_a_node, "cross_link", FAILED, "registration", ROBOTS, "link"),
]


BRIDGES = " ".join(f"/{robot}/ros_bridge{part}" for robot in ("kobuki1", "kobuki2") for part in ("", "_ear"))


def _odd_names(seen):
    _stranger_of_a_node(seen)
    (stranger,) = seen[ONE].probe.exchange.connections[-1:]
    update(stranger, node="/rosout;reboot", peer="/$(reboot)")


@pytest.mark.parametrize(("change", "check", "verdict", "kind", "place", "mode"), FAULTS)
def test_each_fault_is_named(change, check, verdict, kind, place, mode):
    assert_told(change, check, verdict, kind, place, mode)


def test_where_large_packets_are_lost_no_sync_node_is_at_fault():
    def change(seen):
        _not_followed(seen)
        for one, other in ((ONE, TWO), (TWO, ONE)):
            update(of(seen[one].probe.members, other), ping_large=no_answer())

    assert components(diagnosed(change)) == [("network", "the common network", "large")]


def test_a_registration_missing_alone_may_be_left_out_by_a_side():
    (found,) = diagnosed(_not_registered).findings
    assert ("sync", ONE) in {component[:2] for component in found.candidates}


# kobuki1 gives its odometry to kobuki2, which gives /chatter to kobuki3; nothing else flows.
DECLARED = {
    "kobuki1": [{"topics": ["/kobuki1/odom"], "to": ["kobuki2"]}],
    "kobuki2": [{"topics": ["/chatter"], "services": ["/kobuki2/reset"], "to": ["kobuki3"]}],
}


def test_a_declared_flow_and_nothing_else_is_expected():
    findings = evaluate(fleet=plan(robots=3, exports=DECLARED))
    assert not notable(findings)
    heard = {(finding.observer, finding.target) for finding in findings if finding.check == "topic_heard"}
    assert heard == {(TWO, ONE), (THREE, TWO)}
    assert {finding.check for finding in findings} >= {"direct_connection", "flow", "cross_link", "names", "types"}


def _leak(seen):
    """kobuki3 has the odometry of kobuki1, and a connection with it, though nothing flows there."""
    component = seen[THREE].probe.exchange
    odometry = topic("/kobuki1/odom", "nav_msgs/Odometry", ["/kobuki1/base"])
    link = NodeConnection("/kobuki3/base", "/kobuki1/odom", "in", "/kobuki1/base", ONE, "kobuki1")
    update(
        component,
        imports=[*component.imports, Import("http://kobuki1computer:11311/", (odometry,))],
        connections=[*component.connections, link],
    )


def test_an_undeclared_topic_is_told_by_its_name():
    found = notable(evaluate(_leak, plan(robots=3, exports=DECLARED)))
    assert set(found) == {("flow", THREE, ONE), ("cross_link", THREE, ONE)}
    flow, link = found["flow", THREE, ONE], found["cross_link", THREE, ONE]
    assert flow.verdict == link.verdict == FAILED
    assert mentions(flow.found, "against the plan", "/kobuki1/odom", "/kobuki1/base")
    assert mentions(link.found, "/kobuki3/base", "/kobuki1/base", "kobuki1", "/kobuki1/odom")


def test_a_declared_topic_that_does_not_arrive_is_told():
    def change(seen):
        update(seen[TWO].probe.exchange, imports=())
        update(seen[TWO].probe.topics[0], heard=False, publishers=(), error="the topic is not registered")

    found = notable(evaluate(change, plan(robots=3, exports=DECLARED)))
    assert set(found) == {("topic_heard", TWO, ONE), ("flow", TWO, ONE)}
    assert mentions(found["flow", TWO, ONE].found, "not there", "/kobuki1/odom", "/kobuki1/base")


def test_names_and_types_are_told_with_both_robots():
    names = notable(evaluate(_renamed))
    assert {finding.found for finding in names.values()} == {"the node /base is of kobuki1 and of kobuki2"}
    types = notable(evaluate(_other_type()))
    assert {finding.found for finding in types.values()} == {
        f"/chatter is {TALKS} on kobuki1 and std_msgs/Header on kobuki2"
    }
    sums = notable(evaluate(_other_type(TALKS, "0123")))
    text = f"the md5 sum {SUMS[TALKS]} on kobuki1 and 0123 on kobuki2"
    assert all(finding.found.endswith(text) for finding in sums.values())


def test_a_silent_sync_node_of_another_provider_is_no_failure():
    found = notable(evaluate(_exchange_of(ONE, error="no answer")))
    assert {(finding.check, finding.verdict) for finding in found.values()} == {("flow", UNKNOWN)}


def test_many_names_are_counted():
    found = notable(evaluate(_exchange_of(ONE, silent=[f"/dead{number}" for number in range(9)])))
    assert mentions(found["nodes_answer", ONE, ONE].found, "/dead0", "/dead1", "/dead2", "/dead3", "5")


def _publish(name, *robots, node="velocity"):
    """Nodes of these robots publish a topic, and everybody has it who is to."""

    def change(seen):
        contents = {of_robot: seen[f"{of_robot}computer"].probe.exchange for of_robot in robots}
        for robot, own in contents.items():
            new = topic(name, "geometry_msgs/Twist", [f"/{robot}/{node}"], [f"/{robot}/{node}_ear"])
            update(own, topics=[*own.topics, new])

    return change


def _find_shared(change, fleet=None):
    rows = notable(evaluate(change, fleet or plan())).values()
    return {(row.verdict, row.found) for row in rows if row.check == "shared_topics"}


@pytest.mark.parametrize("name", ["/tf", "/cmd_vel", "/odom", "/map", "/clock", "/anything"])
def test_a_topic_of_two_robots_names_both(name):
    found = diagnosed(_publish(name, "kobuki1", "kobuki2")).findings
    (shared,) = [entry for entry in found if entry.component.kind == "topic"]
    assert shared.component == ("topic", "kobuki1", "shared", name, "kobuki2") and shared.sure == "seen"
    assert {row.verdict for row in shared.proof} == {WARNING}


def _give(*topics, to=()):
    return {"topics": list(topics), "services": ["*"], **({"to": list(to)} if to else {})}


BOTH = ("kobuki1", "kobuki2")


@pytest.mark.parametrize(
    "exports",
    [
        dict.fromkeys(BOTH, []),  # it is given to nobody
        dict.fromkeys(BOTH, [_give("/kobuki*")]),
        dict.fromkeys(BOTH, [_give("*", "/cmd_vel")]),  # both name it
    ],
)
def test_a_topic_that_does_not_cross_or_is_meant_is_fine(exports):
    assert not _find_shared(_publish("/cmd_vel", *BOTH), plan(exports=exports))


@pytest.mark.parametrize("named", [(), ("kobuki1",)])
def test_a_topic_that_one_robot_names_is_told(named):
    exports = {robot: [_give("*", *(["/cmd_vel"] if robot in named else []))] for robot in BOTH}
    assert _find_shared(_publish("/cmd_vel", *BOTH), plan(exports=exports)) == {
        (WARNING, "/cmd_vel of kobuki1 and of kobuki2")
    }


def test_a_topic_that_a_third_robot_gets_twice_is_told_there():
    exports = {**dict.fromkeys(BOTH, [_give("/tf", to=["kobuki3"])]), "kobuki3": []}
    assert not _find_shared(_publish("/tf", *BOTH), plan(robots=3, exports=exports))
    exports[TWO.removesuffix("computer")] = [_give("*", to=["kobuki3"])]
    rows = notable(evaluate(_publish("/tf", *BOTH), plan(robots=3, exports=exports))).values()
    told = {(row.observer, row.found) for row in rows if row.check == "shared_topics"}
    assert told == {(THREE, "/tf of kobuki1 and of kobuki2")}


@pytest.mark.parametrize(
    "kind", ["diagnostic_msgs/DiagnosticArray", "rosgraph_msgs/Log", "rosgraph_msgs/TopicStatistics"]
)
def test_a_topic_for_many_publishers_is_fine(kind):
    def change(seen):
        _publish("/diagnostics", *BOTH)(seen)
        for computer in (ONE, TWO):
            update(of(seen[computer].probe.exchange.topics, "/diagnostics"), type=kind)

    assert not _find_shared(change)


def _bridge(seen):
    _publish("/pose", *BOTH, node="ros_bridge")(seen)


@pytest.mark.parametrize(
    ("change", "mode", "command"),
    [
        (
            _other_type(TALKS, "0123"),
            "differ",
            f"rostopic type /chatter; rosmsg md5 {TALKS}",
        ),
        (
            _other_type("std_msgs/$(reboot)"),
            "differ",
            f"rostopic type /chatter; rosmsg md5 {TALKS}",
        ),
        (_stranger_of_a_node, "link", "rosnode info /rosout"),
        (_odd_names, "link", "rosnode info <node>"),
        (_publish("/cmd_vel", *BOTH), "shared", "rostopic info /cmd_vel"),
        (_bridge, "circle", f"rosnode info {BRIDGES}"),
    ],
)
def test_the_look_has_the_names_that_were_read_if_a_command_can_hold_them(change, mode, command):
    (entry,) = [one for one in diagnosed(change).findings if one.component.mode == mode]
    (advice,) = entry.look
    assert (advice.where, advice.text) == ("the masters of kobuki1 and kobuki2", command)


@pytest.mark.parametrize(
    ("nodes", "circle"), [(("ros_bridge", "ros1_bridge"), True), (("ros_bridge", "base"), False), (("a", "b"), False)]
)
def test_two_bridges_with_one_topic_are_a_circle(nodes, circle):
    def change(seen):
        for robot, node in zip(BOTH, nodes, strict=True):
            _publish("/pose", robot, node=node)(seen)

    found = {entry.component for entry in diagnosed(change).findings if entry.component.mode == "circle"}
    assert found == ({("topic", "kobuki1", "circle", "/pose", "kobuki2")} if circle else set())


# Parameters that cross

MODEL = "/robot_description"
GIVES = {"kobuki1": [{"topics": ["*"], "services": ["*"], "parameters": [MODEL, "/limits"]}]}


def _with_parameters(seen, here, there):
    """Let the first robot have these digests, and the second one those."""
    for computer, digests in ((ONE, here), (TWO, there)):
        crossing = [CrossingParameter(name, text) for name, text in digests.items()]
        update(seen[computer].probe.parameters, crossing=crossing)


@pytest.mark.parametrize(
    ("here", "there", "found"),
    [
        ({MODEL: "x", "/limits": ""}, {MODEL: "x", "/limits": "own"}, ""),
        ({MODEL: "x", "/limits": ""}, {MODEL: "y", "/limits": ""}, f"{MODEL} of kobuki1 has another value on kobuki2"),
        ({MODEL: "x", "/limits": ""}, {MODEL: "", "/limits": ""}, f"{MODEL} of kobuki1 is not on kobuki2"),
    ],
)
def test_copied_parameters_are_compared(here, there, found):
    def change(seen):
        _with_parameters(seen, here, there)

    fleet = plan(exports=GIVES)
    if not found:
        assert not [row for row in notable(evaluate(change, fleet)).values() if row.check == "copies"]
        return
    assert_told(change, "copies", FAILED, "parameter", "kobuki1 and kobuki2", "copy", fleet=fleet)
    (entry,) = diagnosed(change, fleet).findings
    assert found in entry.sentence()
    deleted = MODEL if "another value" in found else "<parameter>"
    assert entry.do[0].text == f"for name in {deleted}; do rosparam delete $name; done"


def test_parameters_that_were_not_read_are_not_judged():
    rows = [row for row in notable(evaluate(fleet=plan(exports=GIVES))).values() if row.check == "copies"]
    assert [(row.verdict, row.target) for row in rows] == [(UNKNOWN, ONE)]


def test_thousands_of_common_names_are_told_in_seconds():
    """Two hostile robots may answer a hundred thousand. Each was a part that was compared with all others."""

    def change(seen):
        for computer in (ONE, TWO):
            component = seen[computer].probe.exchange
            common = [RegisteredService(f"/common/{number}", f"/node/{number}") for number in range(3000)]
            kinds = [topic(f"/kind/{number}", f"x/{computer}", ["/node/0"]) for number in range(3000)]
            update(component, services=[*component.services, *common], topics=[*component.topics, *kinds])

    began = time.process_time()
    found = diagnosed(change)
    assert time.process_time() - began < 5.0
    named = [component for entry in found.findings for component in (entry.component, *entry.also)]
    kinds = Counter((component.kind, component.mode) for component in named)
    assert kinds["registration", "twin"] == kinds["messages", "differ"] == MOST_COMPONENTS


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "10.9.8.7", "laptop7"])
def test_a_node_with_a_wrong_host_is_the_one_finding(host):
    """The refusal of the other robot, and the silence at the own one, follow from it."""
    (finding,) = diagnosed(_announces(host)).findings
    sentence = finding.sentence()
    assert mentions(sentence, TWO, "/kobuki2/base", host, "ROS_IP", "session-4.scope", "kobuki1")
    (shell,) = finding.do
    assert shell.where == TWO and shell.text.startswith("unset ROS_IP; ") and "session-4.scope" in shell.effect


def _silent(node="/kobuki2/base", outcome=Outcome.NO_ANSWER, tcp_outcome=Outcome.OPEN, host=TWO, **more):
    silence = SilentNode(node, host, "timed out", outcome, tcp_outcome)

    def change(seen):
        update(seen[TWO].probe.exchange, silent=[node], silences=[silence])
        update(seen[TWO].probe, **more)

    return change


@pytest.mark.parametrize(
    ("change", "component"),
    [
        (_silent(), ("node", TWO, "hung")),
        (_silent(host="192.168.1.2"), ("node", TWO, "hung")),
        (_silent(outcome=Outcome.REFUSED, tcp_outcome=Outcome.REFUSED), ("registration", TWO, "ghost")),
        (_silent("/master_sync"), ("sync", TWO, "hung")),
        # late is not never
        (_silent(pace=5.0), ("computer", TWO, "overloaded")),
        (_silent("/master_sync", pace=5.0), ("computer", TWO, "overloaded")),
        (_silent(pace=5.0, node_hosts=(NodeHost("", stopped=True),)), ("node", TWO, "hung")),
    ],
)
def test_a_node_that_does_not_answer_is_told_by_what_its_port_does(change, component):
    (finding,) = diagnosed(change).findings
    assert finding.component[:3] == component and finding.verdict == WARNING


def test_a_process_with_a_roscore_of_no_robot_is_told():
    unit = {"unit": "odom.service", "starter": "unit", "of_unit": True}
    process = NodeHost(TWO, "ROS_HOSTNAME", ports=(4, 5), node="odom", master="http://old-pc:11311/", **unit)
    (finding,) = diagnosed(lambda seen: update(seen[TWO].probe, node_hosts=[process])).findings
    assert finding.component[:3] == ("node", TWO, "master") and finding.verdict == WARNING
    assert mentions(finding.sentence(), "roscore", "http://old-pc:11311/", "ROS_MASTER_URI", "odom.service")
    (command,) = [one.text for one in finding.do]
    assert "systemctl restart odom.service" in command and "UnsetEnvironment" not in command


def _lone(pid, node="driver.py", unknown=1, asked=1, **more):
    topics = ("/battery", "/imu")
    process = NodeHost(TWO, "ROS_HOSTNAME", "session-4.scope", (41233,), node, starter="shell", pid=pid, topics=topics)
    return UnregisteredNodes((replace(process, **more),), unknown, asked)


def test_a_node_that_is_registered_nowhere_is_told_with_its_process():
    (finding,) = diagnosed(lambda seen: update(seen[TWO].probe, unregistered=_lone(2314))).findings
    assert finding.component[:3] == ("node", TWO, "unregistered") and (finding.verdict, finding.sure) == (
        WARNING,
        "seen",
    )
    assert mentions(
        finding.sentence(), TWO, "no roscore", "driver.py (process 2314, publishes /battery, /imu, in session-4.scope)"
    )


def test_that_only_some_processes_were_asked_is_said():
    rows = evaluate(lambda seen: update(seen[TWO].probe, unregistered=UnregisteredNodes((), 100, 34)))
    (row,) = [one for one in rows if (one.check, one.observer) == ("node_roscores", TWO)]
    assert row.verdict == OK and "34 of 100 processes were asked" in row.found


def test_a_node_at_the_roscore_of_another_robot_is_a_warning():
    """A tool of the operator may be there on purpose."""

    def change(seen):
        process = NodeHost(TWO, "ROS_HOSTNAME", "rviz.service", (41233,), "rviz", f"http://{ONE}:11311/", "unit")
        update(seen[TWO].probe, node_hosts=[process])
        own = seen[ONE].probe.exchange
        new = topic("/goal", "std_msgs/String", ["/rviz"])
        update(own, announced=[AnnouncedHost("/rviz", TWO, 41233)], topics=[*own.topics, new])

    (finding,) = diagnosed(change).findings
    assert finding.component[:3] == ("node", TWO, "robot") and finding.verdict == WARNING


def _unreached(*nodes, outcome=Outcome.NO_ANSWER):
    rows = tuple(UnreachedNode(node, TWO, 41000, "no answer", outcome) for node in nodes)
    return lambda seen: update(seen[ONE].probe.exchange, unreached=rows)


def test_a_node_behind_a_filter_of_its_own_is_named_with_its_computer():
    told = diagnosed(_unreached("/odom_pub", "/lidar"))
    assert components(told) == [("node", TWO, "fenced")]
    assert "/odom_pub" in told.findings[0].sentence() and "/lidar" in told.findings[0].sentence()


def test_a_node_behind_a_filter_that_its_own_roscore_does_not_reach_either_is_named_with_its_computer():
    """The talker there is heard, so the way and the other ports are fine."""

    def change(seen):
        silence = SilentNode("/odom_pub", "tibi-nav", "timed out", Outcome.NO_ANSWER, Outcome.NO_ANSWER, 41233)
        update(seen["tibi-visio"].probe.exchange, silent=("/odom_pub",), silences=(silence,))
        row = UnreachedNode("/odom_pub", "tibi-nav", 41233, "no answer", Outcome.NO_ANSWER)
        update(seen["dabo-nav"].probe.exchange, unreached=(row,))

    (finding,) = diagnosed(change, fig12()).findings
    assert finding.component[:3] == ("node", "tibi-nav", "fenced") and "/odom_pub" in finding.sentence()


@pytest.mark.parametrize(
    ("ports", "named"),
    [((41233, 41233), ("filter", "tibi-nav", "nodes in")), ((9, 9), ("registration", "tibi-visio", "ghost"))],
)
def test_a_node_whose_port_a_packet_filter_refuses_has_not_ended(ports, named):
    def change(seen):
        silence = SilentNode("/odom_pub", "tibi-nav", "Connection refused", Outcome.REFUSED, Outcome.REFUSED, 41233)
        update(seen["tibi-visio"].probe.exchange, silent=("/odom_pub",), silences=(silence,))
        rule = FilterRule("reject", protocol="tcp", ports=ports, chain="input")
        chain = FilterChain("input", "inet own", "accept", (rule,), 0)
        update(seen["tibi-nav"], filters=FilterChains(True, (chain,)))

    (finding,) = diagnosed(change, fig12()).findings
    assert finding.component[:3] == named


def test_a_node_that_refuses_has_ended_and_is_told_at_its_own_roscore():
    assert not diagnosed(_unreached("/odom_pub", outcome=Outcome.REFUSED)).findings


def test_a_node_that_does_not_answer_at_home_either_is_told_there():
    def change(seen):
        _unreached("/odom_pub")(seen)
        silent = (SilentNode("/odom_pub", TWO, "timed out", Outcome.NO_ANSWER, Outcome.OPEN),)
        update(seen[TWO].probe.exchange, silent=("/odom_pub",), silences=silent)

    assert components(diagnosed(change)) == [("node", TWO, "hung")]
