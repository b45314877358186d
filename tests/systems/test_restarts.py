# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""After any end of a program of the collection, clients of each kind hear again, on the computer of the roscore and on another one.

The clients: rospy, roscpp (topic_tools' relay) and rosbag; topics of rospy's and roscpp's publishers, by the relay and by sync,
and calls of a service. All times are of the kernel's steady clock, which the containers share.
"""

import time

import pytest
from machines.podman import ROOT
from setups.links import wait_until

INVENTORY = ROOT / "tests" / "systems" / "restarts"
ROBOT, STATION, DESK = "kobuki1-pc", "station-pc", "station-desk"
LISTENING = (STATION, DESK)
LIMIT = 2.0  # seconds
#: topics at the station: of rospy and of roscpp, by the relay and by sync, and what roscpp passes on of them
TOPICS = ("/kobuki1/scan", "/kobuki1/cpp", "/direct/scan", "/direct/cpp", "/relayed", "/relayed_cpp", "/relayed_direct")
RELAYS = {"/relayed": "/kobuki1/scan", "/relayed_cpp": "/kobuki1/cpp", "/relayed_direct": "/direct/cpp"}
READ_BAG = """import rosbag, time
ahead = time.time() - time.monotonic()
for topic, _message, at in rosbag.Bag("/tmp/restarts.bag").read_messages():
    print(f"{at.to_sec() - ahead:.3f} {topic}")"""


def name_of(host, topic):
    """The topic, of which there is one for each computer where the station itself publishes it."""
    return f"{topic}_{host.replace('-', '_')}" if topic in RELAYS else topic


@pytest.fixture(scope="module")
def lab(new_lab):
    with new_lab("systems-restarts", INVENTORY, {}) as found:
        status, output = found.play("site.yml")
        assert status == 0, output
        start(found, ROBOT)
        for host in LISTENING:
            start(found, host)
        yield found


def start(lab, host):
    """Start the nodes of a computer, and wait until all is heard."""
    if host == ROBOT:
        lab.start(host, "steady", "python3 {script} /scan /direct/scan /raw", "programs/steady.py")
        for topic in ("/cpp", "/direct/cpp"):
            lab.start(
                host,
                f"relay{topic.replace('/', '-')}",
                f"rosrun topic_tools relay /raw {topic} __name:=relay{topic.replace('/', '_')}",
            )
        return
    for topic, source in RELAYS.items():
        there = name_of(host, topic)
        lab.start(
            host,
            f"relay{topic.replace('/', '-')}",
            f"rosrun topic_tools relay {source} {there} __name:=relay{there.replace('/', '_')}",
        )
    topics = " ".join(name_of(host, topic) for topic in TOPICS)
    lab.start(host, "arrivals", f"python3 {{script}} /kobuki1/reset {topics} /kobuki1/map", "observers/arrivals.py")
    heard = {*(name_of(host, topic) for topic in TOPICS), "service", "/kobuki1/map"}
    wait_until(lambda: {text for _at, text in lab.output(host, "arrivals")} >= heard, 60, f"{host} hears all")


def record(lab, host):
    """Start rosbag, as a person would."""
    lab.run(host, "rm -f /tmp/restarts.bag*")
    words = f"rosbag record -O /tmp/restarts.bag /kobuki1/scan /direct/cpp __name:=record_{host.replace('-', '_')}"
    lab.start(host, "record", words)
    wait_until(lambda: lab.run(host, "ls /tmp/restarts.bag.active", check=False), 30, "it records")
    time.sleep(3)


def read_bag(lab, host):
    """(time, topic) of the messages in the bag."""
    lab.run(host, "systemctl kill --signal=INT record; while systemctl -q is-active record; do sleep 0.1; done")
    lines = lab.run(host, "python3 -", stdin=READ_BAG).splitlines()
    return [(float(at), f"bag of {topic}") for at, _space, topic in (line.partition(" ") for line in lines)]


def find_gaps(arrivals, names, since, until):
    """The longest silence of each name."""
    times = {
        name: [since, *(at for at, text in arrivals if text == name and since < at < until), until] for name in names
    }
    return {name: max(after - before for before, after in zip(these, these[1:])) for name, these in times.items()}


#: the end of a program, and for how many seconds it is away by it
ENDS = {
    "killed": ("systemctl kill --signal=KILL {unit}", 0.0),
    "crashed": ("systemctl kill --signal=SEGV {unit}", 0.0),
    "ended by the watchdog": ("systemctl kill --signal=ABRT {unit}", 0.0),
    "restarted": ("systemctl restart {unit}", 0.0),
    "stopped and started": ("systemctl stop {unit}; sleep 3; systemctl start {unit}", 3.0),
}


@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize("program", ["relay", "roscore", "discovery", "sync"])
@pytest.mark.parametrize("host", [ROBOT, STATION])
def test_all_clients_hear_again_after_an_end(lab, slack, host, program, end):
    command, away = ENDS[end]
    for listening in LISTENING:
        record(lab, listening)
    began = time.monotonic()
    lab.run(host, command.format(unit=f"multimaster-{program}"))
    time.sleep(max(8.0, 8.0 - time.monotonic() + began))
    until, longest = time.monotonic(), {}
    for listening in LISTENING:
        arrivals = lab.output(listening, "arrivals") + read_bag(lab, listening)
        names = [
            *(name_of(listening, topic) for topic in TOPICS),
            "service",
            "bag of /kobuki1/scan",
            "bag of /direct/cpp",
        ]
        longest.update({(listening, name): gap for name, gap in find_gaps(arrivals, names, began - 1.0, until).items()})
        if program == "relay":
            assert any(text == "/kobuki1/map" and at > began for at, text in arrivals), "what was latched comes again"
    (where, what), gap = max(longest.items(), key=lambda item: item[1])
    print(f"{program} on {host} {end}: at most {gap:.2f} s without {what} on {where}")
    assert gap <= LIMIT + away + slack(began), longest


def find_processes(lab):
    """The number of the process of each service, by computer."""
    look = "systemctl show -P MainPID multimaster-$unit"
    units = ("roscore", "discovery", "connections", "sync", "watchdog", "relay")
    return {(host, unit): lab.run(host, f"unit={unit}; {look}").strip() for host in (ROBOT, STATION) for unit in units}


def test_a_change_of_a_rate_restarts_the_relays_alone(lab, tmp_path):
    (tmp_path / "group_vars").mkdir()
    changed = (INVENTORY / "group_vars/kobuki1.yml").read_text().replace("as: /kobuki1", "rate: 10, as: /kobuki1")
    changed = changed.replace(", services: [/reset]", "")
    assert "rate: 10" in changed
    (tmp_path / "group_vars/kobuki1.yml").write_text(changed + "  - {services: [/reset], as: /kobuki1}\n")
    (tmp_path / "hosts.yml").write_text("robots: {children: {kobuki1: {}}}\n")
    before = find_processes(lab)
    status, output = lab.play("site.yml", "--check", "-i", str(tmp_path / "hosts.yml"))
    assert status == 0 and output.count("would restart multimaster-relay, since its parameters change") == 2, output
    assert output.count("would restart") == 2 and find_processes(lab) == before
    status, output = lab.play("site.yml", "-i", str(tmp_path / "hosts.yml"))
    assert status == 0 and output.count("restarted multimaster-relay, since its parameters change") == 2, output
    after = find_processes(lab)
    assert {unit for (host, unit), process in after.items() if process != before[host, unit]} == {"relay"}


@pytest.mark.parametrize("words", [("kill", "--signal=KILL"), ("stop", "--time=10")], ids=["power_lost", "shut_down"])
def test_clients_elsewhere_hear_again_after_a_boot(lab, slack, words):
    """The clients on another computer of the station. A computer that loses its power ends no connection."""
    lab.podman(*words, STATION)
    lab.podman("start", STATION)
    began = time.monotonic()
    active = "systemctl show -P ActiveEnterTimestampMonotonic multimaster-relay"
    back = int(wait_until(lambda: int(lab.run(STATION, active, check=False) or 0), 60, "the relay runs")) / 1e6
    time.sleep(8)
    arrivals, until = lab.output(DESK, "arrivals"), time.monotonic()
    gaps = find_gaps(arrivals, [name_of(DESK, topic) for topic in TOPICS], back, until)
    print(f"after its boot: at most {max(gaps.values()):.2f} s without {max(gaps, key=gaps.get)} on {DESK}")
    assert max(gaps.values()) <= LIMIT + slack(began), gaps
    start(lab, STATION)
