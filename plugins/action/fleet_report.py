# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_report: the registered results of all computers in, table, file and findings out."""

from __future__ import annotations

import json
import os
import platform
import shutil
import stat
import tempfile
import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ansible import constants
from ansible.release import __version__ as ansible_version
from ansible.utils.display import Display

try:
    from ansible._internal._datatag._tags import Origin  # ansible-core 2.19 and later
except ImportError:
    Origin = None

from ..plugin_utils._base.plain import Mismatch
from ..plugin_utils._base.plain_text import LINE, plain, plain_data, plain_lines
from ..plugin_utils._base.sentences import join_causes
from ..plugin_utils._bundle.archive import LARGEST, UnreadableBundle, unpack
from ..plugin_utils._bundle.reading import JUDGED, quote_run, read_bundle
from ..plugin_utils._plan.model import FleetPlan
from ..plugin_utils._robot_io.refusal import FleetAction, Refusal, name_inventory
from ..plugin_utils._verify.checks.engine import FAILED, InventorySource
from ..plugin_utils._verify.diagnose.explanation import UnknownFinding, choose_findings, write_explanation
from ..plugin_utils._verify.report import history, terminal
from ..plugin_utils._verify.report.judgement import FleetJudgement, judge_run, make_document
from ..plugin_utils._verify.report.junit import write_junit
from ..plugin_utils._verify.report.matrices import Matrices
from ..plugin_utils._verify.report.page import TEMPLATE, make_page
from ..plugin_utils._verify.report.run import OPTIONS, Run, gather_run

AUTO = "auto"  # the folder of the user
LARGEST_DATA = 100_000_000  # bytes of an earlier document
OWN_MODE, NAMED_MODE = 0o600, 0o644  # of a report in our own folder, and in a named place
STRANGE = (ArithmeticError, AttributeError, IndexError, KeyError, RecursionError, RuntimeError, TypeError, ValueError)
CONTRADICTION = "contradicts itself, so nothing can be judged; expected a bundle as verify has written it (verify_bundle): ask for another one."
COLOURS = {
    "Findings": "COLOR_ERROR",
    "FAILED": "COLOR_ERROR",
    "Warnings": "COLOR_WARN",
    "Not judged": "COLOR_SKIP",
    "PASSED": "COLOR_OK",
}


class ActionModule(FleetAction):
    """Judges the results of the whole run, prints the findings, and writes the report."""

    _VALID_ARGS = frozenset((*OPTIONS, "path", "junit", "bundle", "each", "marks", "explain"))

    def answer(self, args: Any, task_vars: dict[str, Any]) -> dict[str, Any]:
        """Return the judgement of the run, or of the one in a bundle, and print it."""
        bundle = str(args.get("bundle") or "")
        try:
            run = (
                open_bundle(bundle)
                if bundle
                else replace(read_run(args, task_vars), inventory=describe_inventory(task_vars))
            )
            place = os.path.abspath(bundle) if bundle else str(task_vars.get("inventory_dir") or "")
            sources = [] if bundle else [str(source) for source in task_vars.get("ansible_inventory_sources") or ()]
            return self._report(run, folder_of(place, sources), live=not bundle)
        except (Mismatch, UnreadableBundle) as problem:
            raise Refusal(str(problem)) from None
        except STRANGE:  # a bundle may come from any person
            if not bundle:
                raise
            raise Refusal(f"{bundle} {CONTRADICTION}") from None

    def _report(self, run: Run, folder: Path, live: bool) -> dict[str, Any]:
        """Judge, write and print. Raises Refusal."""
        path, cases = (str(self._task.args.get(option) or "") for option in ("path", "junit"))
        files = Files.from_option(path, folder)
        before = files.read_previous(run.fleet.computers) if files else {}
        run = add_last_time(run, before) if live else run
        judgement = judge_run(run, bool(files or cases), bool(files and not files.own))
        document = make_document(run, judgement)
        explained = read_numbers(self._task.args.get("explain"), document)
        written, problem = "", None
        try:
            written = write_files(files, cases, run.fleet, document, judgement.matrices, before)
        except OSError as error:
            problem = error
        show(judgement, document, written)
        explain(document, explained)
        if problem:
            report_unwritable(problem, path, is_asked=bool(cases) or not (files and files.own))
        findings = plain_data([{**entry, "follows": len(entry["follows"])} for entry in document["findings"]])
        shown = terminal.SENTENCES if is_each_wanted(self._task.args.get("each")) else 0
        return {
            "passed": document["verdict"] != FAILED,
            "msg": document["result"],
            "report": written,
            "since_last_s": float(run.about.get("since_last_s") or 0),
            "checks": document["checks"],
            "pairs": document["pairs"],
            "findings": findings,
            "each": [join_rivals(entry) for entry in findings[:shown]],
            "unexplained": plain_data(document["unexplained"]),
        }


def report_unwritable(problem: OSError, path: str, *, is_asked: bool) -> None:
    """Say that a report cannot be written. Raises Refusal if an option has asked for it."""
    message = f"The report cannot be written to {problem.filename or path}: {problem.strerror}; name another file."
    if is_asked:
        raise Refusal(message) from None
    Display().display(plain_lines(message))


def is_each_wanted(option: object) -> bool:
    """Return True if each finding is an item of its own, as a callback shows it."""
    return option == "always" or (option == "auto" and has_callbacks())


def add_last_time(run: Run, before: Mapping[str, Any]) -> Run:
    """Return the run with the seconds since the last one."""
    return replace(run, about={**run.about, "since_last_s": str(history.count_seconds(before, time.time()))})


def write_files(
    files: Files | None,
    cases: str,
    fleet: FleetPlan,
    document: dict[str, Any],
    matrices: Matrices | None,
    before: Mapping[str, Any],
) -> str:
    """Write the files of the options, and return the path of the page. Raises OSError."""
    if cases:
        write(os.path.abspath(os.path.expanduser(cases)), write_junit(document), NAMED_MODE)
    return files.write(fleet, document, matrices, before) if files and matrices else ""


def join_rivals(finding: Mapping[str, Any]) -> dict[str, Any]:
    """Return a finding for a task of its own. Its sentence also has the other possible causes."""
    return {**finding, "sentence": join_causes([cause["sentence"] for cause in (finding, *finding["rivals"])])}


def has_callbacks() -> bool:
    """Return True if the user has set up callbacks. ARA and ansible-navigator, for example, name a folder of their own."""
    _value, origin = constants.config.get_config_value_and_origin("DEFAULT_CALLBACK_PLUGIN_PATH")
    return origin != "default" or bool(constants.config.get_config_value("CALLBACKS_ENABLED"))


def read_run(options: Mapping[str, Any], task_vars: Mapping[str, Any]) -> Run:
    """Read the registered results of this run. Raises Mismatch."""
    about = {
        "time": time.strftime(history.TIME),
        "collection": collection_version(),
        "ansible": ansible_version,
        "python": platform.python_version(),
        "durations": format_durations(options.get("marks"), time.time()),
    }
    try:
        return gather_run(options, task_vars["hostvars"], task_vars["ansible_play_hosts_all"], about)
    except Mismatch as problem:
        raise Mismatch(f"The plan of the fleet cannot be read: {problem}") from None


def describe_inventory(task_vars: Mapping[str, Any]) -> InventorySource:
    """Describe the inventory of this run."""
    hostvars, groups = task_vars["hostvars"], task_vars.get("groups") or {}

    def find_line(place: str, variable: str) -> str:
        names = [place] if place in hostvars else list(groups.get(place) or ())[:1]  # of a robot: its first computer
        values = (raw.get(variable) for name in names if (raw := read_raw(hostvars, name)))
        return next((line for value in values if (line := find_origin(value))), "")

    return InventorySource(name_inventory(task_vars), find_line)


def read_raw(hostvars: Any, name: str) -> Mapping[str, Any]:
    """Read the variables of a host as they are in the inventory; nothing if they cannot be read."""
    found: Any = getattr(hostvars, "raw_get", lambda _name: {})(name)
    return found if isinstance(found, Mapping) else {}


def find_origin(value: object) -> str:
    """Return the file and line of a value of the inventory; empty if Ansible does not know it."""
    origin = Origin.get_tag(value) if Origin else None
    path, line = (origin.path, origin.line_num) if origin else (getattr(value, "ansible_pos", None) or (None, None))[:2]
    return f"{min(str(path), os.path.relpath(str(path)), key=len)}, line {line}" if path and line else ""


def format_durations(marks: Any, now: float) -> str:
    """Return the seconds of each part of the run, and of all together. `marks` has the moment at which each part began."""
    starts: list[tuple[str, float]] = []
    for name, moment in marks.items() if isinstance(marks, Mapping) else ():
        try:
            starts.append((plain(name, 80), float(moment)))
        except (TypeError, ValueError):  # this part has not begun
            continue
    if not starts:
        return ""
    ends = [moment for _name, moment in starts[1:]] + [now]
    parts = [f"{name} {end - moment:.1f} s" for (name, moment), end in zip(starts, ends, strict=True)]
    return f"{', '.join(parts)}; together {now - starts[0][1]:.1f} s"


def open_bundle(path: str) -> Run:
    """Read a bundle. Raises UnreadableBundle, with a sentence."""
    try:
        descriptor = os.open(
            os.path.expanduser(path), os.O_RDONLY | os.O_NONBLOCK
        )  # without O_NONBLOCK a FIFO would block
        with open(descriptor, "rb") as stream:
            if not stat.S_ISREG(os.fstat(descriptor).st_mode):
                raise UnreadableBundle("is no file")
            data = stream.read(LARGEST + 1)
        return quote_run(read_bundle(unpack(data, JUDGED)))
    except OSError as problem:
        reason = f"cannot be read: {problem.strerror}"
    except UnreadableBundle as problem:
        reason = plain(str(problem), LINE)
    raise UnreadableBundle(
        f"{path} {reason}; expected a bundle that verify has written (verify_bundle): name another file."
    )


def collection_version() -> str:
    """Read the version of the collection, installed or in a checkout. Empty if no file has it."""
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
    """The places of the page and the data of a run: two files in one folder."""

    data: Path
    own: bool  # the option names no place: our own folder keeps the latest reports
    fleet: str  # identifies the inventories of a command: only runs of one fleet are compared

    @classmethod
    def from_option(cls, path: str, folder: Path) -> Files | None:
        """Read the option `path`: empty, auto, a folder or a file."""
        if not path:
            return None
        name = time.strftime(history.NAME) + ".json"
        if path == AUTO:
            return cls(folder / name, True, folder.name)
        return cls(Path(name_file(path, name)), False, folder.name)

    def write(self, fleet: FleetPlan, document: dict[str, Any], matrices: Matrices, before: Mapping[str, Any]) -> str:
        """Write both, compare with the run before, and return the path of the page. Raises OSError."""
        if self.own:
            self.data.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        differences = history.compare(before, document)
        document = {
            **document,
            "file": str(self.data),
            "fleet": self.fleet,
            "since": before.get("time", ""),
            "differences": differences,
        }
        template = TEMPLATE.read_text(encoding="utf-8")
        html = make_page(template, fleet, document, matrices)
        shown = self.data.with_suffix(".html" if self.data.suffix != ".html" else ".page.html")
        mode = OWN_MODE if self.own else NAMED_MODE
        write(str(self.data), json.dumps(plain_data(document), indent=1) + "\n", mode)
        write(str(shown), html, mode)
        if self.own:
            for old in history.find_expired(self._list_folder()):
                self.data.with_name(old).unlink(missing_ok=True)
        return str(shown)

    def read_previous(self, computers: Collection[str]) -> dict[str, Any]:
        """Read the data of the previous run of this fleet: the file to be replaced, or else the latest in the folder."""
        names = [self.data.name] if self.data.exists() else history.list_latest(self._list_folder())
        return next(filter(None, (self._read(name, computers) for name in names)), {})

    def _read(self, name: str, computers: Collection[str]) -> dict[str, Any]:
        """Read the data of a run of this fleet; empty if the file has no data of this fleet."""
        path = self.data.with_name(name)
        try:
            if path.stat().st_size <= LARGEST_DATA:
                return history.read_data(path.read_text(encoding="utf-8"), self.fleet, computers)
        except (OSError, UnicodeError):
            pass
        return {}

    def _list_folder(self) -> list[str]:
        """List the names in the folder."""
        return [path.name for path in self.data.parent.glob("*")]


def name_file(option: str, name: str) -> str:
    """Return the path of the file that an option names; for a folder, the path of a file of this name in it."""
    path = os.path.abspath(os.path.expanduser(option))
    return os.path.join(path, name) if option.endswith("/") or os.path.isdir(path) else path


def folder_of(inventory: str, sources: Sequence[str] = ()) -> Path:
    """Return the folder for the reports of a fleet, below Ansible's own folder of the user."""
    home = Path(constants.config.get_config_value("ANSIBLE_HOME"))
    return home / "rosfleet" / "reports" / history.name_folder(inventory, sources)


def show(judgement: FleetJudgement, document: Mapping[str, Any], written: str) -> None:
    """Print the report as wide as the terminal; the table of all checks only with -v."""
    display = Display()
    width = measure_width()
    everything = display.verbosity > 0
    tables = document["traffic"], document["nodes"], document["remarks"]
    text = terminal.render(judgement.summary, judgement.diagnosis, width, everything, *tables)
    display.display("")
    for line in plain_lines(text).split("\n"):
        word = line.strip().partition(":")[0]
        display.display(line, color=getattr(constants, COLOURS.get(word, ""), None))
    display.display(plain_lines(f"Report: {written}\n" if written else ""))


def read_numbers(option: object, document: Mapping[str, Any]) -> list[int]:
    """Read the findings that are to be explained. Raises Refusal."""
    try:
        return choose_findings(str(option or ""), len(document["findings"]))
    except UnknownFinding as unknown:
        raise Refusal(str(unknown)) from None


def explain(document: Mapping[str, Any], numbers: Sequence[int]) -> None:
    """Print why findings were made."""
    for number in numbers:
        lines = write_explanation(number, document["findings"][number - 1], measure_width())
        Display().display(plain_lines("\n".join(["", *lines])))


def measure_width() -> int:
    """Measure the terminal, as far as a report can be read on it."""
    return min(max(shutil.get_terminal_size((terminal.WIDTH, 24)).columns, 80), 160)


def write(path: str, content: str | bytes, mode: int) -> None:
    """Write a file by rename, so that a reader never sees half of a report. Raises OSError."""
    try:
        descriptor, temporary = tempfile.mkstemp(dir=os.path.dirname(path), prefix=".report-")
        try:
            with open(descriptor, "wb") as stream:
                stream.write(content.encode() if isinstance(content, str) else content)
            os.chmod(temporary, mode)
            os.replace(temporary, path)
        except BaseException:
            os.unlink(temporary)
            raise
    except OSError as problem:
        # The file that was asked for, and not the temporary one. A full disk has no file to name.
        problem.filename, problem.filename2 = path, None
        raise
