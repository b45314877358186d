# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The page: findings with links that lead somewhere, hostile texts, no request, and its size for a large fleet."""

import re
from html.parser import HTMLParser

import fleets
import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._faults.fault import PAGES
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.engine import FAILED, OK, Row
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.components.component import Component
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.diagnose.diagnosis import Diagnosis, Finding
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import (
    NodeTraffic,
    Ping,
    SentTopic,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report import content
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report.matrices import KINDS, MOST, Matrices
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report.page import (
    FINDINGS,
    list_flows,
    make_page,
)
from reports import TEMPLATE, make_report


class Tags(HTMLParser):
    """Every tag with its attributes, and the text."""

    def __init__(self, html):
        super().__init__()
        self.tags, self.text = [], ""
        self.feed(html)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.text += data

    def values(self, key):
        return [attributes[key] for _tag, attributes in self.tags if key in attributes]


@pytest.mark.slow
def test_what_is_wrong_is_told_and_every_link_leads_somewhere():
    report = make_report(fleets.fig12(), fleets.wall, since="2026-11-21 14:02", differences=["tibi-nav is new"])
    page = Tags(report.html)
    entry = report.document["findings"][0]
    assert entry["sentence"] in page.text and entry["id"] in page.text
    assert all(one["text"] in page.text for one in (*entry["do"], *entry["look"]))
    assert entry["look"] and all(one["text"] in entry["decide"] for one in entry["look"])
    assert (
        "Something is wrong." in page.text and "Since 2026-11-21 14:02" in page.text and "tibi-nav is new" in page.text
    )
    links, ids = page.values("href"), page.values("id")
    assert "#finding-1" in links and len(ids) == len(set(ids))
    assert all(link[1:] in ids for link in links if link.startswith("#"))


@pytest.mark.slow
def test_why_a_finding_was_made_is_folded_below_it():
    report = make_report(fleets.fig12(), fleets.wall)
    page = Tags(report.html)
    because = report.document["findings"][0]["because"]
    assert because["title"] in page.text and "Why this finding" in page.text
    assert f"rule {because['place']} of {because['rules']}, {because['rule']}" in page.text
    assert [tag for tag, _attributes in page.tags].count("dl") == 1 and "details" in dict(page.tags)


@pytest.mark.slow
def test_all_is_well():
    text = Tags(make_report(fleets.fig12()).html).text
    assert "All is well." in text and "Nothing was found." in text and "Not explained" not in text


@pytest.mark.slow
def test_nothing_is_asked_for():
    page = Tags(make_report(fleets.fig12(), fleets.wall).html)
    assert not [tag for tag, _attributes in page.tags if tag in ("script", "iframe", "object", "form", "base")]
    assert not page.values("src") and all(link.startswith(("#", "data:,", PAGES)) for link in page.values("href"))
    assert "default-src 'none'; style-src 'unsafe-inline'; img-src data:" in page.values("content")


EVIL = '"><script>alert(1)</script><img src=x onerror=alert(1)>{{ 7 * 7 }}\x1b[31m\u202e'


@pytest.mark.slow
def test_text_of_strangers_stays_text():
    def change(seen):
        fleets.wall(seen)
        flow = SentTopic(EVIL, "/" + EVIL, "dabo", 1, 5000.0, 5.0)
        fleets.update(seen["tibi-visio"].probe, traffic=NodeTraffic(3.0, (flow,)))
        for observation in seen.values():
            for member in observation.probe.members:
                fleets.update(member, ping_address=Ping(error=EVIL))
            for topic in observation.probe.exchange.topics:
                fleets.update(topic, name="/" + EVIL)

    page = Tags(
        make_report(
            fleets.fig12(),
            change,
            machines={EVIL: dict.fromkeys(content.MACHINE, EVIL)},
        ).html
    )
    assert not [tag for tag, _attributes in page.tags if tag in ("script", "img")]
    assert not [key for _tag, attributes in page.tags for key in attributes if key.startswith("on")]
    assert "What costs most between robots" in page.text and ("tibi (" + EVIL[:9]) in page.text
    assert "{{ 7 * 7 }}" in page.text and "\x1b" not in page.text and "\u202e" not in page.text


@pytest.mark.slow
def test_a_way_of_hostile_captures_stays_a_picture():
    """Whatever other computers call their interfaces and hardware addresses."""
    fleet, words = fleets.fig12(), {"network": EVIL, "left": EVIL, "target_mac": EVIL, "came": EVIL}
    hop = {"sender": EVIL, "receiver": "tibi-nav", "ttl": 10**400, "answer": False, "arrived": True, **words}
    way = {"computers": ["router", "tibi-nav"], "hops": [hop], "at": EVIL, "words": EVIL}
    entry = make_report(fleet, fleets.wall).document["findings"][0]
    page = Tags(make_report(fleet, findings=[{**entry, "ways": [way]}]).html)
    assert sum(attributes.get("class") == "cross" for _tag, attributes in page.tags) == 1
    assert not [tag for tag, _attributes in page.tags if tag in ("script", "img")]
    assert not [key for _tag, attributes in page.tags for key in attributes if key.startswith("on")]
    assert "{{ 7 * 7 }}" in page.text and "\x1b" not in page.text and "\u202e" not in page.text


@pytest.mark.slow
def test_each_cell_has_a_sign_and_its_numbers():
    page = Tags(make_report(fleets.fig12(), fleets.wall).html)
    cells = [attributes for tag, attributes in page.tags if tag == "td" and "title" in attributes]
    assert any(cell["class"] == "f" and "ping by address: no answer" in cell["title"] for cell in cells)
    assert any(cell["class"] == "o" and "clocks agree: +0.0010 s" in cell["title"] for cell in cells)
    assert not re.search(r"<td class=[fwuo][^>]*></td>|<td class=[fwuo][^>]*><td", page.text)


def test_the_declared_flow_beside_what_flows():
    fleet = fleets.plan(exports={"kobuki1": [{"topics": ["/scan"]}], "kobuki2": None})
    pairs = {(flow["from"], flow["to"]): flow for flow in list_flows(make_report(fleet).document["robots"])}
    assert pairs["kobuki1", "kobuki2"]["declared"] == ["/scan"] and not pairs["kobuki1", "kobuki2"]["everything"]
    assert pairs["kobuki2", "kobuki1"]["everything"] and pairs["kobuki2", "kobuki1"]["held"]


@pytest.mark.slow
@pytest.mark.parametrize(("verdict", "computers"), [(OK, 400), (FAILED, 400), (FAILED, 40)])
def test_the_page_is_smaller_than_five_megabytes(verdict, computers):
    """A hundred robots, or the most computers that have cells of their own, and everything fails with long texts."""
    fleet = fleets.plan(computers // 4, 4)
    robots = sorted({plan.robot for plan in fleet.computers.values()})
    names = list(fleet.computers) if computers <= MOST else [f"{robot}computer" for robot in robots]
    long = "a & text " * 30
    rows = [Row(kind.checks[0], one, two, verdict, long, long) for one in names for two in names for kind in KINDS]
    cells = Matrices(fleet, rows)
    components = [Component("computer", name, "off") for name in fleet.computers]
    found = Diagnosis(
        tuple(Finding(component, rows=tuple(rows[:100]), proof=tuple(rows[:100])) for component in components)
    )
    document = {
        **make_report(fleets.plan()).document,
        "findings": content.list_findings(found) if verdict == FAILED else [],
        "rows": [row._asdict() for row in rows if verdict == FAILED],
        "robots": [
            {
                "robot": robot,
                "declares": False,
                "gives": [],
                "read": True,
                "takes": [
                    {
                        "robot": other,
                        "topics": [f"/{number}/{long}" for number in range(100)] if robot < robots[3] else [],
                        "services": [],
                    }
                    for other in robots
                ],
            }
            for robot in robots
        ],
    }
    html = make_page(TEMPLATE, fleet, document, cells)
    assert len(html.encode()) < 5e6
    assert sum(html.count(f"<td class={sign}") for sign in "of") >= len(rows)


@pytest.mark.slow
def test_a_large_fleet_says_what_was_not_tried():
    html = make_report(fleets.plan(21, 2), pairs="auto").html
    assert "pairs were tried" in html and "A cell is two robots" in html


def test_remarks_of_the_comparison_are_on_the_page():
    html = make_report(fleets.plan(), remarks=["kobuki1computer: <its> ROS lacks rospy."]).html
    assert "kobuki1computer: &lt;its&gt; ROS lacks rospy." in html
    assert 'id="remarks"' not in make_report(fleets.plan()).html


@pytest.mark.slow
def test_a_robot_that_was_not_looked_at_or_is_left_out_of_the_findings_is_not_well():
    """With --limit, and with more findings than the page has."""
    fleet = fleets.fig12()
    report = make_report(fleet, fleets.wall)
    many = [{**report.document["findings"][0], "place": "dabo-nav", "rivals": []}] * FINDINGS
    last = {**many[0], "place": "the network of tibi"}
    seen = [name for name, plan in fleet.computers.items() if plan.robot != "car"]
    document = {**report.document, "findings": [*many, last], "computers": seen}
    html = make_page(TEMPLATE, fleet, document, report.matrices)
    robots = html.partition('<ol class="robots"')[2].partition("</ol>")[0]
    assert re.findall('<li class="([a-z]+)"><a href="#([a-z0-9-]+)">. ([a-z]+)</a></li>', robots) == [
        ("failed", "wrong", "tibi"),
        ("failed", "finding-1", "dabo"),
        ("unknown", "left-out", "car"),
    ]
