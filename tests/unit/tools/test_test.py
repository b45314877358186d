# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The runner of the tests: what it runs, and how it tells what failed."""

import re
import subprocess
import sys
import time

import pytest

from tools import test as runner


def suite(*command, judge=runner.judge_status, cores=1.0, name="one", limit=60.0):
    return runner.Suite("group", name, command, judge, cores, limit=limit)


def python(code, **more):
    return suite(sys.executable, "-c", code, **more)


def state(process):
    """The state of a process, as `ps` tells it; empty where there is none."""
    words = ["ps", "-o", "stat=", process]
    return subprocess.run(words, stdout=subprocess.PIPE, text=True, check=False).stdout.strip()


@pytest.fixture
def reports(tmp_path, monkeypatch):
    monkeypatch.setattr(runner, "ROOT", tmp_path)
    monkeypatch.setattr(runner, "REPORTS", tmp_path / "reports")
    (tmp_path / "reports").mkdir()


def test_all_tests_on_real_systems_are_in_a_suite_with_their_lab():
    folder = runner.ROOT / "tests" / "systems"
    quick = [suite for suite in runner.systems() if "not costly" in suite.command]
    files = [file for suite in quick for file in suite.command if file.startswith("tests/systems/")]
    assert sorted(files) == sorted(f"tests/systems/{path.name}" for path in folder.glob("test_*.py"))
    for found in quick:
        text = "".join((runner.ROOT / file).read_text() for file in found.command if file in files)
        assert {f'"{name}"' for name in found.labs} >= set(re.findall(r'"systems-[a-z-]+"', text)), found.name
    costly = {file for file in files if "pytest.mark.costly" in (runner.ROOT / file).read_text()}
    assert costly == {
        file for suite in runner.systems() if suite not in quick for file in suite.command if file in files
    }


def test_suites_are_found_by_group_and_by_name():
    assert {found.group for found in runner.choose_suites(["systems"])} == {"systems"}
    assert [found.label for found in runner.choose_suites(["molecule:default"])] == ["molecule:default"]
    assert {"lint:mypy", "unit:quick"} < {found.label for found in runner.choose_suites(["check"])}
    assert {"lint:mypy", "quick:unit"} < {found.label for found in runner.choose_suites(["quick"])}
    assert not {found.group for found in runner.choose_suites([])} & runner.ON_REQUEST
    with pytest.raises(SystemExit, match="no suite sistems"):
        runner.choose_suites(["sistems"])


def test_what_fails_is_named_and_stops_nothing(reports, capsys):
    good, bad = python("print('fine')"), python("print('why'); raise SystemExit(3)", name="two")
    found = runner.Runner([bad, good])
    found.run()
    assert found.outcomes == {good: (1, ()), bad: (0, ("group:two",))}
    assert good.log.read_text() == "fine\n"
    shown = capsys.readouterr().out
    assert "group:two: FAILED, 0 passed, 1 failed" in shown and "\nwhy\n" in shown and "fine" not in shown


@pytest.mark.slow
def test_a_suite_that_hangs_is_ended_with_all_that_it_started(reports):
    hangs = suite("bash", "-c", "sleep 1000 & echo $!; wait", limit=4.0)  # a busy machine takes a while to start bash
    found = runner.Runner([hangs])
    found.run()
    assert found.outcomes[hangs].failed == ("group:one",)
    child, _empty, sentence = hangs.log.read_text().splitlines()
    assert sentence == "It was ended after 4 s."
    until = time.monotonic() + 30  # it was killed, and ends when a processor is free for that
    while state(child) not in ("", "Z", "Zs"):
        assert time.monotonic() < until, "the child runs on"
        time.sleep(0.05)


def test_the_failed_cases_of_pytest_are_named(reports, tmp_path):
    judged = suite("pytest", judge=runner.judge_pytest)
    assert judged.judge(judged, 4, "") == (0, ("group:one",))
    judged.report.write_text(
        '<testsuites><testsuite><testcase classname="tests.unit.test_a" name="test_x"/>'
        '<testcase classname="tests.unit.test_a" name="test_y[1]"><failure/></testcase>'
        '<testcase classname="tests.unit.test_a" name="test_z"><skipped/></testcase></testsuite></testsuites>'
    )
    assert judged.judge(judged, 1, "") == (1, ("tests/unit/test_a.py::test_y[1]",))
