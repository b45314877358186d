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


def test_every_suite_can_run_at_all():
    assert all(0 < found.cores <= runner.CORES for found in runner.SUITES)
    assert len({found.log for found in runner.SUITES}) == len(runner.SUITES)


def test_what_fails_is_named_and_stops_nothing(reports, capsys):
    good, bad = python("print('fine')"), python("print('why'); raise SystemExit(3)", name="two")
    found = runner.Runner([bad, good])
    found.run()
    assert found.outcomes == {good: (1, ()), bad: (0, ("group:two",))}
    assert good.log.read_text() == "fine\n"
    shown = capsys.readouterr().out
    assert "group:two: FAILED, 0 passed, 1 failed" in shown and "\nwhy\n" in shown and "fine" not in shown


def test_a_suite_that_cannot_run_costs_no_other_its_result(reports, tmp_path, capsys):
    def defective(suite, status, output):
        raise ValueError("half a report")

    good, absent = python("", name="good"), suite(str(tmp_path), name="absent")  # a folder is no command
    broken = python("", judge=defective, name="broken")
    runner_of_all = runner.Runner([absent, broken, good])
    runner_of_all.run()
    assert runner_of_all.outcomes[good] == (1, ())
    assert runner.summary(runner_of_all.outcomes) == (1, 2)
    shown = capsys.readouterr().out.splitlines()
    assert shown[-1] == "1 passed, 2 failed"
    assert any(line.startswith("FAILED group:broken (ValueError: half a report)") for line in shown)


def test_a_lab_that_cannot_be_removed_fails_its_suite(reports):
    found = runner.Runner(
        [runner.Suite("group", "one", ("true",), runner.judge_status, labs=("none",))]
    )  # no lab.py here
    found.run()
    (outcome,) = found.outcomes.values()
    assert outcome.failed == ("group:one",)


def test_suites_run_side_by_side_as_far_as_the_processors_allow(reports, monkeypatch):
    monkeypatch.setattr(runner, "CORES", 2.0)
    # Each waits until both are there.
    code = "import pathlib, time; pathlib.Path('{0}').touch()\nwhile not pathlib.Path('{1}').exists(): time.sleep(.01)"
    pair = [python(code.format("a", "b"), name="a"), python(code.format("b", "a"), name="b")]
    alone = python("import pathlib; assert pathlib.Path('a').exists()", cores=2.0, name="c")
    found = runner.Runner([*pair, alone])
    found.run()
    assert [outcome.passed for outcome in found.outcomes.values()] == [1, 1, 1]


def test_suites_of_one_lab_run_one_after_the_other(reports, monkeypatch):
    monkeypatch.setattr(runner, "CORES", 2.0)
    monkeypatch.setattr(runner, "take_down", lambda labs: [])
    code = "import pathlib, time; own = pathlib.Path('lab'); own.mkdir(); time.sleep(.2); own.rmdir()"
    words = (sys.executable, "-c", code)
    pair = [runner.Suite("group", name, words, runner.judge_status, labs=("one",)) for name in ("a", "b")]
    found = runner.Runner(pair)
    found.run()
    assert [outcome.passed for outcome in found.outcomes.values()] == [1, 1]


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


def test_the_failed_sanity_tests_are_named():
    judged = suite("ansible-test", judge=runner.judge_sanity)
    output = (
        'Running sanity test "pep8"\nRunning sanity test "import" on Python 3.8\nRunning sanity test "shebang"\n'
        "FATAL: The 1 sanity test(s) listed below (out of 3) failed. See error output above for details.\n"
        "import --python 3.8\n"
    )
    assert judged.judge(judged, 1, output) == (2, ("group:one import --python 3.8",))
    assert judged.judge(judged, 0, output.partition("FATAL")[0]) == (3, ())


def test_the_faults_that_were_not_named_first_are_named():
    suite = next(suite for suite in runner.SUITES if suite.group == "faults")
    told = suite.judge(suite, 1, "[1/3] clock ...\n\n1 of 3 named first; not: filter_icmp, loss\n")
    assert told == runner.Outcome(1, ("faults:catalogue filter_icmp", "faults:catalogue loss"))
    assert suite.judge(suite, 0, "3 of 3 named first\n") == runner.Outcome(3)
    assert suite.judge(suite, 1, "faults: site.yml has failed\n").failed == ("faults:catalogue",)
