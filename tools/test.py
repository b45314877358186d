# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Runs the tests: all of 'make test', or the groups and suites that are named; ends with the line "N passed, N failed".

    python tools/test.py [GROUP | GROUP:NAME | check | quick]...

Suites run side by side as far as the processors allow. Each writes a log into .work/test. The screen shows the beginnings
and the ends, and once a minute the suites that still run. A failure stops no other suite. The last lines name each failed
test and its log.

A test is: a test case of pytest, a sanity test of ansible-test (one per interpreter), a Molecule scenario, a tool of the
lint group, a demonstration, a fault of the catalogue.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
BIN = Path(sys.executable).parent
REPORTS = ROOT / ".work" / "test"

CORES = float(max(2, os.cpu_count() or 1))
HEARTBEAT = 60.0  # seconds between two lines about the suites that still run
LIMIT = 1800.0  # seconds that a suite may take, also on a busy machine
LONG_LIMIT = 6 * 3600.0
REMOVAL = 300.0  # seconds for removing a lab
TAIL = 40  # lines of the log that are shown when a suite fails


class Outcome(NamedTuple):
    """The result of a suite: how many tests passed, and the names of those that failed."""

    passed: int
    failed: tuple[str, ...] = ()


@dataclass(frozen=True)
class Suite:
    """One command."""

    group: str
    name: str
    command: Sequence[str]
    judge: Callable[[Suite, int, str], Outcome]
    cores: float = 1.0  # about how many processors it keeps busy
    seconds: float = 1.0  # about how long it takes; the longest begin first
    labs: Sequence[str] = ()  # the labs that it brings up: removed before it begins and after it ends
    limit: float = LIMIT

    @property
    def label(self) -> str:
        """The name on the screen and on the command line."""
        return f"{self.group}:{self.name}"

    @property
    def log(self) -> Path:
        """The file for everything that the command prints."""
        return REPORTS / f"{self.group}-{self.name}.log".replace(" ", "-")

    @property
    def report(self) -> Path:
        """The JUnit file, if the command writes one."""
        return self.log.with_suffix(".xml")


# How the commands report failures


def judge_status(suite: Suite, status: int, _output: str) -> Outcome:
    """A command that is one test."""
    return Outcome(0, (suite.label,)) if status else Outcome(1)


def judge_sanity(suite: Suite, status: int, output: str) -> Outcome:
    """ansible-test names each test when it runs it, and at the end those that failed."""
    run = len(re.findall(r"^Running sanity test ", output, re.MULTILINE))
    listed = re.search(r"The \d+ sanity test\(s\) listed below.*\n((?:.+\n)+)", output)
    failed = tuple(f"{suite.label} {line.strip()}" for line in listed[1].splitlines()) if listed else ()
    if status and not failed:
        failed = (suite.label,)
    return Outcome(max(run - len(failed), 0), failed)


def faults(suite: Suite, status: int, output: str) -> Outcome:
    """The catalogue of faults names those that were not as expected; each fault is a test."""
    counts = re.search(r"^(\d+) of (\d+) named first(?:; not: (.+))?$", output, re.MULTILINE)
    if counts is None:
        return Outcome(0, (suite.label,))
    named = tuple(f"{suite.label} {name}" for name in (counts[3] or "").split(", ") if name)
    return Outcome(int(counts[1]), named or ((suite.label,) if status else ()))


def judge_pytest(suite: Suite, status: int, _output: str) -> Outcome:
    """pytest writes a JUnit file; without one it did not get as far as the tests."""
    if not suite.report.exists():
        return Outcome(0, (suite.label,))
    passed, failed = 0, []
    try:
        report = ET.parse(suite.report)
    except ET.ParseError:  # pytest was ended while it wrote
        return Outcome(0, (suite.label,))
    for case in report.getroot().iter("testcase"):
        results = {result.tag for result in case}
        if results & {"failure", "error"}:
            failed.append(f"{case.get('classname', '').replace('.', '/')}.py::{case.get('name')}")
        elif "skipped" not in results:
            passed += 1
    if status and not failed:
        failed.append(suite.label)
    return Outcome(passed, tuple(failed))


# The suites


def lint(name: str, *command: str, seconds: float = 1.0) -> Suite:
    """A tool that looks at files."""
    return Suite("lint", name, command, judge_status, seconds=seconds)


def vermin(target: str, *paths: str) -> Suite:
    """A check that nothing in these folders is newer than a Python version."""
    present = [path for path in paths if (ROOT / path).exists()]
    return lint(f"vermin {target}", "vermin", f"--target={target}-", "--no-tips", "--violations", *present)


def cases(
    group: str,
    name: str,
    *words: str,
    cores: float = 1.0,
    seconds: float = 1.0,
    labs: Sequence[str] = (),
    limit: float = LIMIT,
) -> Suite:
    """Test cases of pytest; `words` are files, folders and options."""
    blank = Suite(group, name, (), judge_pytest, cores, seconds, labs, limit)
    command = ("pytest", "--quiet", f"--junit-xml={blank.report}", "-p", "no:cacheprovider", *words)
    return Suite(group, name, command, judge_pytest, cores, seconds, labs, limit)


def more_mixtures(suite: Suite) -> Suite:
    """The suite with many mixtures of files as people have them (tests/unit/helpers/field.py)."""
    return replace(suite, command=("env", "FIELD_EXAMPLES=500", *suite.command))


#: Molecule scenarios and files of tests/systems: about how long each takes with others, in seconds. One that is not here is short.
SECONDS = {
    "multi_computer": 300,
    "default": 185,
    "existing": 100,
    "routes": 300,
    "robots": 800,
    "services": 650,
    "links": 270,
    "alone": 60,
    "data_flow": 170,
    "cut_off": 620,
    "placement": 165,
    "fourth_robot": 300,
    "clock": 150,
    "firewall": 250,
    "exchanges": 80,
    "hostile_robot": 240,
    "people_nodes": 170,
    "removal": 240,
    "prefixes": 200,
    "relay": 390,
    "sealed": 80,
    "images": 40,
    "network_files": 200,
}

#: Files of tests/systems that have a lab in common, by its name. All others have one each: "systems-NAME".
#: In this order: the first tests of `faults` need a lab that site.yml has not seen yet, the README ends with the teardown,
#: and `kernel_settings`, `cloud_init` and `roscore` boot a computer.
IN_COMMON = {
    "robots": ("faults", "router_config", "strangers", "bundle", "traffic", "readme"),
    "services": ("sandbox", "metrics", "first_words", "root", "kernel_settings", "packages", "cloud_init", "roscore"),
}

#: Tests that mostly wait.
WAITING = {"clock", "exchanges"}

#: About how much of a processor a lab keeps busy: the rest of its time it waits for services, clocks and answers.
LAB_CORES = 0.66

#: pytest's options for the tests that 'make test' leaves to 'make test-long', or the other way round.
QUICK, THE_COSTLY = ("-m", "not costly"), ("-m", "costly")

#: The options for those of 'make quick': with fewer random examples.
CHEAP = ("-m", "not slow and not costly and not whole", "--hypothesis-profile=quick")

UNIT = (f"--numprocesses={int(CORES) + 1}", "tests/unit")

#: Those of 'make quick' wait little, and each process more reads all files once more.
QUICK_UNIT = (f"--numprocesses={int(CORES)}", "tests/unit")

#: About how many processors the unit tests keep busy: many of them wait, so one more runs than there are processors.
UNIT_CORES = 1.0

#: Tests that assert times of tenths of a second: nothing else runs meanwhile.
TIMED = {"alone", "links", "data_flow"}

#: Files of tests/systems and Molecule scenarios that are part of 'make test-long', since they take minutes. The demonstration
#: of the multi-computer layout shows the same fleet in every run, but for its restart, its teardown, and a master on an inner
#: computer; an existing roscore is also one of `data_flow`. `removal` tests only the lab. The effect of a clock that steps on the
#: nodes, and the files of `routes` for each network manager, are also tested by unit tests; each manager boots in `alone`.
COSTLY = {
    *(
        "relay",
        "relay_faults",
        "clock",
        "exchanges",
        "existing",
        "fourth_robot",
        "guard",
        "links",
        "multi_computer",
        "placement",
        "prefixes",
        "removal",
        "restarts",
        "routes",
    ),
    *("time_source", "tunnel"),
}

#: Faults that are drawn by a seed, each of another kind, each of which breaks something: the numbers of those of 'make test',
#: and of those of 'make test-long'.
DRAWN, DRAWN_MORE = (
    ("25", "103"),
    ("166", "2", "4", "13", "28", "29", "33", "48", "82", "100", "148"),
)


def scenarios() -> list[Suite]:
    """The Molecule scenarios."""
    names = sorted(path.parent.name for path in (ROOT / "extensions" / "molecule").glob("*/molecule.yml"))
    return [
        Suite(
            "long" if name in COSTLY else "molecule",
            name,
            ("molecule", "test", "--scenario-name", name),
            judge_status,
            cores=LAB_CORES,
            seconds=SECONDS.get(name, 60),
            labs=(f"molecule-{name}",),
        )
        for name in names
    ]


def systems() -> list[Suite]:
    """The tests on real systems, a suite for each lab."""
    names = sorted(path.stem.removeprefix("test_") for path in (ROOT / "tests" / "systems").glob("test_*.py"))

    def suites(name: str, *stems: str) -> Iterator[Suite]:
        lab = f"systems-{name.replace('_', '-')}"
        files = [f"tests/systems/test_{stem}.py" for stem in stems or (name,)]
        costly = [file for file in files if "pytest.mark.costly" in (ROOT / file).read_text()]
        words = (f"--lab={lab}", "--durations=15")
        cores = CORES if name in TIMED else 0.5 if name in WAITING else LAB_CORES
        group = "long" if name in COSTLY else "systems"
        yield cases(group, name, *QUICK, *words, *files, cores=cores, seconds=SECONDS.get(name, 60), labs=(lab,))
        if costly:
            yield cases("long", f"{name}_costly", *THE_COSTLY, *words, *costly, cores=cores, labs=(lab,))

    shared = {stem for stems in IN_COMMON.values() for stem in stems}
    labs = {**IN_COMMON, **{name: () for name in names if name not in shared}}
    return [suite for name, stems in labs.items() for suite in suites(name, *stems)]


def demonstration(name: str, seconds: float, *options: str, layout: str = "", group: str = "demo") -> Suite:
    """One layout in the lab, from nothing to a fleet that talks."""
    lab = f"test-demo-{name.partition('_')[0]}"  # a person may have a lab of the name "demo" up
    command = (sys.executable, "lab/demo.py", "--layout", layout or name, "--name", lab, *options)
    return Suite(group, name, command, judge_status, cores=LAB_CORES, seconds=seconds, labs=(lab,))


def draw(group: str, *numbers: str) -> Suite:
    """Faults that are drawn at random, by a seed."""
    words = (sys.executable, "tests/faults/fuzz.py", "--seed=3", "--labs=2", "--only", *numbers)
    return Suite(group, "drawn", words, faults, cores=LAB_CORES, seconds=45.0 * len(numbers), labs=("fuzz", "fuzz1"))


SUITES = [
    lint("ansible-lint", "ansible-lint", "--offline", "--nocolor", seconds=20),
    lint("yamllint", "yamllint", "--strict", "."),
    lint("ruff check", "ruff", "check", "--no-cache", "."),
    lint("ruff format", "ruff", "format", "--no-cache", "--diff", "."),
    lint("mypy", "mypy", seconds=15),
    vermin("3.6", "plugins/modules", "plugins/module_utils"),
    vermin("3.8", "roles/nodes/files/python"),
    vermin("3.10", "plugins/action", "plugins/filter", "plugins/lookup", "plugins/plugin_utils"),
    lint(
        "shellcheck",
        "shellcheck",
        *(
            ".ci/run",
            "tools/setup.sh",
            "tools/lock.sh",
            "lab/files/make-opt-ros",
            "lab/files/node-box",
            "lab/files/ros-box",
            "lab/files/wire",
        ),
    ),
    lint("reuse", "reuse", "lint", "--lines"),
    lint("antsibull-changelog", "antsibull-changelog", "lint"),
    lint("antsibull-docs", "antsibull-docs", "lint-collection-docs", "--plugin-docs", ".", seconds=7),
    lint("readme", sys.executable, "tools/readme.py", "--check"),
    lint("references", sys.executable, "tools/references.py", "--check"),
    lint("findings", sys.executable, "tools/findings.py", "--check"),
    lint("contract", sys.executable, "tools/contract.py", "--check"),
    cases("unit", "quick", *UNIT, "-m", "not slow and not costly", cores=UNIT_CORES, seconds=200),
    cases("unit", "slow", *UNIT, "-m", "slow and not costly", cores=UNIT_CORES, seconds=120),
    cases("quick", "unit", *QUICK_UNIT, *CHEAP, cores=UNIT_CORES, seconds=90),
    cases("browser", "page", "tests/browser", seconds=20),
    Suite(
        "sanity",
        "ansible-test",
        (sys.executable, "tools/sanity.py"),
        judge_sanity,
        cores=LAB_CORES,  # or it would wait until the labs are through
        seconds=420,
    ),
    *scenarios(),
    *systems(),
    Suite(
        "long",
        "catalogue",
        (sys.executable, "tests/faults/run.py", "--quick"),
        faults,
        cores=LAB_CORES,
        seconds=420,
        labs=("faults",),
    ),
    draw("systems", *DRAWN),
    draw("long", *DRAWN_MORE),
    demonstration("multi_computer", 330, "--suite=dabo-visio=trixie"),  # both releases
    demonstration("single_computer", 80, "--suite=kobuki2computer=trixie", group="long"),
    demonstration("identical_robots", 150, group="long"),
    demonstration("tunnel", 150, group="long"),
    cases(
        "long",
        "pytest",
        "tests/long",
        labs=(
            *("long-links", "long-fuzz", "long-alone", "long-hostile", "long-strangers", "long-roscore", "long-soak"),
            *("long-firewall", "long-firewall-broken-off", "long-gateways", "long-watch", "long-adopt", "long-upgrade"),
            *("long-seeded", "rehearse.long"),
        ),
        limit=LONG_LIMIT,
    ),
    cases("long", "site", "tests/site", seconds=90),  # the documentation
    cases("machines", "pytest", "--verbose", "tests/machines", cores=CORES, limit=LONG_LIMIT),  # virtual ones
    cases("systems", "machines", "tests/machines/test_pair.py", *QUICK, cores=CORES, seconds=215),
    cases("long", "unit", *UNIT, *THE_COSTLY),
    more_mixtures(cases("long", "field", "tests/unit/field", seconds=300)),
    *(
        Suite(
            "long", f"sanity_{line}", (sys.executable, "tools/sanity.py", f"--core={line}"), judge_sanity, seconds=240
        )
        for line in ("2.16", "2.18", "2.20")
    ),
    demonstration("bullseye", 90, "--suite=bullseye", layout="single_computer", group="long"),
    Suite(
        "faults",
        "catalogue",
        (sys.executable, "tests/faults/run.py", "--remedy", "--page"),
        faults,
        labs=("faults",),
        limit=LONG_LIMIT,
    ),
    cases(
        "interop",
        "pytest",
        "tests/interop",
        labs=("interop", "by-hand", "in-tunnel", "relay-beside"),
        limit=LONG_LIMIT,
    ),
]

#: Groups that run only when they are named: they take hours, need things that the project does not have, or are part of others.
ON_REQUEST = {"faults", "interop", "long", "machines", "quick"}

#: The suites for every commit: files, types, most unit tests, and one pair of robots from nothing to messages.
CHECK = ("lint", "unit:quick", "long:single_computer")

#: The suites that everybody can run, with the few packages of requirements-quick.txt.
ANYWHERE = ("ruff check", "ruff format", "yamllint", "reuse", "mypy", "vermin 3.6", "vermin 3.8", "vermin 3.10")

#: Words that name several suites.
WORDS = {"check": CHECK, "quick": ("quick:unit", *(f"lint:{name}" for name in ANYWHERE))}


def choose_suites(words: Sequence[str]) -> list[Suite]:
    """The suites that are named, those that end early first; all but those on request, if the words name no suite."""
    names = [name for word in words for name in WORDS.get(word, (word,))]
    known = {suite.group for suite in SUITES} | {suite.label for suite in SUITES}
    unknown = [name for name in names if name not in known]
    if unknown:
        raise SystemExit(
            f"There is no suite {', '.join(unknown)}; expected some of: {', '.join(WORDS)}, {', '.join(sorted(known))}"
        )
    found = [
        suite
        for suite in SUITES
        if (suite.group in names or suite.label in names if names else suite.group not in ON_REQUEST)
    ]
    # Mistakes in files show at once; then the longest first, or one of them would be the last and the only one.
    early = {"lint": 0, "quick": 0, "unit": 1}
    return sorted(found, key=lambda suite: (early.get(suite.group, 2), suite.cores == CORES, -suite.seconds))


# Running them


class Runner:
    """Runs suites side by side, and reports beginnings and ends."""

    def __init__(self, suites: Sequence[Suite]) -> None:
        self.waiting = list(suites)
        self.outcomes: dict[Suite, Outcome] = {}
        self._total = len(suites)
        self._began = time.monotonic()
        self._running: dict[Future[Outcome], tuple[Suite, float]] = {}
        self._processes: set[subprocess.Popen[bytes]] = set()
        self._stopped = False

    def run(self) -> None:
        """Run all of them. Whatever ends this early ends the commands, and removes their labs."""
        with ThreadPoolExecutor(max_workers=self._total) as pool:
            try:
                while self.waiting or self._running:
                    self._begin(pool)
                    done, _others = wait(self._running, timeout=HEARTBEAT, return_when=FIRST_COMPLETED)
                    if not done:
                        self.say(f"{len(self.outcomes)} of {self._total} suites have ended; running: {self._list()}")
                    for future in done:
                        self._end(future)
            except BaseException:
                self._stopped = True
                for number in (signal.SIGTERM, signal.SIGINT):
                    signal.signal(number, lambda *_about: None)  # it ends already, and its files are removed first
                for process in list(self._processes):
                    _kill(process)
                raise

    def say(self, text: str) -> None:
        """A line with the time since the beginning."""
        minutes, seconds = divmod(int(time.monotonic() - self._began), 60)
        print(f"[{minutes:3}:{seconds:02}] {text}", flush=True)

    def _list(self) -> str:
        now = time.monotonic()
        return ", ".join(f"{suite.label} ({now - began:.0f} s)" for suite, began in self._running.values())

    def _begin(self, pool: ThreadPoolExecutor) -> None:
        """Start the suites that fit with the running ones, and have no lab of theirs: two of one name would remove each other's."""
        free = CORES - sum(suite.cores for suite, _began in self._running.values())
        labs = {lab for suite, _began in self._running.values() for lab in suite.labs}
        for suite in list(self.waiting):
            if suite.cores > free and suite.cores == CORES:
                return  # it would never begin if others went before it
            if suite.cores <= free and labs.isdisjoint(suite.labs):
                free -= suite.cores
                labs.update(suite.labs)
                self.waiting.remove(suite)
                self.say(f"{suite.label} ...")
                self._running[pool.submit(self._suite, suite)] = (suite, time.monotonic())

    def _end(self, future: Future[Outcome]) -> None:
        suite, began = self._running.pop(future)
        try:
            outcome = future.result()
        except Exception as problem:  # a defect of this program costs no other suite its result
            outcome = Outcome(0, (f"{suite.label} ({type(problem).__name__}: {problem})",))
        self.outcomes[suite] = outcome
        verdict = "FAILED" if outcome.failed else "ok"
        counts = f"{outcome.passed} passed, {len(outcome.failed)} failed"
        self.say(f"{suite.label}: {verdict}, {counts} ({time.monotonic() - began:.1f} s)")
        if outcome.failed and suite.log.exists():
            lines = suite.log.read_text(errors="replace").splitlines()
            print("\n".join([f"--- the end of {suite.log.relative_to(ROOT)}", *lines[-TAIL:], "---"]), flush=True)

    def _suite(self, suite: Suite) -> Outcome:
        """Run one suite; its labs are there while it runs and at no other time."""
        take_down(suite.labs)
        try:
            status = self._command(suite)
        finally:
            stayed = take_down(suite.labs)
        if stayed:
            with suite.log.open("a") as log:
                log.write("".join(f"\nThe lab {lab} could not be removed.\n" for lab in stayed))
            status = status or 1
        return suite.judge(suite, status, suite.log.read_text(errors="replace"))

    def _command(self, suite: Suite) -> int:
        with suite.log.open("wb") as log:
            try:
                # In a session of its own, so that all it started can be ended with it.
                process = subprocess.Popen(
                    suite.command, cwd=ROOT, env=environment(suite), stdout=log, stderr=log, start_new_session=True
                )
            except OSError as problem:
                log.write(f"{suite.command[0]} cannot be started ({problem.strerror}): run 'make setup'.\n".encode())
                return 127
            self._processes.add(process)
            try:
                if self._stopped:
                    _kill(process)
                return process.wait(suite.limit)
            except subprocess.TimeoutExpired:
                _kill(process)
                log.write(f"\nIt was ended after {suite.limit:.0f} s.\n".encode())
                return 124
            finally:
                self._processes.remove(process)


def _kill(process: subprocess.Popen[bytes]) -> None:
    """End a command and all that it started."""
    try:
        os.killpg(process.pid, signal.SIGKILL)
    except ProcessLookupError:
        pass
    process.wait()


def environment(suite: Suite | None = None) -> dict[str, str]:
    """The tools of .work/venv first; the checkout as the collection; for unit tests, Python's caches out of the tree.

    Each process of pytest, and each program that a test starts, would compile all files anew: half of a collection's time.
    """
    collections = ROOT / ".work" / "collections"
    cached = suite is not None and suite.group in {"unit", "quick"}
    caches = {"PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": str(ROOT / ".work" / "pycache")}
    return {
        **os.environ,
        "PATH": f"{BIN}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": str(collections),
        "ANSIBLE_COLLECTIONS_PATH": str(collections),
        "LC_ALL": "C.UTF-8",
        "NO_COLOR": "1",
        **(caches if cached else {}),
    }


def take_down(labs: Iterable[str]) -> list[str]:
    """Remove labs, as far as there are any; return those that could not be removed."""
    stayed = []
    for lab in labs:
        command = (sys.executable, "lab/lab.py", "down", "--name", lab)
        try:
            # In a session of its own: a Ctrl+C that ends this program does not break the removal off.
            subprocess.run(
                command, cwd=ROOT, check=True, stdout=subprocess.DEVNULL, timeout=REMOVAL, start_new_session=True
            )
        except (OSError, subprocess.SubprocessError):
            stayed.append(lab)
    return stayed


def _interrupt(_number: int, _frame: object) -> None:
    raise KeyboardInterrupt


def main() -> int:
    """Return 1 if a test failed or no test ran."""
    suites = choose_suites(sys.argv[1:])
    signal.signal(signal.SIGTERM, _interrupt)
    shutil.rmtree(REPORTS, ignore_errors=True)
    REPORTS.mkdir(parents=True)
    runner = Runner(suites)
    try:
        runner.run()
    except KeyboardInterrupt:
        runner.say("interrupted: the commands have been ended, and their labs are removed")
        summary(runner.outcomes)
        return 130
    runner.say(f"all {len(suites)} suites have ended")
    passed, failed = summary(runner.outcomes)
    return int(bool(failed) or not passed)


def summary(outcomes: Mapping[Suite, Outcome]) -> tuple[int, int]:
    """Print the failures and their logs, then the counts; return these."""
    failed = [(suite, name) for suite, outcome in outcomes.items() for name in outcome.failed]
    passed = sum(outcome.passed for outcome in outcomes.values())
    for suite, name in failed:
        print(f"FAILED {name}: see {suite.log.relative_to(ROOT)}")
    print(f"{passed} passed, {len(failed)} failed", flush=True)
    return passed, len(failed)


if __name__ == "__main__":
    sys.exit(main())
