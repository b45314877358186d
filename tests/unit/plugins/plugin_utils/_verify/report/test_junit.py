# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""JUnit XML: what a CI system counts and shows."""

from xml.etree import ElementTree

import fleets
import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report.junit import write_junit
from mentioned import mentions
from reports import make_report


def test_all_is_well():
    document = make_report(fleets.plan()).document
    suite = ElementTree.fromstring(write_junit(document).encode())[0]
    assert (suite.get("tests"), suite.get("failures")) == (str(len(document["checks"])), "0")
    assert len(suite.findall("testcase")) == len(document["checks"]) and not suite.findall("testcase/failure")


@pytest.mark.parametrize(
    ("moment", "shown"), [("2026-11-22 08:00:00 +0100", "2026-11-22T08:00:00"), ("late", ""), (None, "")]
)
def test_the_time_has_the_form_of_the_schema(moment, shown):
    document = {**make_report(fleets.plan()).document, "time": moment}
    assert ElementTree.fromstring(write_junit(document).encode())[0].get("timestamp") == shown


def test_a_failure_lists_its_pairs():
    document = make_report(fleets.fig12(), fleets.wall).document
    suite = ElementTree.fromstring(write_junit(document).encode())[0]
    failed = [check["check"] for check in document["checks"] if check["failed"]]
    assert suite.get("failures") == str(len(failed)) and len(suite.findall("testcase/failure")) == len(failed)
    case = next(case for case in suite.findall("testcase") if case.get("name").startswith("ping_address:"))
    assert mentions(case.find("failure").text, "tibi-nav", "dabo-nav", "192.168.10.100")
    assert "a packet filter on tibi-visio drops" in suite.find("system-out").text


def test_a_finding_has_its_id_as_a_property_and_do_and_look_apart():
    suite = ElementTree.fromstring(write_junit(make_report(fleets.fig12(), fleets.lost_route).document).encode())[0]
    properties = [(one.get("name"), one.get("value")) for one in suite.findall("properties/property")]
    assert ("finding", "RF-261 tibi-nav") in properties and properties[-1][1].endswith("2xx.md#rf-261")
    lines = suite.find("system-out").text.splitlines()
    assert [line.split(":")[0].strip() for line in lines[:3]] == ["failed", "do", "look"]


def test_hostile_text_is_escaped():
    document = make_report(fleets.fig12(), fleets.wall).document
    for row in document["rows"]:
        row["found"] = "]]></failure><evil/>\x1b[2J\x00\ufffe"
    text = write_junit(document)
    root = ElementTree.fromstring(text.encode())
    assert not list(root.iter("evil")) and "\x1b" not in text
