# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The report as a person reads it, as a file, and what the action reads of registered results."""

import json

from ansible_collections.rosfleet.multimaster.plugins.action import fleet_report
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify import report
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.engine import (
    FAILED,
    OK,
    UNKNOWN,
    WARNING,
    Finding,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observations import (
    Multicast,
    Observation,
    Probe,
)

ONE, TWO = "kobuki1computer", "kobuki2computer"

FINDINGS = [
    Finding("reachable", ONE, ONE, OK, "an answer", "an answer"),
    Finding("reachable", TWO, TWO, OK, "an answer", "an answer"),
    Finding(
        "name",
        ONE,
        TWO,
        FAILED,
        "192.168.1.239",
        "127.0.1.1",
        "/etc/hosts there binds the name to the loopback interface",
        "run site.yml, which also keeps cloud-init from writing the line again at boot",
    ),
    Finding(
        "name",
        TWO,
        ONE,
        FAILED,
        "192.168.1.229",
        "127.0.1.1",
        "/etc/hosts there binds the name to the loopback interface",
        "run site.yml, which also keeps cloud-init from writing the line again at boot",
    ),
    Finding("ping_name", ONE, TWO, FAILED, "an answer of kobuki2computer", "no answer", because="name"),
    Finding("ping_name", TWO, ONE, OK, "an answer of kobuki1computer", "0.4 ms"),
    Finding(
        "clock",
        ONE,
        TWO,
        WARNING,
        "less than 0.1 s apart",
        "+0.2000 s",
        "the clocks are not synchronised",
        "run chrony",
    ),
    Finding("topic_heard", ONE, TWO, UNKNOWN, "a message", "left out by multimaster_filters", "the filters", "nothing"),
]

TEXT = """\
VERIFICATION of 2 computers

  check                                       ok  warning   failed  unknown
  computer answers the controller              2        -        -        -
  name means the planned address               -        -        2        -
  ping by name                                 1        -        1        -
  clocks agree                                 -        1        -        -
  subscriber hears the other's talker          -        -        -        1

  from / to                 1       2
   1  kobuki1computer      ok  FAIL 2
   2  kobuki2computer  FAIL 1      ok

Failed:
  1. name means the planned address: kobuki1computer -> kobuki2computer, kobuki2computer -> kobuki1computer
     expected: 192.168.1.239 (kobuki1computer -> kobuki2computer)
     found:    127.0.1.1 (kobuki1computer -> kobuki2computer)
     cause:    /etc/hosts there binds the name to the loopback interface
     remedy:   run site.yml, which also keeps cloud-init from writing the line again at boot
  1 more follows from these.

Warnings:
  1. clocks agree: kobuki1computer -> kobuki2computer
     expected: less than 0.1 s apart
     found:    +0.2000 s
     cause:    the clocks are not synchronised
     remedy:   run chrony

Not judged:
  1. subscriber hears the other's talker: kobuki1computer -> kobuki2computer
     expected: a message
     found:    left out by multimaster_filters
     cause:    the filters
     remedy:   nothing

FAILED: 3 of 8 checks failed (1 with a warning, 1 not judged)."""


def test_report():
    summary = report.summarise(FINDINGS, [ONE, TWO], 2)
    assert report.render(summary) == TEXT


def test_what_differs_is_told_for_each():
    findings = [
        Finding("names", ONE, two, FAILED, "each name once", f"the node /{node} is twice", "one name", "rename")
        for two, node in ((TWO, "a"), ("c", "a"), ("d", "b"), ("e", "c"), ("f", "d"), ("g", "e"))
    ]
    lines = report.render(report.summarise(findings, [ONE], 2)).splitlines()
    assert [line.strip() for line in lines if "found:" in line] == [
        f"found:    the node /a is twice ({ONE} -> {TWO})",
        f"found:    the node /b is twice ({ONE} -> d)",
        f"found:    the node /c is twice ({ONE} -> e)",
        f"found:    the node /d is twice ({ONE} -> f)",
    ]


def test_nothing_to_say():
    text = report.render(report.summarise([finding for finding in FINDINGS if finding.verdict == OK], [ONE], 2))
    assert text.startswith("VERIFICATION of 1 of 2 computers; the others are not in this run")
    assert text.endswith("PASSED: none of 3 checks failed.")
    assert "from / to" not in text and "Failed" not in text


def test_a_matrix_of_thirteen_computers_fits():
    names = [f"tibi-visio-{number:02}" for number in range(13)]
    findings = [Finding("ping_address", one, two, FAILED, "", "") for one in names for two in names for _n in range(12)]
    lines = report.render(report.summarise(findings, names, 13)).splitlines()
    row = next(line for line in lines if line.startswith("   1  "))
    assert row.split() == ["1", names[0], *["FAIL"] * 13] and len(row) <= 120


def test_large_fleets_stay_readable():
    names = [f"kobuki{number}computer" for number in range(1, 101)]
    findings = [
        Finding(
            "ping_address", one, two, FAILED, f"an answer of {two}", "no answer", f"{two} is off", f"switch {two} on"
        )
        for two in names[:40]
        for one in names
        if one != two
    ]
    text = report.render(report.summarise(findings, names, 100))
    assert "from / to" not in text
    assert "and 95 more" in text and "and 20 more kinds" in text
    assert len(text.splitlines()) < 150 and max(map(len, text.splitlines())) <= 120


def test_document_has_every_finding_as_plain_data():
    summary = report.summarise(FINDINGS, [ONE, TWO], 2)
    document = json.loads(json.dumps(report.document(summary, FINDINGS)))
    assert (document["verdict"], document["computers"], len(document["findings"])) == (FAILED, [ONE, TWO], 8)
    assert document["findings"][4]["because"] == "name"
    assert {
        "check": "ping_name",
        "title": "ping by name",
        "ok": 1,
        "warning": 0,
        "failed": 1,
        "unknown": 0,
    } in document["checks"]


def test_registered_results_become_an_observation():
    good = {"verify_multicast": {"udp": []}, "verify_probe": {"members": []}, "multimaster_info": {"changed": False}}
    seen = fleet_report.observation(good, "verify_multicast", "verify_probe", ["multimaster_info"])
    assert seen == Observation(Multicast(), Probe())
    filtered = {**good, "verify_filter": {"members": [], "changed": True, "msg": "would be changed"}}
    seen = fleet_report.observation(filtered, "verify_multicast", "verify_probe", [], "verify_filter")
    assert (seen.packet_filter.changed, seen.packet_filter.msg) == (True, "would be changed")
    skipped = {**good, "verify_filter": {"changed": False, "skipped": True}}
    assert (
        fleet_report.observation(skipped, "verify_multicast", "verify_probe", [], "verify_filter").packet_filter is None
    )
    down = {"multimaster_info": {"unreachable": True, "msg": "no route\n to host"}}
    assert fleet_report.observation(down, "verify_multicast", "verify_probe", ["multimaster_info"]) == Observation(
        unreachable=True, problem="no route to host"
    )
    broken = {
        **good,
        "verify_talker": {"failed": True, "msg": "Cannot start."},
        "verify_probe": {"failed": True, "msg": "x"},
    }
    assert fleet_report.observation(broken, "verify_multicast", "verify_probe", ["verify_talker"]) == Observation(
        Multicast(), problem="Cannot start."
    )


def test_an_answer_of_strangers_costs_one_computer_its_result_and_no_other_the_report():
    odd = {"verify_probe": {"members": 3}}
    seen = fleet_report.observation(odd, "verify_multicast", "verify_probe", [])
    assert seen.probe is None and seen.problem.startswith("its results cannot be read: members is 3")


def test_report_is_written_whole_or_not_at_all(tmp_path):
    path = tmp_path / "report.json"
    fleet_report.write(str(path), {"verdict": "ok"})
    assert json.loads(path.read_text()) == {"verdict": "ok"}
    try:
        fleet_report.write(str(path), {"verdict": object()})
    except TypeError:
        pass
    assert json.loads(path.read_text()) == {"verdict": "ok"} and list(tmp_path.iterdir()) == [path]
