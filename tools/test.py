# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Runs the tests: all that 'make test' has, or the groups that are named; ends with the line "N passed, N failed".

Every part runs, whatever became of the ones before. What is counted: test cases of pytest, sanity tests of ansible-test
(one per interpreter), Molecule scenarios, tools of the lint group, demonstrations.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
BIN = Path(sys.executable).parent
REPORTS = ROOT / ".work" / "test"


class Count(NamedTuple):
    """How many tests ended how."""

    passed: int
    failed: int


def one(status: int, _output: str) -> Count:
    """A command that is one test."""
    return Count(int(status == 0), int(status != 0))


def sanity_tests(status: int, output: str) -> Count:
    """ansible-test names each test as it runs it, and at the end those that failed."""
    run = len(re.findall(r"^Running sanity test ", output, re.MULTILINE))
    listed = re.search(r"The (\d+) sanity test\(s\) listed below", output)
    failed = int(listed[1]) if listed else int(status != 0)
    return Count(max(run - failed, 0), failed)


def pytest_cases(report: Path) -> Callable[[int, str], Count]:
    """pytest writes a JUnit file; without one it did not get as far as the tests."""

    def count(status: int, _output: str) -> Count:
        if not report.exists():
            return one(status or 1, "")
        suites = ET.parse(report).getroot().iter("testsuite")
        totals = [
            {key: int(suite.get(key, 0)) for key in ("tests", "failures", "errors", "skipped")} for suite in suites
        ]
        failed = sum(total["failures"] + total["errors"] for total in totals)
        passed = sum(total["tests"] - total["skipped"] for total in totals) - failed
        return Count(passed, failed or int(status != 0))

    return count


@dataclass(frozen=True)
class Suite:
    """One command of a group."""

    group: str
    name: str
    command: Sequence[str]
    count: Callable[[int, str], Count] = one
    shown: bool = False  # whether its output is shown as it comes, or only when it fails
    labs: Sequence[str] = ()  # what it runs in: nothing is there when it begins, and nothing stays


def vermin(target: str, *paths: str) -> Suite:
    """Nothing newer than a Python version in these folders."""
    present = [path for path in paths if (ROOT / path).exists()]
    return Suite("lint", f"vermin {target}", ["vermin", f"--target={target}-", "--no-tips", "--violations", *present])


def cases(group: str, *labs: str, options: Sequence[str] = ()) -> Suite:
    """The test cases of a folder of tests/."""
    report = REPORTS / f"{group}.xml"
    command = ["pytest", "--quiet", *options, f"--junit-xml={report}", f"tests/{group}"]
    return Suite(group, "pytest", command, pytest_cases(report), shown=True, labs=labs)


def scenarios() -> list[Suite]:
    """The Molecule scenarios."""
    names = sorted(path.parent.name for path in (ROOT / "extensions" / "molecule").glob("*/molecule.yml"))
    return [
        Suite("molecule", name, ["molecule", "test", "--scenario-name", name], shown=True, labs=[f"molecule-{name}"])
        for name in names
    ]


def demonstration(layout: str) -> Suite:
    """One layout in the lab; its second run, on systems that are as they should be, is a person's affair."""
    lab = "test-demo"  # a person may have theirs up
    command = [sys.executable, "tests/lab/demo.py", "--layout", layout, "--name", lab]
    return Suite("demo", layout, command, shown=True, labs=[lab])


SUITES = [
    Suite("lint", "ansible-lint", ["ansible-lint", "--offline", "--nocolor"]),
    Suite("lint", "yamllint", ["yamllint", "--strict", "."]),
    Suite("lint", "ruff check", ["ruff", "check", "--no-cache", "."]),
    Suite("lint", "ruff format", ["ruff", "format", "--no-cache", "--diff", "."]),
    Suite("lint", "mypy", ["mypy"]),
    vermin("3.6", "plugins/modules", "plugins/module_utils"),
    vermin("3.8", "roles/nodes/files/python"),
    vermin("3.10", "plugins/action", "plugins/filter", "plugins/lookup", "plugins/plugin_utils"),
    Suite("lint", "shellcheck", ["shellcheck", ".ci/run", "tools/setup.sh", "tests/lab/files/make-opt-ros"]),
    Suite("lint", "reuse", ["reuse", "lint", "--lines"]),
    Suite("lint", "antsibull-changelog", ["antsibull-changelog", "lint"]),
    Suite("lint", "antsibull-docs", ["antsibull-docs", "lint-collection-docs", "--plugin-docs", "."]),
    Suite("lint", "readme", [sys.executable, "tools/readme.py", "--check"]),
    Suite("sanity", "ansible-test", [sys.executable, "tools/sanity.py"], sanity_tests, shown=True),
    cases("unit", options=["--numprocesses=auto"]),
    *scenarios(),
    cases(
        "systems",
        "systems",
        "systems-cut-off",
        "systems-fourth",
        "systems-placement",
        "systems-links",
        "systems-data-flow",
        "systems-clock",
        "systems-exchanges",
    ),
    demonstration("single_computer"),
    demonstration("multi_computer"),
    cases("long", "long-links", "long-fuzz"),
    cases("interop", "interop"),
]

#: groups that run only when they are named: what takes hours, or needs what the project does not have
ON_REQUEST = {"interop", "long"}


def environment() -> dict[str, str]:
    """The tools of .work/venv first; the checkout as the collection."""
    collections = ROOT / ".work" / "collections"
    return {
        **os.environ,
        "PATH": f"{BIN}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": str(collections),
        "ANSIBLE_COLLECTIONS_PATH": str(collections),
        "LC_ALL": "C.UTF-8",
        "NO_COLOR": "1",
    }


def take_down(labs: Sequence[str]) -> None:
    """Remove labs, as far as there are any."""
    for lab in labs:
        subprocess.run([sys.executable, "tests/lab/lab.py", "down", "--name", lab], cwd=ROOT, check=False)


def run(suite: Suite) -> Count:
    """Run one suite and say how it went."""
    label = f"{suite.group}: {suite.name}"
    print(f"== {label} ...", flush=True)
    take_down(suite.labs)
    started = time.monotonic()
    output = []
    try:
        process = subprocess.Popen(
            suite.command, cwd=ROOT, env=environment(), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
    except FileNotFoundError:
        print(f"{suite.command[0]} was not found: run 'make setup'.")
        status = 127
    else:
        assert process.stdout
        for line in process.stdout:
            output.append(line)
            if suite.shown:
                print(line, end="", flush=True)
        status = process.wait()
    take_down(suite.labs)
    text = "".join(output)
    if status and not suite.shown:
        print(text, end="")
    count = suite.count(status, text)
    verdict = "ok" if status == 0 and not count.failed else "FAILED"
    print(
        f"== {label}: {verdict}, {count.passed} passed, {count.failed} failed ({time.monotonic() - started:.1f} s)",
        flush=True,
    )
    return count


def main() -> int:
    """Return 1 when a test failed or none ran."""
    groups = sys.argv[1:] or [
        group for group in dict.fromkeys(suite.group for suite in SUITES) if group not in ON_REQUEST
    ]
    shutil.rmtree(REPORTS, ignore_errors=True)
    REPORTS.mkdir(parents=True)
    started = time.monotonic()
    counts = []
    for group in groups:
        counts += [run(suite) for suite in SUITES if suite.group == group]
    total = Count(sum(count.passed for count in counts), sum(count.failed for count in counts))
    print(f"== all of {', '.join(groups)} took {time.monotonic() - started:.0f} s")
    print(f"{total.passed} passed, {total.failed} failed")
    return int(total.failed > 0 or total.passed == 0)


if __name__ == "__main__":
    sys.exit(main())
