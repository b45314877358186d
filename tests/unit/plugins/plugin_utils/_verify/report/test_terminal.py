# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The report for the terminal."""

import pathlib
import re

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.engine import (
    FAILED,
    OK,
    UNKNOWN,
    WARNING,
    Row,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.components.component import Component
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.diagnose.diagnosis import Diagnosis, Finding
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report.summary import summarise
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report.terminal import render
from fleets import diagnosed, fig12, wall
from mentioned import mentions

ONE, TWO = "kobuki1computer", "kobuki2computer"

ROWS = [
    Row("reachable", ONE, ONE, OK, "an answer", "an answer"),
    Row("reachable", TWO, TWO, OK, "an answer", "an answer"),
    Row("name", ONE, TWO, FAILED, "192.168.1.239", "127.0.1.1"),
    Row("name", TWO, ONE, FAILED, "192.168.1.229", "127.0.1.1"),
    Row("ping_name", ONE, TWO, FAILED, "an answer of kobuki2computer", "no answer"),
    Row("ping_name", TWO, ONE, OK, "an answer of kobuki1computer", "0.4 ms"),
    Row("clock", ONE, TWO, WARNING, "less than 0.1 s apart", "+0.2000 s"),
    Row("topic_heard", ONE, TWO, UNKNOWN, "a message", "left out by multimaster_filters"),
    Row("rpc_port", TWO, ONE, FAILED, "TCP port 11611 of 192.168.1.229 opens", "no answer"),
]
CLOCKS = Component("clock", ONE, "off"), Component("clock", TWO, "off")
CHANGED = "/etc/hosts was changed 2026-11-22 09:12:44 UTC"
DIAGNOSIS = Diagnosis(
    (
        Finding(Component("names", ONE, "loopback", TWO), proof=(ROWS[2],), rows=(ROWS[4],), since=CHANGED),
        Finding(Component("names", TWO, "loopback", ONE), proof=(ROWS[3],)),
        Finding(CLOCKS[0], WARNING, rivals=CLOCKS[1:], rows=(ROWS[6],), passed=("name", "ping_name")),
        Finding(Component("declaration", "kobuki1", "narrow", "the test topic"), UNKNOWN, proof=(ROWS[7],)),
    ),
    unexplained=(ROWS[8],),
)

TEXT = """\
VERIFICATION of 2 computers

  check                                       ok  warning   failed  unknown
  computer answers the controller              2        -        -        -
  name means the planned address               -        -        2        -
  ping by name                                 1        -        1        -
  port of the discovery node opens             -        -        1        -
  clocks agree                                 -        1        -        -
  subscriber hears the other's talker          -        -        -        1

  from / to                 1       2
   1  kobuki1computer      ok  FAIL 2
   2  kobuki2computer  FAIL 2      ok

Findings:
  1. /etc/hosts on kobuki1computer binds kobuki2computer to the loopback interface [RF-202]
     seen:     name means the planned address: kobuki1computer -> kobuki2computer: expected 192.168.1.239, found
               127.0.1.1
     follows:  ping by name (1)
     since:    /etc/hosts was changed 2026-11-22 09:12:44 UTC
     do:       on the controller: ansible-playbook -i INVENTORY rosfleet.multimaster.site --limit kobuki1computer
               (writes /etc/hosts, and keeps cloud-init from writing the line again at boot)
     look:     on kobuki1computer: getent ahostsv4 kobuki2computer; grep -n kobuki2computer /etc/hosts
  2. /etc/hosts on kobuki2computer binds kobuki1computer to the loopback interface [RF-202]
     seen:     name means the planned address: kobuki2computer -> kobuki1computer: expected 192.168.1.229, found
               127.0.1.1
     do:       on the controller: ansible-playbook -i INVENTORY rosfleet.multimaster.site --limit kobuki2computer
               (writes /etc/hosts, and keeps cloud-init from writing the line again at boot)
     look:     on kobuki2computer: getent ahostsv4 kobuki1computer; grep -n kobuki1computer /etc/hosts

Warnings:
  3. one of these: the clock of kobuki1computer is wrong [RF-601]; or the clock of kobuki2computer is wrong [RF-601]
     for it:   clocks agree (1) fail; such as kobuki1computer -> kobuki2computer: +0.2000 s
     besides:  in the same pairs these succeed: name means the planned address (1), ping by name (1)
     look:     on kobuki1computer: chronyc tracking; chronyc -n sources; date --utc +%T.%N
               on kobuki2computer: chronyc tracking; chronyc -n sources; date --utc +%T.%N

Not judged:
  4. kobuki1 leaves out topics that the others need: the test topic [RF-443]
     seen:     subscriber hears the other's talker: kobuki1computer -> kobuki2computer: expected a message, found left
               out by multimaster_filters
     do:       in the inventory: add it to multimaster_exports of kobuki1, or take it out of multimaster_filters
               on the controller: ansible-playbook -i INVENTORY rosfleet.multimaster.site --limit kobuki1
     look:     on the master of kobuki1: rosparam get /master_discovery; rosparam get /master_sync

The meaning of ids such as RF-202:
  https://github.com/rosfleet/multimaster/blob/main/docs/findings

Not explained (lost packets, or something that comes and goes: run it again):
   -  port of the discovery node opens: kobuki2computer -> kobuki1computer: expected TCP port 11611 of 192.168.1.229
      opens, found no answer

FAILED: 4 of 9 checks failed; the list has 2 findings, 1 warning, 1 not judged, 1 not explained."""

GOOD = summarise([row for row in ROWS if row.verdict == OK], [ONE, TWO], 2)


def test_report():
    assert render(summarise(ROWS, [ONE, TWO], 2), DIAGNOSIS) == TEXT


def test_many_names_are_counted():
    also = tuple(Component("names", ONE, "unknown", f"robot{number}") for number in range(9))
    found = Finding(Component("names", ONE, "unknown", TWO), also=also)
    assert mentions(found.sentence(), ONE, TWO, "robot0", "robot1", "robot2", "6")


def test_one_finding_that_two_checks_show_is_counted_once_and_a_warning_is_no_failure():
    """The roboticist reads the last line first, and then looks for as many entries above it."""
    failed = tuple(row for row in ROWS if row.check == "name")
    warned = tuple(Row("clock", *pair, WARNING, "", "+0.2 s") for pair in ((ONE, TWO), (TWO, ONE)))
    found = Diagnosis(
        (Finding(Component("names", ONE, "loopback", TWO), proof=failed), Finding(CLOCKS[0], WARNING, rows=warned))
    )
    text = render(summarise([*failed, *warned], [ONE, TWO], 2), found, everything=False)
    assert text.endswith("\n\nFAILED: 2 of 4 checks failed; the list has 1 finding, 1 warning.")
    assert re.findall(r"^ +([0-9]+)\. ", text, re.MULTILINE) == ["1", "2"]


def test_nothing_to_say():
    text = render(summarise([row for row in ROWS if row.verdict == OK], [ONE], 2), Diagnosis())
    assert mentions(text, "VERIFICATION", "1", "2")
    assert text.endswith("PASSED: none of 3 checks failed.")
    assert "from / to" not in text and "Findings" not in text and "Not explained" not in text


def test_a_matrix_of_thirteen_computers_fits():
    names = [f"tibi-visio-{number:02}" for number in range(13)]
    rows = [Row("ping_address", one, two, FAILED, "", "") for one in names for two in names for _n in range(12)]
    lines = render(summarise(rows, names, 13), Diagnosis()).splitlines()
    row = next(line for line in lines if line.startswith("   1  "))
    assert row.split() == ["1", names[0], *["FAIL"] * 13] and len(row) <= 120


def test_large_fleets_stay_readable():
    names = [f"kobuki{number}computer" for number in range(1, 101)]
    rows = {
        two: tuple(
            Row("ping_address", one, two, FAILED, f"an answer of {two}", "no answer") for one in names if one != two
        )
        for two in names[:40]
    }
    diagnosis = Diagnosis(tuple(Finding(Component("computer", two, "off"), rows=of) for two, of in rows.items()))
    text = render(summarise([row for of in rows.values() for row in of], names, 100), diagnosis)
    assert "from / to" not in text
    assert "ping by address (99) fail" in text and "and 20 more: all are in the file" in text
    assert len(text.splitlines()) < 150 and max(map(len, text.splitlines())) <= 120


def test_a_finding_has_the_number_of_the_report_also_behind_many_others():
    rows = tuple(Row("ping_address", f"kobuki{number}computer", TWO, FAILED, "", "") for number in range(25))
    failed = [Finding(Component("computer", row.observer, "off"), rows=(row,)) for row in rows]
    warned = Row("mtu", ONE, ONE, WARNING, "", "")
    diagnosis = Diagnosis((*failed, Finding(Component("interface", ONE, "mtu"), rows=(warned,), verdict=WARNING)))
    text = render(summarise([*rows, warned], [ONE, TWO], 2), diagnosis)
    numbers = re.findall(r"^ *([0-9]+)\. ", text, re.MULTILINE)
    assert numbers == [*map(str, range(1, 21)), "26"]


def test_without_the_table_only_what_is_wrong_is_told():
    text = render(summarise(ROWS, [ONE, TWO], 2), DIAGNOSIS, width=80, everything=False)
    assert text.startswith("VERIFICATION of 2 computers\n\nFindings:\n  1. ")
    assert " ".join(text.rsplit("\n\n", maxsplit=1)[-1].split()) == TEXT.splitlines()[-1]
    assert "from / to" not in text and max(map(len, text.splitlines())) <= 80
    assert render(GOOD, Diagnosis(), everything=False).split("\n\n") == [
        "VERIFICATION of 2 computers",
        "PASSED: none of 3 checks failed.",
    ]


def sent(topic, kilobytes, *nodes, **to):
    return {
        "topic": topic,
        "from": "ana",
        "nodes": nodes or ["/base"],
        "to": to or {"bob": 1},
        "messages_s": 9.96,
        "bytes_s": 1000.0 * kilobytes,
    }


def test_the_topics_that_cost_most():
    topics = [sent("/ana/scan", 198.94, "/ana_camera", bob=1, cid=2), sent("/x", 1.0), sent("/cheap", 0.99)]
    text = render(GOOD, Diagnosis(), everything=False, traffic={"seconds": 3.04, "topics": topics})
    assert text.split("\n\n")[1:] == [
        """\
What costs most between robots:
  As the publishers counted it for 3.0 s, summed over all subscribers of other robots. Topics of less than 1 kB/s are
  left out.
  topic      from (node)        to            messages/s   kB/s
  /ana/scan  ana (/ana_camera)  bob, cid (2)        10.0  198.9
  /x         ana (/base)        bob                 10.0    1.0""",
        "PASSED: none of 3 checks failed.",
    ]


def test_ten_topics_at_most_fit_into_the_terminal():
    topics = [sent(f"/{number}/{'x' * 200}", 5, "/" + "y" * 200, **{"z" * 99: 1}) for number in range(30)]
    text = render(GOOD, Diagnosis(), 80, False, {"seconds": 3.0, "topics": topics})
    lines = text.split("\n\n")[1].splitlines()
    assert len(lines) == 4 + 10 and max(map(len, lines)) <= 80


def test_no_table_where_every_topic_is_cheap():
    traffic = {"seconds": 3.0, "topics": [sent("/cheap", 0.99)]}
    assert render(GOOD, Diagnosis(), everything=False, traffic=traffic) == render(GOOD, Diagnosis(), everything=False)


def test_the_finding_on_the_page_is_printed_so():
    page = pathlib.Path(__file__).resolve().parents[6] / "docs/operate/verification.md"
    shown = page.read_text(encoding="utf-8").partition("```\nFindings:\n")[2].partition("```")[0]
    printed = render(summarise([], [], 0), diagnosed(wall, fig12()), everything=False)
    assert shown.startswith("  1. a packet filter on tibi-visio") and shown in printed


def test_remarks_of_the_comparison_stand_in_the_report():
    remarks = [f"ana: the ROS of Debian's packages lacks rospy{number}." for number in range(12)]
    text = render(GOOD, Diagnosis(), 80, False, remarks=remarks)
    told = text.split("\n\n")[1]
    assert remarks[9] in told and remarks[10] not in told and "and 2 more" in told
    assert max(map(len, text.splitlines())) <= 80
