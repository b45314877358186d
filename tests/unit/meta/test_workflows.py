# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The workflows: they run targets of the Makefile that exist, and actions of one revision each."""

import re
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[3]
FOLDER = ROOT / ".github/workflows"
WORKFLOWS = {path.name: yaml.safe_load(path.read_text(encoding="utf-8")) for path in sorted(FOLDER.glob("*.yml"))}
TARGETS = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
PINNED = re.compile(r"actions/[a-z-]+@[0-9a-f]{40}")


def steps(workflow):
    return [step for job in workflow["jobs"].values() for step in job["steps"]]


def targets(workflow):
    return [name for step in steps(workflow) for name in re.findall(r"^ *make ([a-z-]+)", step.get("run", ""), re.M)]


@pytest.mark.parametrize("name", WORKFLOWS)
def test_a_workflow_runs_targets_that_exist_and_may_only_read(name):
    found = WORKFLOWS[name]
    assert targets(found) and set(targets(found)) <= TARGETS
    assert found["permissions"] == {"contents": "read"} and "pull_request_target" not in found["on"]
    assert all(PINNED.fullmatch(step["uses"]) for step in steps(found) if "uses" in step)
    assert "://" not in (FOLDER / name).read_text(encoding="utf-8")


def test_a_pull_request_has_make_quick_with_each_python_and_main_has_make_test():
    events = {target: (found["on"], found) for found in WORKFLOWS.values() for target in targets(found)}
    assert "pull_request" in events["quick"][0] and events["test"][0]["push"] == {"branches": ["main"]}
    (job,) = events["quick"][1]["jobs"].values()
    assert job["strategy"]["matrix"]["python"] == [f"3.{minor}" for minor in range(10, 14)]
