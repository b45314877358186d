# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The first messages between two robots: what a rospy subscriber loses of them, told by two roscores or by one of a publisher."""

import json
import time

from setups.links import wait_until

SPEAKER, HEARER = "kobuki1computer", "kobuki2computer"
BOTH, OWN = "/first_words/both", "/first_words/own"  # the subscribers are on both robots, on their own one alone
COUNT, EACH = 20, 25  # topics of each kind, and messages on each; see first_words.py
PARAMETERS = "/etc/rosfleet-multimaster/master_sync.json"
#: What multimaster_filters make of the parameters of the robot that has the publishers.
LEAVE_OUT = f"""
import json
path = "{PARAMETERS}"
parameters = json.load(open(path))
parameters["ignore_subscribers"] = [*parameters.get("ignore_subscribers", ()), "{OWN}/*"]
json.dump(parameters, open(path, "w"))
"""
KNOWN = """
import json, os, xmlrpc.client
publishers, subscribers, _services = xmlrpc.client.ServerProxy(os.environ["ROS_MASTER_URI"]).getSystemState("/test")[2]
print(json.dumps([[name for name, _nodes in part] for part in (publishers, subscribers)]))
"""


def known(lab, host, folder):
    """The number of topics of a folder with a publisher on a robot, and the number with a subscriber."""
    return [
        sum(name.startswith(folder) for name in part) for part in json.loads(lab.run(host, "python3 -", stdin=KNOWN))
    ]


def begin(lab, host, role, folders):
    lab.start(host, role, f"python3 {{script}} {role} {COUNT} {' '.join(folders)}", "programs/first_words.py")


def read_arrivals(lab):
    """Return what the hearer has printed."""
    return {text for _time, text in lab.output(HEARER, "hear")}


def losses(lab, *folders):
    """(when it was said, on which topics) -> how many messages did not arrive, and of how many topics."""
    lab.wait_until_ready(SPEAKER, "say")
    arrived, before = read_arrivals(lab), None
    while arrived != before:  # some are under way, longer on a busy machine
        time.sleep(1)
        arrived, before = read_arrivals(lab), arrived
    found = {}
    for when in ("early", "rested"):
        for folder in folders:
            topics = [f"{folder}/{number}" for number in range(COUNT)]
            lost = [topic for topic in topics for number in range(EACH) if f"{when} {number} {topic}" not in arrived]
            found[when, folder] = (len(lost), len(set(lost)))
            text = "%-6s on %s: %d of %d messages lost, on %d of %d topics"
            print(text % (when, folder, len(lost), COUNT * EACH, len(set(lost)), COUNT))
    lab.stop(SPEAKER, "say")
    lab.stop(HEARER, "hear")
    return found


def test_a_later_publisher_must_wait_until_the_connections_rest(lab):
    """Both roscores tell the subscriber of it, one a little later; or its own one alone."""
    lab.run(
        SPEAKER, f"cp -a {PARAMETERS} /root/kept && python3 - && systemctl restart multimaster-sync", stdin=LEAVE_OUT
    )
    try:
        begin(lab, HEARER, "hear", (BOTH, OWN))
        lab.wait_until_ready(HEARER, "hear")
        wait_until(lambda: known(lab, SPEAKER, BOTH)[1] == COUNT, 30, "the subscribers are on the other robot")
        assert known(lab, SPEAKER, OWN) == [0, 0]
        begin(lab, SPEAKER, "say", (BOTH, OWN))
        lost = losses(lab, BOTH, OWN)
    finally:
        lab.run(SPEAKER, f"cp -a /root/kept {PARAMETERS} && systemctl restart multimaster-sync")
    assert lost["rested", BOTH] == lost["rested", OWN] == lost["early", OWN] == (0, 0)
    assert lost["early", BOTH] > (0, 0), "nothing was lost: must one still wait, as docs/operate/data_flow.md says?"


def test_a_subscriber_that_comes_later_loses_nothing(lab):
    """Its own roscore tells it of the publisher, so the robot of the publisher does not."""
    begin(lab, SPEAKER, "say", (BOTH,))
    wait_until(lambda: known(lab, HEARER, BOTH)[0] == COUNT, 30, "the publishers are on the other robot")
    begin(lab, HEARER, "hear", (BOTH,))
    assert set(losses(lab, BOTH).values()) == {(0, 0)}
