# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The playbook report.yml, by ansible-playbook itself, on a bundle that somebody sent: no robot, and nothing of it is run."""

import json
import os
import pathlib
import subprocess
import sys
from xml.etree import ElementTree

import fleets
import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._bundle import archive
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._bundle.bundle import write_files
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report.run import Run
from mentioned import mentions

ROOT = pathlib.Path(__file__).resolve().parents[3]

pytestmark = pytest.mark.whole

ABOUT = {"time": "2026-11-22 14:02:00", "collection": "0.1.0", "ansible": "2.19.0", "pairs": "all"}


def played(tmp_path, change, *options, callbacks=""):
    """Run the playbook on a bundle in which `change` was made; returns exit status and output."""
    fleet = fleets.fig12()
    seen = fleets.observed(fleet)
    change(seen)
    files = write_files(Run(fleet, seen, {}, ABOUT), "", {})
    (tmp_path / "help.zip").write_bytes(archive.pack(files, (2026, 11, 22, 14, 2, 0)))
    done = subprocess.run(
        [
            pathlib.Path(sys.executable).with_name("ansible-playbook"),
            *("-i", "localhost,", ROOT / "playbooks/report.yml", "-e", f"bundle={tmp_path / 'help.zip'}", *options),
        ],
        cwd=tmp_path,
        env={
            **os.environ,
            "ANSIBLE_CONFIG": str(ROOT / "ansible.cfg"),
            "ANSIBLE_COLLECTIONS_PATH": str(ROOT / ".work/collections"),
            "ANSIBLE_HOME": str(tmp_path / "ansible"),
            "ANSIBLE_NOCOLOR": "1",
            **({"ANSIBLE_CALLBACKS_ENABLED": callbacks} if callbacks else {}),
            "JUNIT_OUTPUT_DIR": str(tmp_path / "junit"),
            "LC_ALL": "C.UTF-8",
        },
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    return done.returncode, done.stdout + done.stderr


def jinja(seen):
    """A fault that is told with the words of somebody."""
    fleets.second_default_route(seen)
    text = "{{ lookup('ansible.builtin.pipe', 'touch run') }} {% for x in [] %}"
    seen["tibi-nav"] = fleets.Observation(unreachable=True, problem=text)


@pytest.mark.slow
def test_all_is_well(tmp_path):
    status, output = played(tmp_path, lambda seen: None)
    assert status == 0 and "PASSED: none of " in output, output
    pages = list((tmp_path / "ansible/rosfleet/reports").glob("help.zip-*/*.html"))
    assert len(pages) == 1 and f"Report: {pages[0]}" in output


def test_what_is_wrong_is_told_and_nothing_of_the_bundle_is_run(tmp_path):
    status, output = played(tmp_path, jinja, "-e", "bundle_report=found.json explain=all")
    assert status == 2 and "has 2 default routes" in output or "default route" in output, output
    assert json.loads((tmp_path / "found.json").read_text())["verdict"] == "failed"
    assert "Finding 1, RF-" in output and "decided by: rule 3 of 10, value:" in output
    assert "lookup(" in output and not list(tmp_path.glob("**/run"))


def cases(tmp_path):
    (file,) = (tmp_path / "junit").iterdir()
    return [case for case in ElementTree.parse(file).iter("testcase") if "fleet_report" not in str(case.get("name"))]


@pytest.mark.slow
@pytest.mark.parametrize(("option", "told"), [("auto", True), ("never", False)])
def test_what_records_the_run_has_a_result_for_each_finding(tmp_path, option, told):
    def change(seen):
        fleets.wall(seen)
        jinja(seen)

    status, output = played(
        tmp_path, change, "-e", f"verify_each={option} bundle_report=found.json", callbacks="ansible.builtin.junit"
    )
    assert status == 2, output
    findings = json.loads((tmp_path / "found.json").read_text())["findings"]
    assert len(findings) > 1 and not list(tmp_path.glob("**/run"))
    names = " ".join(str(case.get("name")) for case in cases(tmp_path))
    assert [entry["sentence"][:40] in names for entry in findings] == [told] * len(findings), names


def test_at_a_terminal_the_findings_are_told_once(tmp_path):
    status, output = played(tmp_path, fleets.second_default_route)
    assert status == 2 and output.count("fatal: [localhost]") == 1, output
    assert output.count("car-ext has two default routes") == 1


def test_a_bundle_that_is_none(tmp_path):
    status, output = played(tmp_path, lambda seen: None, "-e", "bundle=none.zip")
    assert status == 2 and mentions(output, "none.zip", "directory")
