# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Four robots of one kind and a station: the same nodes, topics and frames, told apart by the relay, on real systems.

rostopic, roscpp's relay, an actionlib client and tf2 at the station know nothing of it.
"""

import re
import time

import pytest
from machines.podman import ROOT
from proofs.proof import table
from proofs.twins import distinguish_twins
from setups.links import cut, repair, wait_until
from subject import NODES

INVENTORY = ROOT / "inventory" / "identical_robots"
ALL = {f"kobuki{number}": f"kobuki{number}-pc" for number in (1, 2, 3, 4)}
ONE, TWO, STATION = "kobuki1-pc", "kobuki2-pc", "station-pc"
TWINS = {"kobuki1": ONE, "kobuki2": TWO}
CAMERA = "/kobuki1/camera/image_raw/compressed"


@pytest.fixture(scope="module")
def lab(new_lab):
    """The robots after site.yml, with the same programs on each."""
    with new_lab("systems-relay", INVENTORY, {}) as found:
        status, output = found.play("site.yml")
        assert status == 0, output
        for host in ALL.values():
            start(found, host)
        wait_until(lambda: published(found) >= {f"/{robot}/scan" for robot in ALL}, 60, "all scans at the station")
        yield found


def start(lab, host):
    lab.start(host, "robot", "python3 {script}", "programs/twin_robot.py")


def published(lab, host=STATION):
    """The topics that somebody publishes there."""
    return set(re.findall(r"^ \* (\S+) \[.*\] \d+ publisher", lab.run(host, "rostopic list -v", check=False), re.M))


def hear(lab, topic, number=1, host=STATION, seconds=20):
    """The texts of messages."""
    said = lab.run(host, f"timeout -k 5 {seconds} rostopic echo -n {number} -p {topic}", check=False)
    return [line.partition(",")[2] for line in said.splitlines()[1:]]


def verify(lab):
    return lab.play("playbooks/verify.yml")


def test_the_same_topics_of_two_robots_are_told_apart(lab):
    for robot, host in TWINS.items():
        assert set(hear(lab, f"/{robot}/scan", 3)) == {f"scan of {host}"}
        assert hear(lab, f"/{robot}/map") == [f"map of {host}"] == hear(lab, f"/{robot}/map"), (
            "latched, for each who comes"
        )
    assert not published(lab) & {"/scan", "/map", "/odom"}
    info = lab.run(STATION, "rostopic info /kobuki1/scan")
    assert "Type: std_msgs/String" in info and "* /master_relay (http://station-pc:" in info


def test_what_is_meant_for_one_robot_comes_to_it_alone(lab):
    for robot, host in TWINS.items():
        other = next(name for name in TWINS.values() if name != host)
        before = len(lab.output(other, "robot"))
        lab.run(STATION, f"timeout -k 5 6 rostopic pub -r 5 /{robot}/cmd_vel std_msgs/String 'to {robot}'", check=False)
        heard = [text for _at, text in lab.output(host, "robot")]
        assert heard.count(f"to {robot}") > 10, heard[-5:]
        assert len(lab.output(other, "robot")) == before
    wait_until(lambda: "/cmd_vel" not in published(lab, ONE), 20, "nobody publishes it any more")


def test_what_is_played_again_at_the_station_stays_there(lab):
    """As rosbag play does with a bag of the robot: old scans under the robot's names, an old map, and its own tree of frames."""
    before = lab.run(ONE, "rostopic info /scan")
    for number, (topic, kind) in enumerate(
        {"scan": "std_msgs/String", "map": "std_msgs/String", "odom": "geometry_msgs/PoseStamped"}.items()
    ):
        lab.start(STATION, f"player{number}", f"rostopic pub -r 10 /kobuki1/{topic} {kind}")
    lab.start(STATION, "player-tf", "rostopic pub -r 10 /tf tf2_msgs/TFMessage")
    wait_until(lambda: "/rostopic_" in lab.run(STATION, "rostopic info /kobuki1/scan"), 30, "it is played")
    assert set(hear(lab, "/scan", 40, ONE, 30)) == {f"scan of {ONE}"}
    assert lab.run(ONE, "rostopic info /scan") == before and "/master_relay" not in before
    assert not published(lab, ONE) & {f"/kobuki1/{topic}" for topic in ("scan", "map", "odom")}
    for topic in ("/tf", "/map", "/odom"):
        assert "/master_relay" not in lab.run(ONE, f"rostopic info {topic}").partition("Subscribers")[0]
    for name in ("player0", "player1", "player2", "player-tf"):
        lab.stop(STATION, name)


def test_all_of_four_robots_is_told_apart(lab):
    results = list(distinguish_twins({robot: lab.computer(host) for robot, host in ALL.items()}, lab.computer(STATION)))
    assert len(results) == 8 * len(ALL) + 1 and all(result.ok for result in results), table(results)
    assert not {"/reset", "/robot_description"} & set(lab.run(STATION, "rosservice list; rosparam list").split())


@pytest.mark.parametrize(
    ("frame", "there"), [("world", "map"), ("kobuki1/odom", "odom"), ("kobuki2/odom", ""), ("map", "")]
)
def test_a_goal_comes_in_a_frame_of_its_robot(lab, frame, there):
    before = len(lab.output(ONE, "robot"))
    goal = (
        f"timeout -k 5 5 rostopic pub -r 2 /kobuki1/goal geometry_msgs/PoseStamped '{{header: {{frame_id: {frame}}}}}'"
    )
    lab.run(STATION, goal, check=False)
    heard = {text for _at, text in lab.output(ONE, "robot")[before:]}
    assert heard == ({f"goal in {there}"} if there else set())


def test_a_node_of_roscpp_notices_nothing(lab):
    lab.start(STATION, "topic-tools", "rosrun topic_tools relay /kobuki2/scan /relayed __name:=station_relay")
    wait_until(lambda: hear(lab, "/relayed", seconds=5) == [f"scan of {TWO}"], 40, "the node of topic_tools hears it")


def test_a_rate_is_kept_before_the_link(lab):
    said = lab.run(STATION, f"timeout -k 5 12 rostopic hz {CAMERA}", check=False)
    rates = [float(text) for text in re.findall(r"average rate: ([0-9.]+)", said)]
    assert rates and 4.0 <= rates[-1] <= 5.3, said


def received(lab, address):
    """The bytes that the relay of the station has received from another one, as the kernel counts them, and when, in seconds."""
    said, uptime = lab.run(STATION, "ss -Htnpi state established; echo; cat /proc/uptime").rsplit("\n\n", 1)
    lines = said.replace("\n\t", " ").splitlines()
    counts = [re.search(r"bytes_received:(\d+)", line) for line in lines if f"{address}:" in line.split()[3]]
    return sum(int(found[1]) for found in counts if found), float(uptime.split()[0])


def test_five_listeners_cost_as_much_as_one(lab):
    def measure(count):
        """Bytes a second."""
        names = [f"listener{number}" for number in range(count)]
        for name in names:
            lab.start(STATION, name, f"rostopic echo {CAMERA}")
        for name in names:
            wait_until(lambda name=name: ONE in lab.run(STATION, f"cat /run/{name}.out"), 30, "all listen")
        before, began = received(lab, "192.168.1.11")
        time.sleep(8)
        after, ended = received(lab, "192.168.1.11")
        for name in names:
            lab.stop(STATION, name)
        time.sleep(2)
        return (after - before) / (ended - began)

    one, five = measure(1), measure(5)
    idle = measure(0)
    print(f"bytes a second: {one:.0f} for one listener, {five:.0f} for five, {idle:.0f} for none")
    assert one > 20000 and five < 1.1 * one and idle < one / 10


def test_what_crosses_is_told(lab):
    def look():
        said = lab.run(STATION, "timeout -k 5 8 rostopic echo -n 6 /diagnostics", check=False)
        return said if "multimaster: relay" in said else ""

    said = wait_until(look, 40, "its entry")
    assert "4 of 4 robots answer" in said and f'key: "{CAMERA}"' in said, said


def test_verify_passes_and_a_second_run_changes_nothing(lab):
    status, output = verify(lab)
    assert status == 0 and "PASSED" in output, output
    status, output = lab.play("site.yml")
    assert status == 0 and not re.search(r"changed=[1-9]", output), output


def test_a_relay_that_was_killed_is_back(lab):
    for host in (ONE, STATION):
        lab.run(host, "systemctl kill --signal=KILL multimaster-relay")
        began = time.monotonic()
        wait_until(lambda: hear(lab, "/kobuki1/scan", seconds=5) == [f"scan of {ONE}"], 30, "its scan again")
        print(f"{host}: after {time.monotonic() - began:.1f} s, rostopic's own start among them")
    assert lab.run(ONE, "systemctl show -p NRestarts --value multimaster-sync").strip() == "0"


def test_a_robot_is_cut_off_and_comes_back(lab):
    began = cut(lab, TWO)
    wait_until(lambda: "/kobuki2/scan" not in published(lab), 40, "its topics are withdrawn")
    gone = time.monotonic() - began
    assert hear(lab, "/kobuki1/scan") == [f"scan of {ONE}"], "the other robot is heard as before"
    began = repair(lab, TWO)
    wait_until(lambda: hear(lab, "/kobuki2/scan", seconds=5) == [f"scan of {TWO}"], 40, "its scan again")
    print(f"withdrawn after {gone:.1f} s, back after {time.monotonic() - began:.1f} s, rostopic's start among them")


def test_a_node_that_was_killed_and_started_again_is_heard(lab):
    """The same node at another port: whoever listens at the station goes on listening."""
    lab.start(STATION, "listener", "rostopic echo /kobuki1/scan")
    wait_until(lambda: ONE in lab.run(STATION, "cat /run/listener.out"), 30, "it is heard")
    lab.run(ONE, "systemctl kill --signal=KILL robot")
    start(lab, ONE)
    lab.run(STATION, "truncate --size 0 /run/listener.out")
    wait_until(lambda: ONE in lab.run(STATION, "cat /run/listener.out"), 30, "it is heard again")
    lab.stop(STATION, "listener")


def test_a_robot_that_was_restarted_is_back(lab):
    lab.reboot(TWO)
    lab.wait_until_up(TWO)
    start(lab, TWO)
    wait_until(lambda: hear(lab, "/kobuki2/map", seconds=5) == [f"map of {TWO}"], 60, "its map again")


@pytest.mark.parametrize(
    "fault",
    [
        f"systemctl stop multimaster-relay|{ONE}",
        f"systemctl stop multimaster-relay|{STATION}",
        f"systemctl kill --signal=STOP multimaster-relay|{TWO}",
    ],
)
def test_a_relay_that_does_not_run_is_named(lab, fault):
    command, _bar, host = fault.partition("|")
    lab.run(host, command)
    try:
        status, output = verify(lab)
        assert status != 0 and "relay" in output.partition("Findings:")[2], output
        assert host in output.partition("Findings: 1.")[2].partition("\n")[0] or "multimaster-relay" in output, output
    finally:
        lab.run(host, "systemctl kill --signal=CONT multimaster-relay", check=False)
        lab.run(host, "systemctl restart multimaster-relay")
    wait_until(lambda: published(lab) >= {f"/{robot}/scan" for robot in TWINS}, 30, "both scans again")


def test_a_robot_has_another_name_from_now_on(lab, tmp_path):
    (tmp_path / "group_vars").mkdir()
    (tmp_path / "group_vars/kobuki2.yml").write_text("robot: scout\n")
    (tmp_path / "hosts.yml").write_text("robots: {children: {kobuki2: {}}}\n")
    again = ("site.yml", "-i", str(tmp_path / "hosts.yml"))
    status, output = lab.play(*again)
    assert status != 0 and "that of station does not give /scout/cmd_vel to kobuki2" in output, output
    given = (INVENTORY / "group_vars/station.yml").read_text().replace("/kobuki2/", "/scout/")
    (tmp_path / "group_vars/station.yml").write_text(given)
    status, output = lab.play(*again)
    assert status == 0, output
    wait_until(lambda: hear(lab, "/scout/map", seconds=5) == [f"map of {TWO}"], 60, "its map by the new name")
    wait_until(lambda: not any("/kobuki2/" in topic for topic in published(lab)), 30, "nothing has the old name")
    said = lab.run(STATION, "python3 - world scout/laser kobuki2/laser", stdin=(NODES / "programs/tree.py").read_text())
    assert said.split() == ["scout/laser=2.0", "kobuki2/laser=not", "there"]


def expect_no_relay(lab):
    for host in (*ALL.values(), STATION):
        assert lab.run(host, "systemctl list-units --all --plain --no-legend 'multimaster-relay*'").strip() == ""
        assert "master_relay" not in lab.run(host, "ls /etc/rosfleet-multimaster 2> /dev/null; ps -e -o args")


def test_without_the_entries_nothing_of_it_is_left(lab):
    status, output = lab.play("site.yml", "-e", '{"multimaster_exports": []}')
    assert status == 0, output
    expect_no_relay(lab)
    assert "/master_relay" not in lab.run(STATION, "rosnode list")


def test_nothing_of_it_is_left_after_the_teardown(lab):
    for playbook in ("site.yml", "playbooks/teardown.yml"):
        status, output = lab.play(playbook)
        assert status == 0, output
    expect_no_relay(lab)
