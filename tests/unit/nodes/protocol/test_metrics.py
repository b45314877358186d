# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The text of metrics: taken by Prometheus, whatever others call themselves."""

import json
import pathlib
import random
import re
import shutil
import subprocess

import pytest
import yaml
from rosfleet_multimaster.discovery.core import report as links
from rosfleet_multimaster.discovery.core.health import ClockAnswer, LinkHealth, LinkList
from rosfleet_multimaster.protocol import metrics
from rosfleet_multimaster.protocol.messages import Registration
from rosfleet_multimaster.relay.core.report import TopicCount, make_samples
from rosfleet_multimaster.sync.core import report as registrations
from rosfleet_multimaster.sync.core.sync import RegistrationConflict

ROOT = pathlib.Path(__file__).parents[4]
HOSTILE = 'a"b\\c\nd\x1b[31m\u202e{}=,#'
LINKS = LinkList(
    [
        LinkHealth("tibi-visio", "http://tibi-visio:11311/", True, 98.0, 0.4, 2, ClockAnswer(0.0021, -0.0375)),
        LinkHealth("dabo-nav", "http://dabo-nav:11311/", False, -1.0, None, 0, None),
        LinkHealth(HOSTILE, "http://x:1/", True, 0.0, 1e6, 1, ClockAnswer(3.0, 1e9)),
    ],
    7,
)


NAMES = {f"multimaster_{name}" for name in metrics.FAMILIES}


def everything():
    """Each metric, with values as they come."""
    held = {Registration("publisher", "/a", "/n", "http://n:1/"): "http://tibi-visio:11311/"}
    plain = [name for name, family in metrics.FAMILIES.items() if not family.labels]
    return {
        **metrics.scalar_samples(**dict.fromkeys(plain, 3)),
        **metrics.node_samples("/master_sync", 1763826000.25, 0, 12345),
        "malformed_total": {("datagram",): 3, ("request",): 0},
        "registration_changes_total": {(what,): 5 for what in metrics.CHANGES},
        **make_samples(2, [TopicCount("/scan", 10, 1000, 1), TopicCount(HOSTILE, 1, 10, 0)]),
        **links.link_samples(LINKS),
        **registrations.refusal_samples([RegistrationConflict("node", "/a", "tibi", "http://a", "b")], {"node": 4}),
        **registrations.parameter_samples(["tibi-visio", HOSTILE], ["tibi-visio"]),
        **registrations.registration_samples({"http://tibi-visio:11311/": "tibi-visio", "http://x:1/": HOSTILE}, held),
    }


LINE = re.compile(r'[a-z_]+(\{[a-z]+="([^"\\\n]|\\["\\n])*"(,[a-z]+="([^"\\\n]|\\["\\n])*")*\})? -?[0-9.e+-]+')


def test_every_metric_has_its_help_and_its_kind():
    text = metrics.text(everything())
    lines = text.splitlines()
    assert text.endswith("\n") and {line.split()[2] for line in lines if line[0] == "#"} == NAMES
    assert all(LINE.fullmatch(line) for line in lines if line[0] != "#"), text
    assert 'multimaster_link_heartbeats_ratio{master="tibi-visio"} 0.98' in lines
    assert 'multimaster_clock_offset_seconds{master="tibi-visio"} -0.0375' in lines
    assert 'multimaster_link_up{master="dabo-nav"} 0' in lines
    assert 'multimaster_registrations{master="tibi-visio",kind="publisher"} 1' in lines
    assert 'multimaster_refusals{reason="node"} 1' in lines and 'multimaster_refusals_total{reason="node"} 4' in lines
    assert "multimaster_last_update_timestamp_seconds" in text and " 1763826000.25" in text


def test_what_a_stranger_is_called_is_one_value_of_a_label():
    (line,) = [line for line in metrics.text(everything()).splitlines() if line.endswith(" 1000000000")]
    assert LINE.fullmatch(line) and line.isprintable() and line.count("multimaster_") == 1


@pytest.mark.parametrize("names", [["same", "same"], ["x" * 5000 + "1", "x" * 5000 + "2"], ["a b", "a\nb"]])
def test_two_with_one_name_do_not_spoil_the_file(names):
    text = metrics.text({"link_up": {(name,): 1 for name in names}})
    assert len(text.splitlines()) == 3 and len(text) < 500


def test_the_number_of_lines_is_bounded():
    assert len(metrics.text({"link_up": {(f"robot{one}",): 1 for one in range(9999)}}).splitlines()) == 1002
    names = {f"http://r{one}:1/": f"r{one}" for one in range(9999)}
    found = registrations.registration_samples(names, {})["registrations"]
    assert len(found) <= metrics.MOST and len(set(found)) == len(found)


def test_the_version_is_that_of_the_collection():
    assert metrics.VERSION == yaml.safe_load((ROOT / "galaxy.yml").read_text())["version"]


def _promtool():
    return shutil.which("promtool", path=f"{ROOT}/.work/bin") or shutil.which("promtool")


@pytest.mark.skipif(_promtool() is None, reason="there is no promtool: tools/setup.sh brings it")
@pytest.mark.parametrize("seed", range(5))
def test_promtool_takes_it_without_a_word(seed):
    """Also with names of strangers who try to end a label or a line."""
    draw, samples = random.Random(seed), everything()
    parts = (
        '"',
        "\\",
        "\n",
        "\r",
        '"} 1\nmultimaster_roscore_up 0\n',
        "# HELP x",
        "{a=",
        ",",
        "\x00",
        "\udc80",
        "\u2028",
        "   ",
        "EVIL",
    )
    names = {"".join(draw.choices(parts, k=draw.randint(1, 8))) for _name in range(60)}
    harmless = len(metrics.text(everything()).splitlines())
    for family in ("link_up", "link_lost_total"):
        samples[family].update({(name,): 1.0 for name in names})
    lines = metrics.text(samples).splitlines()
    assert all(LINE.fullmatch(line) for line in lines if line[0] != "#") and len(lines) > harmless
    assert [line for line in lines if line.startswith("multimaster_roscore_up")] == ["multimaster_roscore_up 3"]
    done = subprocess.run(
        [_promtool(), "check", "metrics"],
        input=metrics.text(samples),
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_the_dashboard_asks_for_metrics_that_exist():
    dashboard = json.loads((ROOT / "docs/grafana/multimaster.json").read_text())
    asked = set(
        re.findall(r"multimaster_[a-z_]+", json.dumps(dashboard["panels"]) + json.dumps(dashboard["templating"]))
    )
    assert asked <= NAMES
    assert {panel["datasource"]["uid"] for panel in dashboard["panels"]} == {"${datasource}"}
    for wanted in ("link_up", "link_lost_total", "clock_offset_seconds", "refusals"):
        assert f"multimaster_{wanted}" in asked
    ids, places = [panel["id"] for panel in dashboard["panels"]], [panel["gridPos"] for panel in dashboard["panels"]]
    assert len(set(ids)) == len(ids) and all(place["x"] + place["w"] <= 24 for place in places)
