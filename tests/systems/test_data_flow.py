# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Declared data flow between three robots: what flows works, what does not flow is neither imported nor served."""

import json
import re
import time

import pytest
from setups.links import Watch, wait_until
from subject import NODES, three_robots

NAME = "systems-data-flow"
ROBOTS = ("ana", "bob", "cid")
ADDRESSES = {"ana": "192.168.20.21", "bob": "192.168.20.22", "cid": "192.168.20.23", "a stranger": "192.168.20.99"}
# ana and cid have nothing to do with each other, but both exchange /shared with bob.
EXPORTS = {
    "ana": [
        {"topics": ["/ana/pose"], "services": ["/ana_server/where"], "actions": ["/ana_action/double"], "to": ["bob"]},
        {"topics": ["/shared"], "to": ["bob"]},
        {"parameters": ["/ana/model", "/limits", "/taken"], "to": ["bob", "cid"]},
    ],
    "bob": [{"topics": ["/shared", "/mixed"], "to": ["ana", "cid"]}],
    "cid": [{"topics": ["/shared", "/cid/pose"], "to": ["bob"]}],
}
# What each robot's chatter publishes and hears; what is of another robot is heard where it flows, and nowhere else.
HEARD = ("/ana/pose", "/bob/pose", "/cid/pose", "/shared", "/secret")
EXPECTED = {
    "ana": {"/ana/pose": "a", "/shared": "ab", "/secret": "a"},
    "bob": {"/ana/pose": "a", "/bob/pose": "b", "/cid/pose": "c", "/shared": "abc", "/secret": "b"},
    "cid": {"/cid/pose": "c", "/shared": "bc", "/secret": "c"},
}
GOALS = {"/ana_action/double/goal", "/ana_action/double/cancel"}
IMPORTED = {
    "ana": {"/shared"} | GOALS,
    "bob": {"/ana/pose", "/shared", "/cid/pose", "/ana_server/where"}
    | {f"/ana_action/double/{part}" for part in ("status", "feedback", "result")},
    "cid": {"/shared"},
}


def apply(lab, folder, playbook="site.yml", **variables):
    """Run a playbook with more variables of robots."""
    path = folder / "more.json"
    children = {robot: {"vars": own} for robot, own in variables.items()}
    path.write_text(json.dumps({"robots": {"children": children}}))
    return lab.play(playbook, "-i", str(path))


@pytest.fixture(scope="module")
def lab():
    with three_robots(NAME) as found:
        yield found


@pytest.fixture(scope="module")
def declared(lab, tmp_path_factory):
    """The exports in force, and ordinary nodes on all robots."""
    exports = {robot: {"multimaster_exports": own} for robot, own in EXPORTS.items()}
    status, output = apply(lab, tmp_path_factory.mktemp("exports"), **exports)
    assert status == 0, output
    for robot in ("bob", "cid"):
        lab.run(f"{robot}-pc", "rosparam set /taken own")
    lab.run(
        "ana-pc",
        """rosparam set /ana/model "<robot name='ana'/>"; rosparam set /limits "{speed: 1.5, axes: [1, 2]}" """,
    )
    lab.run("ana-pc", "rosparam set /taken other")
    lab.start("ana-pc", "server", "python3 {script} ana_server", "programs/service_server.py")
    lab.start("ana-pc", "action", "python3 {script} ana_action", "programs/action_server.py")
    for robot in ROBOTS:
        topics = " ".join([f"+/{robot}/pose", "+/shared", "+/secret", *HEARD])
        lab.start(f"{robot}-pc", "chatter", f"python3 {{script}} {robot}_chatter {topics}", "programs/chatter.py")
    mixed(lab)
    return lab


def mixed(lab):
    """ana's roscpp subscriber of /mixed has a publisher on its own robot; more of them are on bob."""
    lab.start("ana-pc", "relay", "rosrun topic_tools relay /mixed /ana/relayed __name:=ana_relay")
    lab.start("ana-pc", "mixer", "python3 {script} ana_mixer +/mixed /ana/relayed", "programs/chatter.py")


def heard(lab, robot, since):
    """topic -> the robots, by their initials, whose messages came."""
    found = {}
    for at, text in lab.output(f"{robot}-pc", "chatter"):
        topic, node = text.split()
        if at > since:
            found.setdefault(topic, set()).add(node[1])
    return {topic: "".join(sorted(robots)) for topic, robots in found.items()}


def test_what_is_declared_arrives_and_nothing_else(declared):
    since = time.monotonic()
    wait_until(
        lambda: {robot: heard(declared, robot, since) for robot in ROBOTS} == EXPECTED, 60, "all hear what flows"
    )
    time.sleep(3)
    assert {robot: heard(declared, robot, since) for robot in ROBOTS} == EXPECTED


def test_a_service_and_an_action_work(declared):
    assert "ana-pc" in declared.run("bob-pc", "rosservice call /ana_server/where")
    client = (NODES / "programs/action_client.py").read_text()
    seen = declared.run("bob-pc", "timeout 100 python3 - /ana_action/double __name:=bob_client", stdin=client)
    assert seen.split() in (["1", "42"], ["2", "42"], ["3", "42"])


@pytest.mark.parametrize("robot", ROBOTS)
def test_the_roscore_holds_what_was_declared_and_nothing_else(declared, robot):
    held = [item.split() for item in Watch(declared, f"{robot}-pc").registrations()]
    foreign = [item for item in held if re.match(r"/(ana|bob|cid)_", item[2]) and not item[2].startswith(f"/{robot}_")]
    assert {name for _kind, name, _node in foreign} - GOALS == IMPORTED[robot] - GOALS  # the client has gone
    assert {kind for kind, _name, _node in foreign} <= {"publisher", "service"}


ASK = """
import http.client, json, sys, xmlrpc.client

class From(xmlrpc.client.Transport):
    def make_connection(self, host):
        return http.client.HTTPConnection(host, source_address=(sys.argv[2], 0))

server = xmlrpc.client.ServerProxy("http://%s:11611" % sys.argv[1], From())
print(json.dumps([
    server.masterInfo(), server.masterInfoFiltered([False] + [""] * 10), server.getTopicsMd5sum(["std_msgs/Int32"])
]))
"""


def told(lab, robot, caller):
    """The answers of a robot's discovery to a caller: the two documents, and the md5 sums."""
    here = "cid" if caller == "a stranger" else caller
    return json.loads(lab.run(f"{here}-pc", f"python3 - {ADDRESSES[robot]} {ADDRESSES[caller]}", stdin=ASK))


def test_what_is_not_exported_is_not_served(declared):
    """Whatever the caller asks with, its address decides."""
    declared.run("cid-pc", "ip address replace 192.168.20.99/24 dev eth0")
    masters, filtered, md5s = told(declared, "ana", "cid")  # ana exports nothing to it, and names nothing to it
    for document in (masters, filtered):
        assert document[3] == "ana-pc" and document[4:] == [[], [], [], [], [], []]
    assert md5s == []
    with pytest.raises(AssertionError, match="RemoteDisconnected|ConnectionReset|BrokenPipe"):  # who is in no inventory
        told(declared, "ana", "a stranger")
    declared.run("cid-pc", "ip address del 192.168.20.99/24 dev eth0")
    for document in told(declared, "ana", "bob")[:2]:
        publishers, subscribers, services = (dict(part) for part in document[4:7])
        assert set(publishers) - GOALS == {
            name for name in IMPORTED["bob"] if "cid" not in name and "server" not in name
        }
        assert (set(services), subscribers) == ({"/ana_server/where"}, {})
        assert set(sum([*publishers.values(), *services.values()], [])) <= {
            "/ana_chatter",
            "/ana_server",
            "/ana_action",
        }
    own = told(declared, "ana", "ana")[0]
    assert {"/secret", "/ana/pose", "/shared"} <= set(dict(own[4])) & set(dict(own[5]))


def parameter(lab, robot, name):
    """A parameter of a robot's roscore; an error where it is not set."""
    return lab.run(f"{robot}-pc", f"rosparam get {name} 2>&1 || true").strip()


def test_parameters_cross_and_follow_and_go(declared):
    """bob has the managed roscore, cid that of ROS."""
    copied = {"/ana/model": "<robot name='ana'/>", "/limits/speed": "1.5"}
    for robot in ("bob", "cid"):
        wait_until(
            lambda robot=robot: all(text in parameter(declared, robot, name) for name, text in copied.items()),
            30,
            f"{robot} has the parameters of ana",
        )
        assert parameter(declared, robot, "/taken") == "own"
        assert "/taken" in declared.run(f"{robot}-pc", "journalctl -u multimaster-sync | grep 'is not copied'")
    declared.run("ana-pc", "rosparam set /limits/speed 2.5; rosparam delete /ana/model")
    for robot in ("bob", "cid"):
        wait_until(lambda robot=robot: parameter(declared, robot, "/limits/speed") == "2.5", 30, "it changes")
        wait_until(lambda robot=robot: "not set" in parameter(declared, robot, "/ana/model"), 30, "it goes")


@pytest.mark.parametrize("robot", ["bob", "cid"])
def test_copied_parameters_survive_a_kill_and_go_at_the_end(declared, robot):
    computer, at = f"{robot}-pc", "systemctl show --value -p MainPID multimaster-sync"
    wait_until(lambda: parameter(declared, robot, "/limits/speed") == "2.5", 60, "it is there")
    before = declared.run(computer, at)
    declared.run(computer, "systemctl kill -s KILL multimaster-sync")
    wait_until(lambda: declared.run(computer, at) not in (before, "0\n"), 60, "it is started again")
    declared.run("ana-pc", "rosparam set /limits/speed 3.5")
    wait_until(lambda: parameter(declared, robot, "/limits/speed") == "3.5", 60, "it knows its copy")
    declared.run("ana-pc", "rosparam set /limits/speed 2.5")
    declared.run(computer, "systemctl stop multimaster-sync")
    assert "not set" in parameter(declared, robot, "/limits") and parameter(declared, robot, "/taken") == "own"
    declared.run(computer, "systemctl start multimaster-sync")
    wait_until(lambda: parameter(declared, robot, "/limits/speed") == "2.5", 60, "it is back")


def test_verify_names_a_parameter_that_differs(declared, tmp_path):
    exports = {robot: {"multimaster_exports": own} for robot, own in EXPORTS.items()}
    _status, output = apply(declared, tmp_path, "playbooks/verify.yml", **exports)
    for robot in ("bob", "cid"):
        assert f"/taken of ana has another value on {robot}" in output, output
        declared.run(f"{robot}-pc", "rosparam delete /taken")
    for robot in ("bob", "cid"):
        wait_until(lambda robot=robot: parameter(declared, robot, "/taken") == "other", 60, "the name is free")
    _status, output = apply(declared, tmp_path, "playbooks/verify.yml", **exports)
    assert "parameters that cross" not in output, output


BUS = """
import json, os, xmlrpc.client
call = lambda uri: xmlrpc.client.ServerProxy(uri)
roscore = call(os.environ["ROS_MASTER_URI"])
nodes = {node for part in roscore.getSystemState("/bus")[2] for _name, users in part for node in users}
uris = {node: roscore.lookupNode("/bus", node)[2] for node in nodes}
own = {node: uri for node, uri in uris.items() if os.uname().nodename in uri}
print(json.dumps({node: call(uri).getBusInfo("/bus")[2] for node, uri in own.items()}))
"""


@pytest.mark.parametrize(("here", "there"), [("ana", "cid"), ("cid", "ana")])
def test_no_cross_link(declared, here, there):
    """ana and cid have publishers and subscribers of /shared, as bob has, and no connection to each other."""
    info = json.loads(declared.run(f"{here}-pc", "python3 -", stdin=BUS))
    links = [(node, *entry[1:5]) for node, entries in info.items() for entry in entries]
    assert any(f"{here}_chatter" in str(link) and "bob" in str(link) for link in links)
    assert [link for link in links if re.search(rf"\b{there}[-_]", str(link))] == []


def without_differences(lab, host, words):
    """Switch the quick way of a robot's nodes off, or on again, until they are configured anew."""
    parameters = "/etc/rosfleet-multimaster/master_{sync,discovery}.json"
    lab.run(host, f"{words} {parameters} && systemctl restart multimaster-discovery multimaster-sync")


def test_declared_topics_arrive_alone_with_whole_states_too(declared):
    """As above, on the way that upstream takes: bob neither asks for differences nor tells any."""
    here = declared.run("bob-pc", "cp -a /etc/rosfleet-multimaster /root/kept; ss -tn state established dport = :11611")
    assert ":11611" in here, "bob waits for what is new"
    without_differences(declared, "bob-pc", "sed -i '0,/{/s//{\"differences\": false,/'")
    gone = "ss -Htn state established '( dport = :11611 or sport = :11611 )'"
    since = time.monotonic()
    wait_until(
        lambda: {robot: heard(declared, robot, since) for robot in ROBOTS} == EXPECTED, 60, "all hear what flows"
    )
    wait_until(lambda: not declared.run("bob-pc", gone), 20, "bob's connections have ended")
    test_the_roscore_holds_what_was_declared_and_nothing_else(declared, "bob")
    without_differences(declared, "bob-pc", "cp -a /root/kept/. /etc/rosfleet-multimaster/; ls")


def longest_gap(times, since, to):
    times = [since, *(at for at in times if since < at < to), to]
    return max(later - earlier for earlier, later in zip(times, times[1:]))


def keeps_its_local_publisher(lab, slack):
    """bob's publishers of /mixed come and go; ana's roscpp subscriber hears its own robot's all the time."""
    wait_until(lambda: lab.output("ana-pc", "mixer"), 60, "ana's relay hears ana's publisher")
    since = time.monotonic()
    for _time in range(4):
        lab.start("bob-pc", "mixer", "python3 {script} bob_mixer +/mixed", "programs/chatter.py")
        time.sleep(1.5)
    to = time.monotonic()
    times = [at for at, _text in lab.output("ana-pc", "mixer")]
    print(
        f"\nlongest gap {longest_gap(times, since, to):.2f} s, {sum(since < at < to for at in times) / (to - since):.0f} messages/s"
    )
    assert longest_gap(times, since, to) < 0.5 + slack(since)


def test_a_roscpp_subscriber_keeps_its_local_publisher(declared, slack):
    """/mixed flows from bob to ana alone, so bob's roscore does not know ana's publisher."""
    keeps_its_local_publisher(declared, slack)


@pytest.mark.parametrize(
    ("robot", "filters"), [("bob", {"ignore_publishers": ["/mixed"]}), ("ana", {"ignore_hosts": ["cid-pc"]})]
)
def test_a_roscpp_subscriber_keeps_its_publisher_beside_filters(lab, slack, tmp_path, robot, filters):
    status, output = apply(lab, tmp_path, **{robot: {"multimaster_filters": filters}})
    assert status == 0, output
    mixed(lab)
    keeps_its_local_publisher(lab, slack)


def test_a_meaningless_declaration_stops_before_any_change(lab, tmp_path):
    status, output = apply(lab, tmp_path, ana={"multimaster_exports": [{"topics": ["/ana/pose"], "to": ["bobb"]}]})
    assert status != 0
    assert "'bobb'" in output and "did you mean bob" in output, output
    assert re.search(r"ana-pc : ok=\d+ changed=[1-9]", output) is None, output
