# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_report: the registered results of all computers in, table, file and findings out."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from ansible import constants
from ansible.plugins.action import ActionBase
from ansible.release import __version__ as ansible_version
from ansible.utils.display import Display
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet.plain_text import (
    LINE,
    plain,
    plain_data,
    plain_lines,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import AsFound, FleetPlan
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.plain import Mismatch, from_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._report import content
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._report.junit import junit
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._report.matrices import Matrices
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._report.page import page
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify import report
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks import CHECKS
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.diagnosis import Diagnosis, explained
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.engine import FAILED, Row, Verification
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observations import (
    Multicast,
    Observation,
    PacketFilter,
    Probe,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.pairs import ALL

OPTIONS = ("fleet", "multicast", "probe", "earlier", "path", "packet_filter", "plan", "pairs", "machine", "junit")

AUTO = "auto"  # the folder of the user
NAME = "%Y-%m-%dT%H%M%S"  # of the files of a run
PATTERN = "[0-9][0-9][0-9][0-9]-[0-9][0-9]-[0-9][0-9]T[0-9][0-9][0-9][0-9][0-9][0-9].*"
KEPT = 20  # runs
LARGEST = 100_000_000  # bytes of an earlier document
OWN_MODE, NAMED_MODE = 0o600, 0o644  # they hold the addresses of the fleet
COLOURS = {
    "Findings": "COLOR_ERROR",
    "FAILED": "COLOR_ERROR",
    "Warnings": "COLOR_WARN",
    "Not judged": "COLOR_SKIP",
    "PASSED": "COLOR_OK",
}

T = TypeVar("T")


class ActionModule(ActionBase):
    """Judges the results of the whole run, prints what is wrong, and writes the report."""

    _VALID_ARGS = frozenset(OPTIONS)
    _requires_connection = False

    def run(self, tmp: str | None = None, task_vars: dict[str, Any] | None = None) -> dict[str, Any]:
        result: dict[str, Any] = super().run(tmp, task_vars)
        task_vars = task_vars or {}
        hostvars = task_vars["hostvars"]
        plain_fleet, multicast, probe, earlier, path, packet_filter, plan, pairs, machine, cases = (
            self._task.args.get(option) or "" for option in OPTIONS
        )
        try:
            fleet = from_plain(FleetPlan, plain_fleet)
            observations = {
                host: observation(hostvars[host], multicast, probe, earlier, packet_filter, plan)
                for host in fleet.computers
                if host in task_vars["ansible_play_hosts_all"]
            }
        except Mismatch as problem:
            result.update(failed=True, msg=f"The plan of the fleet cannot be read: {problem}")
            return result
        files = Files.at(path, task_vars.get("inventory_dir"))
        judged = judge(Verification(CHECKS, fleet, observations, pairs or ALL), files, bool(cases))
        infos = {host: registered(hostvars[host], machine) for host in observations}
        document = {**judged.document(), **about(fleet, observations, infos)}
        written = ""
        try:
            written = kept(files, cases, fleet, document, judged.matrices)
        except OSError as problem:
            said = f"The report cannot be written to {problem.filename or path}: {problem.strerror}; name another file."
            if cases or not (files and files.own):
                result.update(failed=True, msg=said)
                return result
            Display().display(plain_lines(said))  # nobody asked for this one
        show(judged.summary, judged.diagnosis, written)
        result.update(
            changed=False,
            passed=not judged.summary.number(FAILED),
            msg=report.verdict_line(judged.summary),
            report=written,
            checks=report.counts(judged.summary),
            pairs=report.sampled(judged.summary),
            findings=plain_data(report.findings(judged.diagnosis)),
            unexplained=plain_data([row._asdict() for row in judged.diagnosis.unexplained]),
        )
        return result


@dataclass(frozen=True)
class Judged:
    """A judgement, and as much of it as the files keep."""

    summary: report.Summary
    diagnosis: Diagnosis
    rows: Sequence[Row]
    matrices: Matrices | None
    seconds: float

    def document(self) -> dict[str, Any]:
        """The document without what is known of the fleet."""
        return {
            "result": report.verdict_line(self.summary),
            "judged_in": round(self.seconds, 2),
            **report.document(self.summary, self.diagnosis, self.rows),
        }


def judge(verification: Verification, files: Files | None, cases: bool) -> Judged:
    """Judge everything; without files only what is not ok is kept."""
    began = time.monotonic()
    fleet, computers = verification.fleet, list(verification.run)
    if files is None and not cases:
        summary = report.summarised(verification, computers, len(fleet.computers))
        return Judged(summary, explained(verification, summary.notable), (), None, time.monotonic() - began)
    matrices = Matrices(fleet)
    rows = matrices.passing(verification.rows())
    everything: list[Row] = []
    if matrices.single or (files and not files.own):  # a file that somebody names has every result
        everything = list(rows)
        rows = iter(everything)
    summary = report.summarise(rows, computers, len(fleet.computers), verification.pairs)
    diagnosis = explained(verification, summary.notable)
    return Judged(summary, diagnosis, everything or summary.notable, matrices, time.monotonic() - began)


def kept(files: Files | None, cases: str, fleet: FleetPlan, document: dict[str, Any], matrices: Matrices | None) -> str:
    """Write what is asked for; return the path of the page. Raises OSError."""
    if cases:
        write(os.path.abspath(os.path.expanduser(cases)), junit(document), NAMED_MODE)
    return files.write(fleet, document, matrices) if files and matrices else ""


def about(
    fleet: FleetPlan, observations: Mapping[str, Observation], infos: Mapping[str, Mapping[str, Any]]
) -> dict[str, Any]:
    """Say what was looked at, when, and with what."""
    return {
        "time": time.strftime("%Y-%m-%d %H:%M:%S %z"),
        "collection": collection_version(),
        "ansible": ansible_version,
        "robots": content.robots(fleet, observations),
        "machines": content.machines(fleet, observations, infos),
    }


def collection_version() -> str:
    """Read the version of the collection, as it is installed or in a checkout; empty where it is not told."""
    root = Path(__file__).resolve().parents[2]
    try:
        installed = json.loads((root / "MANIFEST.json").read_text(encoding="utf-8"))
        return str(installed["collection_info"]["version"])
    except (OSError, ValueError, KeyError, TypeError):
        pass
    try:
        lines = (root / "galaxy.yml").read_text(encoding="utf-8").splitlines()
    except OSError:
        return ""
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("version:")), "")


@dataclass(frozen=True)
class Files:
    """Where the page and the data of a run go: two files beside each other."""

    data: Path
    own: bool  # nobody named a place: they are in a folder of ours, which keeps the last ones

    @classmethod
    def at(cls, path: str, inventory: Any) -> Files | None:
        """Read the option `path`: empty, auto, a folder or a file."""
        if not path:
            return None
        name = time.strftime(NAME) + ".json"
        if path == AUTO:
            return cls(folder_of(str(inventory or "")) / name, own=True)
        place = Path(os.path.abspath(os.path.expanduser(path)))
        return cls(place / name if path.endswith("/") or place.is_dir() else place, own=False)

    def write(self, fleet: FleetPlan, document: dict[str, Any], matrices: Matrices) -> str:
        """Write both, compare with the run before, and return the path of the page. Raises OSError."""
        if self.own:
            self.data.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        before = self._before()
        differences = content.differences(before, document)
        document = {**document, "file": str(self.data), "since": before.get("time", ""), "differences": differences}
        since = {"time": before.get("time", ""), "differences": differences}
        template = (Path(content.__file__).parent / "page.html.j2").read_text(encoding="utf-8")
        html = page(template, fleet, document, matrices, since)
        shown = self.data.with_suffix(".html" if self.data.suffix != ".html" else ".page.html")
        mode = OWN_MODE if self.own else NAMED_MODE
        write(str(self.data), json.dumps(plain_data(document), indent=1) + "\n", mode)
        write(str(shown), html, mode)
        if self.own:
            for old in sorted(self.data.parent.glob(PATTERN))[: -2 * KEPT]:
                old.unlink(missing_ok=True)
        return str(shown)

    def _before(self) -> dict[str, Any]:
        """Read the data of the run before: the latest in the folder, or the file that is written anew."""
        earlier = [self.data] if self.data.exists() else sorted(self.data.parent.glob(PATTERN))
        for path in [path for path in earlier if path.suffix == ".json" or path == self.data][-1:]:
            try:
                if path.stat().st_size <= LARGEST:
                    found = json.loads(path.read_text(encoding="utf-8"))
                    return plain_data(found) if isinstance(found, dict) else {}
            except (OSError, ValueError, RecursionError):
                return {}
        return {}


def folder_of(inventory: str) -> Path:
    """Name the folder for the reports of an inventory, below Ansible's own folder of the user."""
    name = re.sub(r"[^A-Za-z0-9._-]+", "_", Path(inventory).name).strip(".") or "fleet"
    mark = hashlib.sha256(inventory.encode()).hexdigest()[:8]
    return Path(constants.config.get_config_value("ANSIBLE_HOME")) / "rosfleet" / "reports" / f"{name}-{mark}"


def show(summary: report.Summary, diagnosis: Diagnosis, written: str) -> None:
    """Print the report as wide as the terminal; the table of all checks only with -v."""
    display = Display()
    width = min(max(shutil.get_terminal_size((report.WIDTH, 24)).columns, 80), 160)
    text = report.render(summary, diagnosis, width, everything=display.verbosity > 0)
    display.display("")
    for line in plain_lines(text).split("\n"):
        word = line.strip().partition(":")[0]
        display.display(line, color=getattr(constants, COLOURS.get(word, ""), None))
    display.display(plain_lines(f"Report: {written}\n" if written else ""))


def observation(
    variables: Mapping[str, Any],
    multicast: str,
    probe: str,
    earlier: Sequence[str],
    packet_filter: str = "",
    plan: str = "",
) -> Observation:
    """Read the registered results of one computer; the message of the first one that failed is its problem."""
    results = [registered(variables, name) for name in (*earlier, multicast, probe)]
    bad = [entry for entry in results if entry.get("unreachable") or entry.get("failed")]
    problem = plain(" ".join(str(bad[0].get("msg", "")).split()), LINE) if bad else ""
    unreachable = any(entry.get("unreachable") for entry in bad)
    try:
        return Observation(
            multicast=complete(Multicast, variables, multicast, "udp"),
            probe=complete(Probe, variables, probe, "members"),
            unreachable=unreachable,
            problem=problem,
            packet_filter=complete(PacketFilter, variables, packet_filter, "members"),
            found=as_found(variables, plan),
            services=services(variables, plan),
        )
    except Mismatch as found:  # what one computer was told by strangers must not cost the others their report
        return Observation(
            unreachable=unreachable, problem=problem or plain(f"its results cannot be read: {found}", LINE)
        )


def complete(kind: type[T], variables: Mapping[str, Any], name: str, part: str) -> T | None:
    """Read a registered result; None where the task gave none, or not this part. Raises Mismatch."""
    result = registered(variables, name)
    return from_plain(kind, plain_data(result)) if part in result else None


def registered(variables: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """Return a registered result, or with a dot in the name a part of one; empty where there is none."""
    found: Any = variables
    for key in name.split("."):
        found = found[key] if isinstance(found, Mapping) and key in found else {}
    return found if isinstance(found, Mapping) else {}


def services(variables: Mapping[str, Any], name: str) -> tuple[str, ...] | None:
    """Read which services can run there, as preflight found; None where it did not look."""
    found = registered(variables, name).get("services")
    return tuple(map(str, found)) if isinstance(found, (list, tuple)) else None


def as_found(variables: Mapping[str, Any], name: str) -> AsFound | None:
    """Read what preflight found, out of the variable with the computer's plan; None where there is none. Raises Mismatch."""
    plan = registered(variables, name)
    return from_plain(AsFound, plain_data(plan["found"])) if "found" in plan else None


def write(path: str, text: str, mode: int) -> None:
    """Write a file by rename, so that a reader never sees half of a report. Raises OSError."""
    descriptor, temporary = tempfile.mkstemp(dir=os.path.dirname(path), prefix=".report-")
    try:
        with open(descriptor, "w", encoding="utf-8") as stream:
            stream.write(text)
        os.chmod(temporary, mode)
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise
