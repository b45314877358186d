# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A bundle: what is read again is judged as before; what somebody changed in it is refused in a sentence."""

import dataclasses
import json
import subprocess
import sys
import time

import fleets
import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._bundle import bundle as bundles
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._bundle import reading
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._bundle.archive import UnreadableBundle
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._bundle.secrets import REMOVED, Secrets
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.engine import InventorySource
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report import content
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report.judgement import judge_run
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report.run import Run

pytestmark = pytest.mark.whole

ABOUT = {"time": "2026-11-22 14:02:00", "collection": "0.1.0", "ansible": "2.19.0", "pairs": "all"}


def bundled(fleet, *changes, logs=None):
    seen = fleets.observed(fleet)
    for change in changes:
        change(seen)
    return Run(fleet, seen, {name: {"ros": "noetic"} for name in seen}, ABOUT, logs or {})


def again(bundle):
    return reading.read_bundle(bundles.write_files(bundle, "", {}))


def kinds(bundle):
    found = judge_run(bundle, pages=False, everything=False).diagnosis.findings
    return sorted((entry.component.kind, entry.component.mode, entry.verdict, len(entry.rows)) for entry in found)


@pytest.mark.parametrize("changes", [(), (fleets.wall,), (fleets.wall, fleets.second_default_route)])
def test_what_is_read_again_is_what_was_written(changes):
    bundle = bundled(fleets.fig12(), *changes)
    found = again(bundle)
    assert found.fleet == bundle.fleet and found.observations == bundle.observations
    assert found.machines == bundle.machines and found.about["pairs"] == "all"
    assert judge_run(found, False, False).diagnosis == judge_run(bundle, False, False).diagnosis


def test_a_reason_has_the_new_names():
    bundle = bundles.rename(bundled(fleets.fig12(), fleets.wall), {}, set())
    reason = content.list_findings(judge_run(bundle, False, False).diagnosis)[0]["because"]
    assert reason["rivals"] and "robot" in reason["rivals"][0]["place"]
    assert "tibi" not in json.dumps(reason) and "192.168" not in json.dumps(reason)


def test_a_bundle_has_no_inventory_of_its_maker():
    bundle = dataclasses.replace(
        bundled(fleets.fig12(), fleets.lost_route), inventory=InventorySource("/home/anna/robots")
    )
    assert "anna" not in json.dumps(bundles.write_files(bundle, "", {}))


@pytest.mark.slow
@pytest.mark.parametrize(
    "changes", [(fleets.wall,), (fleets.second_default_route,), (fleets.wall, fleets.second_default_route)]
)
def test_findings_are_the_same_without_names_and_secrets(changes):
    bundle = bundled(fleets.fig12(), *changes, logs={"tibi-nav": "tibi-nav: at 192.168.11.100 password=x1y2\n"})
    assert len(kinds(bundle)) == len(changes)
    other = bundles.rename(bundles.remove_secrets(bundle, Secrets()), {}, set())
    assert kinds(again(other)) == kinds(bundle)
    assert "tibi" not in json.dumps(bundles.write_files(other, "", {})) and "names" in other.about
    assert other.logs["robot1-computer1"].startswith("robot1-computer1: at 10.")


@pytest.mark.slow
def test_logs_have_the_last_lines_and_a_file_each():
    bundle = bundled(fleets.plan(2), logs={"kobuki1computer": "line\n" * 40_000 + "the last\n", "kobuki2computer": ""})
    files = bundles.write_files(bundles.remove_secrets(bundle, Secrets()), "", {})
    log = files["logs/kobuki1computer.txt"]
    assert len(log) <= bundles.LOG and log.endswith("line\nthe last\n") and log.startswith("line\n")
    assert "logs/kobuki2computer.txt" not in files and "0.1.0" in files["README.txt"]


@pytest.mark.slow
def test_a_service_that_writes_much_takes_no_room_from_others():
    quiet, loud = "== roscore\nstarted\n", "== sync\n" + "synchronised\n" * 40_000 + "the last\n"
    bundle = bundled(fleets.plan(2), logs={"kobuki1computer": quiet + loud + "== discovery\nready\n"})
    log = bundles.remove_secrets(bundle, Secrets()).logs["kobuki1computer"]
    assert log.startswith(quiet + "== sync\nsynchronised\n") and log.endswith("the last\n== discovery\nready\n")
    assert bundles.LOG - 100 < len(log) <= bundles.LOG


@pytest.mark.parametrize("piece", ["x", "= \\\"'", "token a", "echo -n "])
def test_the_cost_of_a_log_is_that_of_what_is_kept(piece):
    """Ten million letters in lines of anybody took minutes of the controller."""
    line = (piece * 1000)[:1000]
    logs = {"kobuki1computer": f"== sync\n{(line + chr(10)) * 10_000}the last\n"}
    began = time.process_time()
    found = bundles.remove_secrets(bundled(fleets.plan(2), logs=logs), Secrets()).logs["kobuki1computer"]
    assert time.process_time() - began < 10 and found.endswith("the last\n") and len(found) <= bundles.LOG


def test_the_cost_of_an_answer_is_bounded_and_others_lose_nothing(monkeypatch):
    monkeypatch.setattr(bundles, "ROOM", 50_000)
    run = bundled(fleets.plan(2))
    long = {f"text{number}": f"{number} password: {'x' * 400}" for number in range(10_000)}
    machines = {"kobuki1computer": long, "kobuki2computer": {"system": "Debian 12"}}
    began = time.process_time()
    clean = bundles.remove_secrets(bundles.dataclasses.replace(run, machines=machines), Secrets())
    assert time.process_time() - began < 10
    assert clean.machines["kobuki2computer"] == machines["kobuki2computer"]
    assert clean.observations["kobuki2computer"] == run.observations["kobuki2computer"]
    texts = list(clean.machines["kobuki1computer"].values())
    assert texts[0] == f"0 password: {REMOVED}" and texts[-1] == REMOVED and "xxx" not in str(texts)


def test_a_name_before_the_kept_part_tells_its_secret(monkeypatch):
    """The log is cut between the name and its value."""
    monkeypatch.setattr(bundles, "LOG", 100)
    log = "line\n" * 100 + "password:\nswordfish\n" + "line\n" * 16
    found = bundles.remove_secrets(bundled(fleets.plan(2), logs={"kobuki1computer": log}), Secrets())
    assert "swordfish" not in found.logs["kobuki1computer"] and REMOVED in found.logs["kobuki1computer"]


def test_the_name_of_a_computer_is_no_path():
    bundle = bundled(fleets.plan(2))
    texts = bundles.write_files(bundles.dataclasses.replace(bundle, logs={"../../etc/passwd": "x"}), "", {})
    assert "logs/.._.._etc_passwd.txt" in texts


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("plan.json", "{", "has a plan.json that is no JSON"),
        ("plan.json", "[" * 100_000, "has a plan.json that is no JSON, or too deep"),
        ("plan.json", "[]", "has a plan.json that is no mapping"),
        ("plan.json", '{"common_network": NaN}', "no JSON"),
        ("plan.json", '{"common_network": "x"}', "does not fit: common_network is 'x'"),
        ("about.json", '{"format": 7}', "has the format 7; this version reads 1"),
        ("observations.json", '{"kobuki1computer": {"probe": 3}}', "does not fit: probe is 3"),
        ("observations.json", json.dumps(dict.fromkeys(map(str, range(3000)), {})), "has more than 2000 computers"),
        ("plan.json", json.dumps({"common_network": "10.0.0.0/8", "computers": [1]}), "does not fit"),
    ],
)
def test_what_somebody_changed(name, text, said):
    files = bundles.write_files(bundled(fleets.plan(2)), "", {})
    with pytest.raises(UnreadableBundle) as problem:
        reading.read_bundle({**files, name: text})
    assert said in str(problem.value)


def test_unplanned_computers_are_left_out_and_texts_plain():
    files = bundles.write_files(bundled(fleets.plan(2)), "", {})
    seen = json.loads(files["observations.json"])
    seen["stranger"] = {}
    seen["kobuki1computer"]["problem"] = "\x1b[2Jx\n{{ 7 * 7 }}"
    found = reading.read_bundle({**files, "observations.json": json.dumps(seen)})
    assert set(found.observations) == set(found.fleet.computers)
    assert found.observations["kobuki1computer"].problem == "\\x1b[2Jx {{ 7 * 7 }}"


def test_a_report_needs_nothing_that_takes_secrets_out():
    """Each verification imports it, and the patterns of secrets take long to compile."""
    package = "ansible_collections.rosfleet.multimaster.plugins"
    program = f"import sys, {package}.action.fleet_report; print({package + '.plugin_utils._bundle.secrets'!r} in sys.modules)"
    told = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=True,
        env={"PYTHONPATH": ":".join(sys.path)},
    )
    assert told.stdout == "False\n"
