# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Topics of a known rate between two robots, of rospy and of roscpp: verify says what they cost."""

import json

import pytest
from setups.links import wait_until

FIRST, SECOND = "kobuki1computer", "kobuki2computer"
RATE, SIZE = 10.0, 10_000  # messages a second, bytes of one on the wire
PUBLISH = (
    f'rostopic pub -r {RATE:g} /image std_msgs/String "$(head -c {SIZE - 8} /dev/zero | tr "\\\\0" x)" __name:=camera'
)
TOPICS = {"/image": "/camera", "/relayed": "/relay"}  # of a rospy publisher, and of a roscpp one


@pytest.fixture(scope="module")
def document(lab, tmp_path_factory):
    """The result of verify about a robot whose publishers are heard on the other one."""
    programs = {
        (FIRST, "camera"): PUBLISH,
        (FIRST, "relay"): "rosrun topic_tools relay /image /relayed __name:=relay",
        (SECOND, "other"): "rosrun topic_tools relay /image /heard __name:=other",
        (SECOND, "ear"): "python3 {script} ear /heard /image /relayed",
    }
    for (host, unit), command in programs.items():
        lab.start(host, unit, command, "programs/chatter.py")
    heard = {"/heard", "/image", "/relayed"}
    wait_until(
        lambda: {text.split()[0] for _at, text in lab.output(SECOND, "ear")} == heard, 60, "all topics are heard"
    )
    report = tmp_path_factory.mktemp("report") / "report.json"
    status, output = lab.play("playbooks/verify.yml", variables={"verify_report": str(report)})
    for host, unit in programs:
        lab.stop(host, unit)
    assert status == 0 and "What costs most between robots" in output, output
    assert "What costs most between robots" in report.with_suffix(".html").read_text()
    return json.loads(report.read_text())


@pytest.mark.parametrize(("topic", "subscribers"), [("/image", 2), ("/relayed", 1)])
def test_a_topic_of_a_known_rate_costs_what_it_sends(document, topic, subscribers):
    (found,) = [entry for entry in document["traffic"]["topics"] if entry["topic"] == topic]
    assert (found["from"], found["nodes"], found["to"]) == ("kobuki1", [TOPICS[topic]], {"kobuki2": subscribers})
    assert found["messages_s"] / subscribers == pytest.approx(RATE, rel=0.4), "a busy computer publishes less"
    assert found["bytes_s"] / found["messages_s"] == pytest.approx(SIZE, rel=0.02)


def test_nothing_else_costs_anything(document):
    assert {entry["topic"] for entry in document["traffic"]["topics"] if entry["bytes_s"] >= 1000} == set(TOPICS)
    assert 3 <= document["traffic"]["seconds"] < 10
