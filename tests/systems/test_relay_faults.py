# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Data through the relays of a robot and a station, with one fault each: verify names its component first, and leaves nothing unexplained.

The robot's topics are a scan and a latched map. Registrations are as they should be in all but one of these cases.
"""

import json

import pytest
from machines.podman import ROOT
from setups.links import wait_until

INVENTORY = ROOT / "tests" / "systems" / "relay_pair"
NAME = "systems-relay-faults"
ROBOT, STATION = "kobuki1-pc", "station-pc"
UNIT = "multimaster-relay"
# The port of the robot's data, as its relay tells that of the station.
DATA = """
import json, xmlrpc.client
(channel, *_more) = json.load(open("/etc/rosfleet-multimaster/master_relay.json"))["channels"]
place = "http://{}:{}/".format(channel["hosts"][0], channel["port"])
print(xmlrpc.client.ServerProxy(place).rosfleetOffers("station", "", 0.0)[1])
"""
# A node that says its type when it starts. rostopic waits for the first publisher and takes its type, so no other one would differ.
DRIVE = (
    'python3 -c "import rospy, std_msgs.msg; rospy.init_node(\\"drive\\"); '
    'rospy.Subscriber(\\"/cmd_vel\\", std_msgs.msg.String); rospy.spin()"'
)


@pytest.fixture(scope="module")
def lab(new_lab):
    """Both computers after site.yml, with nodes that publish at the robot and hear what comes back."""
    with new_lab(NAME, INVENTORY, {}) as found:
        status, output = found.play("site.yml")
        assert status == 0, output
        found.start(ROBOT, "scan", "rostopic pub -r 5 /scan std_msgs/String here")
        found.start(ROBOT, "map", "rostopic pub -l /map std_msgs/String map")
        found.start(ROBOT, "drive", DRIVE)
        wait_until(
            lambda: set(found.run(STATION, "rostopic list").split()) >= {"/kobuki1/scan", "/kobuki1/map"},
            60,
            "both topics",
        )
        yield found


def verify(lab):
    """Run verify.yml; return its status and its report."""
    status, output = lab.play("playbooks/verify.yml")
    path = ROOT / ".work" / "reports" / f"{NAME}.json"
    assert path.exists(), output
    report = json.loads(path.read_text())
    path.unlink()
    return status, report


def find_port(lab):
    """Return the TCP port of the robot's data."""
    return int(lab.run(STATION, "python3 -", stdin=DATA))


def test_data_is_heard_through_both_relays(lab):
    status, report = verify(lab)
    assert (status, report["findings"], report["unexplained"]) == (0, [], [])


FAULTS = {
    # registrations cross by another port
    "data port closed": (
        ROBOT,
        "nft 'table inet fault { chain one { type filter hook input priority filter; iifname eth0 tcp dport PORT drop; }; }'",
        "nft delete table inet fault",
        {("node", "fenced"), ("filter", "nodes in")},
        ROBOT,
    ),
    # verify reaches the other relay, and the relay of the station does not
    "relay kept from data": (
        STATION,
        f'nft "table inet fault {{ chain one {{ type filter hook output priority filter; meta skuid $(stat -c %u /proc/$(systemctl show -P MainPID {UNIT})) '
        'ip daddr 192.168.21.11 tcp dport PORT drop; }; }"; ss -K dst 192.168.21.11 dport = PORT >/dev/null; systemctl restart multimaster-relay',
        "nft delete table inet fault",
        {("relay", "mute")},
        STATION,
    ),
    "relay stopped": (ROBOT, f"systemctl stop {UNIT}", f"systemctl start {UNIT}", {("service", "down")}, ROBOT),
    "relay frozen": (
        ROBOT,
        f"systemctl kill --signal=STOP {UNIT}",
        f"systemctl kill --signal=CONT {UNIT}; systemctl restart {UNIT}",
        {("service", "stopped")},
        ROBOT,
    ),
    "an entry on one side alone": (
        ROBOT,
        'cp -p /etc/rosfleet-multimaster/master_relay.json /run/fault.json; sed -i \'s#"/map"#"/no_map"#\' '
        f"/etc/rosfleet-multimaster/master_relay.json; systemctl restart {UNIT}",
        f"cp -p /run/fault.json /etc/rosfleet-multimaster/master_relay.json; systemctl restart {UNIT}",
        {("relay", "configuration")},
        ROBOT,
    ),
    "another type at the station": (
        STATION,
        "systemd-run --quiet --collect --unit fault-drive bash -lc 'exec rostopic pub -r 2 /kobuki1/cmd_vel std_msgs/Int32 1'; "
        "until rostopic list | grep -qx /kobuki1/cmd_vel; do sleep 0.5; done",
        "systemctl stop fault-drive",
        {("messages", "differ")},
        "",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_one_fault_of_a_relay_is_one_finding(lab, fault):
    host, made, back, expected, place = FAULTS[fault]
    port = str(find_port(lab)) if "PORT" in made else ""
    lab.run(host, made.replace("PORT", port))
    try:
        _status, report = verify(lab)
    finally:
        lab.run(host, back)
    found = [(one["kind"], one["mode"], one["place"], one["sentence"]) for one in report["findings"]]
    rows = [(row["check"], row["observer"], row["target"], row["found"]) for row in report["unexplained"]]
    print(fault, found, rows)
    assert found and found[0][:2] in expected and found[0][2].find(place) >= 0, found
    assert not rows and len(found) == 1, (found, rows)
    wait_until(
        lambda: "data" in lab.run(STATION, "timeout -k 5 10 rostopic echo -n 1 /kobuki1/map", check=False),
        60,
        "the map crosses again",
    )
