# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The catalogue of faults on real systems: each is injected, verified, compared with the part that was expected, and undone.

    python tests/faults/run.py [--only NAME]... [--quick] [--resume] [--remedy] [--record FOLDER] [--page]

`make test-faults` runs all of it and writes the table of tests/evidence/faults.md. What came of each fault is kept below .work, so
that a long run may be made of short ones: `--resume` leaves out what has a result, and `--page` writes the table of what is kept;
the rows of other faults stay as they are.
`--remedy` also pastes the command of what is named first, as a person would, and verifies again.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
sys.path[:0] = [str(HERE), str(ROOT / "lab"), str(ROOT / ".work" / "collections")]

import judge  # noqa: E402
import page  # noqa: E402
import remedy  # noqa: E402
import state  # noqa: E402
from agreement import Agreement, agreement  # noqa: E402
from catalogue import LAB, Fault, Step, facts_of, load  # noqa: E402
from kept import PREDICTION, Kept, Row, told_of_prediction, told_of_remedies, told_of_unexplained  # noqa: E402
from machines.layout import Extra, read_inventory  # noqa: E402
from machines.podman import LabError  # noqa: E402
from subject import Lab, lab_of  # noqa: E402
from words import STRANGER, STRANGERS_ADDRESS, Words  # noqa: E402

NAME = "faults"
INVENTORY = HERE / "inventory"
SETTLES = 30.0  # seconds until a fault has its effect, at most
WORK = ROOT / ".work" / "faults"
KEPT = Kept(WORK / "results")


@dataclass(frozen=True)
class Result:
    """The outcome of one fault."""

    fault: Fault
    verdict: str
    found: judge.Named
    seconds: float  # of the verification
    left: tuple[str, ...] = ()  # what undo has not taken back
    predicted: Agreement = Agreement()  # the prediction of reachability, compared with what was measured
    remedied: str = ""  # what came of the remedy that was told, where it was tried

    @property
    def ok(self) -> bool:
        """The part was named first and explains all rows, the command that was told mends it, and nothing is left of the fault."""
        explained = self.verdict == judge.FIRST and not self.found.unexplained
        return explained and not self.left and not self.remedied.startswith(remedy.WRONG)

    def row(self, revision: str) -> Row:
        """Return the row that is kept of it."""
        ways, wrong = self.predicted.ways, len(self.predicted.wrong)
        unexplained = len(self.found.unexplained)
        return Row(
            self.verdict,
            self.found.text,
            self.seconds,
            ways,
            ways - wrong,
            revision,
            self.left,
            self.remedied,
            unexplained=unexplained,
        )


class Catalogue:
    """The lab, and the faults on it one after the other."""

    def __init__(
        self,
        lab: Lab,
        record: Path | None,
        remedies: bool = False,
        variables: Mapping[str, object] | None = None,
    ) -> None:
        """`variables`: of the verification, beside those of the inventory."""
        self.lab, self.record, self.words, self.remedies = lab, record, Words(lab), remedies
        self.own = variables or {}
        variables = read_inventory(INVENTORY)["_meta"]["hostvars"]
        self.masters = {of.get("multimaster_master", name) for name, of in variables.items()}
        self.before = state.look(lab, variables, self.masters)

    def tried(self, fault: Fault, is_harmful: Callable[[Fault], bool] = lambda _fault: True) -> Result | None:
        """One fault from its injection until the fleet is as before; None for one that harms nothing."""
        remedied, made = "", True
        try:
            for step in fault.inject:
                self._do(step)
            for step in fault.settled:
                self._settle(step)
            if not is_harmful(fault):
                return None
            found, predicted, seconds = self._verified(fault)
            remedied = self._remedied(fault) if self.remedies and found.findings else ""
        except (AssertionError, subprocess.SubprocessError) as problem:  # the other faults are tried all the same
            found, predicted, seconds, made = (
                judge.Named(text=f"it could not be made: {problem}"),
                Agreement(),
                0.0,
                False,
            )
        finally:
            for step in fault.undo:
                self._do(step, check=False)
            left = state.back(self.lab, self.before, self.masters)
            if left:
                self._repair()
        verdict = judge.verdict(fault, found) if made else judge.UNMADE
        return Result(fault, verdict, found, seconds, tuple(left), predicted, remedied)

    def _do(self, step: Step, *, check: bool = True) -> None:
        if step.where == LAB:
            self.words.say(step.what)
        else:
            self.lab.run(step.where, step.what, check=check)

    def _settle(self, step: Step) -> None:
        patiently = f"for time in $(seq {SETTLES:.0f}); do {{ {step.what}; }} && exit; sleep 1; done; exit 1"
        self.lab.run(step.where, patiently)

    def _verified(self, fault: Fault) -> tuple[judge.Named, Agreement, float]:
        """Run playbooks/verify.yml: what it names first, how the prediction agrees, and how long it took."""
        report, observations = (WORK / f"{fault.name}.{kind}.json" for kind in ("report", "observations"))
        began = time.monotonic()
        output = self._verify(report, observations)
        seconds = time.monotonic() - began
        found = judge.named(json.loads(report.read_text())) if report.exists() else judge.Named(text=output[-600:])
        recorded = json.loads(observations.read_text()) if observations.exists() else {}
        if self.record and recorded:
            self._keep(fault, recorded, found)
        return found, agreement(recorded) if recorded.get("fleet") else Agreement(), seconds

    def _verify(self, report: Path, observations: Path) -> str:
        for path in (report, observations):
            path.unlink(missing_ok=True)
        return self.lab.play(
            "playbooks/verify.yml",
            variables={**self.own, "verify_report": str(report)},
            environment={
                "ANSIBLE_CALLBACK_PLUGINS": str(HERE / "callbacks"),
                "ANSIBLE_CALLBACKS_ENABLED": "observations",
                "OBSERVATIONS_FILE": str(observations),
            },
        )[1]

    def _remedied(self, fault: Fault) -> str:
        """Do what the finding says, and verify again: is it still there?"""
        before = json.loads((WORK / f"{fault.name}.report.json").read_text())
        first = before["findings"][0]
        told = first["remedy"]
        if first["sure"] == "inferred":
            return f"{remedy.WORDS}: look: {told}"  # it says where to look, and advises no change
        steps = remedy.steps(first["do"])
        by_hand = "" if steps else f", {remedy.BY_HAND}"
        for step in steps or fault.hands:
            wrong = self._pasted(step)
            if wrong:
                return f"{remedy.FAILS}: {told}: {wrong}"
        if not (steps or fault.hands):
            return f"{remedy.WORDS}: {told}"
        report = WORK / f"{fault.name}.after.json"
        output = self._verify(report, WORK / f"{fault.name}.after.observations.json")
        if not report.exists():
            return f"{remedy.FAILS}: {told}: {output[-600:]}"
        return f"{remedy.result(before, json.loads(report.read_text()))}{by_hand}: {told}"

    def _pasted(self, step: Step) -> str:
        """Paste a command; return what it says if it fails."""
        if step.where == remedy.CONTROLLER:
            status, output = self.lab.play(step.what)
            return output[-600:] if status else ""
        try:
            self.lab.run(step.where, step.what)
        except AssertionError as problem:
            return str(problem)[-600:]
        return ""

    def _keep(self, fault: Fault, observations: dict, found: judge.Named) -> None:
        """Keep what fleet_report got, to be judged again without a lab."""
        row = {"fault": fault.name, "title": fault.title, "parts": fault.parts, "at": fault.at, "named": found.text}
        text = json.dumps({**row, **observations}, separators=(",", ":"))
        (self.record / f"{fault.name}.json").write_text(text + "\n")

    def _repair(self) -> None:
        """Let site.yml put right the rest that undo has left, so that the next fault is alone."""
        status, output = self.lab.play("site.yml")
        if status:
            raise LabError(f"the fleet cannot be brought back: {output[-600:]}")
        self.before = state.look(self.lab, self.before, self.masters)


def chosen(only: Sequence[str], quick: bool) -> list[Fault]:
    """The faults of this run."""
    faults = load(facts_of(read_inventory(INVENTORY), {STRANGER: STRANGERS_ADDRESS}))
    unknown = set(only) - {fault.name for fault in faults}
    if unknown:
        raise LabError(
            f"there is no fault {', '.join(sorted(unknown))}; expected some of {', '.join(f.name for f in faults)}."
        )
    return [fault for fault in faults if (fault.name in only if only else fault.quick or not quick)]


def revision() -> str:
    """The code that is tried."""
    words = ("git", "-C", str(ROOT), "describe", "--always", "--dirty")
    return subprocess.run(words, capture_output=True, text=True, check=True).stdout.strip()


def run(faults: Sequence[Fault], record: Path | None, remedies: bool = False, name: str = NAME) -> list[Result]:
    """Try these faults in a lab."""
    for folder in filter(None, (WORK, record)):
        folder.mkdir(parents=True, exist_ok=True)
    results: list[Result] = []
    if not faults:
        return results
    tried = revision()
    with lab_of(name, INVENTORY, {STRANGER: Extra((STRANGERS_ADDRESS,))}) as lab:
        status, output = lab.play("site.yml")
        if status:
            raise LabError(f"site.yml has failed: {output[-600:]}")
        catalogue = Catalogue(lab, record, remedies)
        for number, fault in enumerate(faults, 1):
            print(f"[{number}/{len(faults)}] {fault.name}: {fault.title} ...", flush=True)
            result = catalogue.tried(fault)
            assert result is not None  # those of the catalogue all count
            results.append(result)
            KEPT.put(fault, results[-1].row(tried))
            print("\n".join(told(results[-1])), flush=True)
    return results


def told(result: Result) -> list[str]:
    """The lines about one fault."""
    lines = [f"    {result.verdict} ({result.seconds:.0f} s): {result.found.text}"]
    lines += [f"    no finding explains: {row}" for row in result.found.unexplained]
    lines += [f"    the remedy mends it: {result.remedied}"] if result.remedied else []
    lines += [f"    the prediction says {state}: {' '.join(way)}" for way, state in result.predicted.wrong]
    return lines + [f"    left by undo: {line}" for line in result.left]


def write_page() -> None:
    """Write the table of all faults: of what is kept, or else of what the page has already. Who was not tried is told there, too."""
    faults = chosen((), quick=False)
    before = page.read(faults)
    kept = {fault: row for fault in faults if (row := KEPT.get(fault))}
    rows = {fault: kept.get(fault) or before.get(fault) for fault in faults}
    tried = list(filter(None, rows.values()))
    # A row of the page has no counts, so these sentences are of a table whose faults were all tried here.
    counts = (told_of_unexplained, told_of_prediction) if len(kept) == len(tried) else ()
    told = [tell(tried) for tell in (told_of_remedies, *counts)]
    page.write(rows.items(), " ".join(told if counts else [*told, page.find_sentence(PREDICTION)]))
    print(f"The table is of the revisions {', '.join(sorted({row.revision for row in kept.values()}))}.")
    untried = [fault.name for fault, row in rows.items() if row is None]
    if untried:
        print(f"Not tried: {', '.join(untried)}; try them with --resume.")


def options_of(words: Sequence[str] | None = None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--only", metavar="NAME", action="append", default=[], help="this fault (more than once: these)"
    )
    parser.add_argument("--quick", action="store_true", help="only those of make test-long")
    parser.add_argument("--resume", action="store_true", help="leave out what has a result already")
    parser.add_argument(
        "--remedy", action="store_true", help="paste the command of the first finding, and verify again"
    )
    parser.add_argument(
        "--record", metavar="FOLDER", type=Path, help="keep the plan and the observations of each fault"
    )
    parser.add_argument("--lab", metavar="NAME", default=NAME, help="the name of the lab, for two runs side by side")
    parser.add_argument("--page", action="store_true", help="write the table into tests/evidence/faults.md")
    return parser.parse_args(words)


def main() -> int:
    """Exit status 0 only when each part was named first."""
    options = options_of()
    try:
        faults = [fault for fault in chosen(options.only, options.quick) if not (options.resume and KEPT.get(fault))]
        results = run(faults, options.record, options.remedy, options.lab)
        if options.page:
            write_page()
    except (LabError, subprocess.SubprocessError) as problem:
        print(f"faults: {problem}", file=sys.stderr)
        return 1
    print(f"\n{told_of_prediction([result.row('') for result in results])}")
    failed = [result.fault.name for result in results if not result.ok]
    print(f"{len(results) - len(failed)} of {len(results)} named first{'; not: ' if failed else ''}{', '.join(failed)}")
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main())
