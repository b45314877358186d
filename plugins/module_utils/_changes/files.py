# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Files that are ours whole, and the folders made for them: read, plan (pure), apply, and the way back.

A bundle's record holds for each path the print of what we wrote (`written`) and, while a run is at work, of what
it is about to write (`writing`). It is saved before the first change, so a run that is killed leaves nothing on the
machine that the next one does not know of; and a path that was only intended is ours only if it holds what we intended.
"""

import glob
import hashlib
import os
import re
import stat
import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._changes import atomic
from ansible_collections.rosfleet.multimaster.plugins.module_utils._changes.difference import difference
from ansible_collections.rosfleet.multimaster.plugins.module_utils._changes.record import Record
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.problem import Problem

_FILE = "a file"
_FOLDER = "a folder"
_CACHE = "__pycache__"
_BUNDLE = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")
_MODE = re.compile(r"0[0-7]{3}")

Wanted = typing.NamedTuple("Wanted", [("path", str), ("content", bytes), ("mode", int)])
# What stands at a path; `content` is the target of a symbolic link, and empty for a folder or a device.
Found = typing.NamedTuple(
    "Found", [("kind", str), ("content", bytes), ("mode", int), ("owner", typing.Tuple[int, int])]
)
Machine = typing.NamedTuple(
    "Machine",
    [
        ("found", typing.Dict[str, typing.Optional[Found]]),  # every path of the plan and of the record
        ("folders", typing.Dict[str, str]),  # every folder above a planned path: what it is, "" where it is missing
        ("entries", typing.Dict[str, typing.Set[str]]),  # the names in every folder of ours and in its byte-code cache
        ("leftovers", typing.List[str]),  # half-written neighbours of an interrupted run
        ("claimed", typing.Set[str]),  # folders that other bundles of ours made
        ("owner", typing.Tuple[int, int]),  # whose our files are: the (uid, gid) that the module runs as
    ],
)
Item = typing.NamedTuple("Item", [("path", str), ("state", str), ("mode", int)])
Plan = typing.NamedTuple(
    "Plan",
    [
        ("items", typing.List[Item]),  # one per wanted file, in its order
        ("writes", typing.List[Wanted]),
        ("removals", typing.List[str]),
        ("rubbish", typing.List[str]),  # of an interrupted run, and byte code in our folders whose source is gone
        ("folders_made", typing.List[str]),  # outermost first
        ("folders_removed", typing.List[str]),  # innermost first
        ("notes", typing.List[str]),
        ("intent", typing.Dict[str, typing.Any]),  # the record while the run is at work, and after it
        ("after", typing.Dict[str, typing.Any]),
    ],
)


def wanted_files(files: typing.Iterable[typing.Dict[str, typing.Any]]) -> typing.List[Wanted]:
    """The planned files out of mappings of path, content (text) and mode (octal text). Raises Problem."""
    wanted: typing.List[Wanted] = []
    for entry in files:
        path, mode = entry["path"], entry["mode"]
        if not path.startswith("/") or os.path.normpath(path) != path or path == "/" or "\0" in path:
            raise Problem(
                "The path %r of the files is not absolute and plain; expected for example /etc/example/file, "
                "without '..', '//' or '/' at the end." % path
            )
        if not _MODE.fullmatch(mode):
            raise Problem(
                "The mode %r of %s is not understood; expected four octal digits in quotes, for example '0644'."
                % (mode, path)
            )
        wanted.append(Wanted(path, entry["content"].encode("utf-8", "surrogateescape"), int(mode, 8)))
    seen: typing.Set[str] = set()
    for file in wanted:
        if file.path in seen:
            raise Problem("The path %s is listed twice in the files; list it once." % file.path)
        seen.add(file.path)
    for file in wanted:
        for folder in _above(file.path):
            if folder in seen:
                raise Problem(
                    "The files list %s and %s, but the first cannot be a file and the folder of the second; "
                    "change one of the two paths." % (folder, file.path)
                )
    return wanted


def record_of(kind: str, bundle: str, records: str) -> Record:
    """The record of a bundle of this kind (files, services). Raises Problem for a label that is no file name."""
    if not _BUNDLE.fullmatch(bundle):
        raise Problem(
            "The bundle %r is not usable as a label; expected 1 to 64 letters, digits, '.', '_' and '-', "
            "for example nodes." % bundle
        )
    if not os.path.isabs(records):
        raise Problem("records is %r, expected an absolute path." % records)
    return Record("%s-%s" % (kind, bundle), records)


def digest(wanted: typing.Iterable[Wanted]) -> str:
    """One SHA-256 (hexadecimal) over the paths, modes and contents, whatever their order."""
    total = hashlib.sha256()
    for file in sorted(wanted):
        total.update(("%s %s\n" % (file.path, _print_of(file))).encode("utf-8", "surrogateescape"))
    return total.hexdigest()


def read(wanted: typing.List[Wanted], remembered: typing.Dict[str, typing.Any], record: Record) -> Machine:
    """What the machine holds of all that a plan of these files and this memory depends on."""
    folders = {folder for file in wanted for folder in _above(file.path)}
    ours = set(remembered.get("folders", []))
    paths = {file.path for file in wanted} | set(remembered.get("files", {}))
    claimed: typing.Set[str] = set()
    records = os.path.dirname(record.path)
    for kind in ("files", "services"):
        for path in glob.glob(os.path.join(glob.escape(records), kind + "-*.json")):
            if path != record.path:
                name = os.path.basename(path)[: -len(".json")]
                claimed.update(Record(name, records).load().get("folders", []))
    return Machine(
        found={path: look(path) for path in paths},
        folders={folder: _kind(folder) for folder in folders},
        entries={
            folder: set(os.listdir(folder))
            for ours_or_cache in ours
            for folder in (ours_or_cache, os.path.join(ours_or_cache, _CACHE))
            if os.path.isdir(folder) and not os.path.islink(folder)
        },
        leftovers=sorted(
            leftover
            for path, entry in remembered.get("files", {}).items()
            if "writing" in entry
            for leftover in atomic.leftovers(path)
        ),
        claimed=claimed,
        owner=(os.geteuid(), os.getegid()),
    )


def look(path: str) -> typing.Optional[Found]:
    """What stands at a path itself, without following a symbolic link; None where nothing does."""
    try:
        status = os.lstat(path)
    except (FileNotFoundError, NotADirectoryError):
        return None
    kind, content = _FILE, b""
    if stat.S_ISREG(status.st_mode):
        content = atomic.read_bytes(path) or b""
    elif stat.S_ISLNK(status.st_mode):
        content = os.readlink(os.fsencode(path))
        kind = "a symbolic link to %s" % os.fsdecode(content)
    else:
        kind = _FOLDER if stat.S_ISDIR(status.st_mode) else "a device, pipe or socket"
    return Found(kind, content, stat.S_IMODE(status.st_mode), (status.st_uid, status.st_gid))


def owned_files(remembered: typing.Dict[str, typing.Any], machine: Machine) -> typing.Dict[str, str]:
    """The paths that are ours, with the print of what we wrote last, also after a run that was killed; pure."""
    owned = {}
    for path, entry in remembered.get("files", {}).items():
        if "writing" in entry and _print_of_found(machine.found[path]) == entry["writing"]:
            owned[path] = entry["writing"]
        elif "written" in entry:
            owned[path] = entry["written"]
    return owned


def plan(wanted: typing.List[Wanted], remembered: typing.Dict[str, typing.Any], machine: Machine) -> Plan:
    """What changes; pure. Raises Problem, with a sentence per path, where something that is not ours is in the way."""
    owned = owned_files(remembered, machine)
    items: typing.List[Item] = []
    problems: typing.List[str] = []
    notes: typing.List[str] = []
    for file in wanted:
        state = _state(file, machine.found[file.path], owned.get(file.path), machine.owner)
        items.append(Item(file.path, state, file.mode))
        if state == "taken":
            problems.append(_in_the_way(file, machine.found[file.path]))
        elif state == "edited":
            notes.append("%s had been changed or removed by hand since we wrote it." % file.path)
        elif state == "foreign":
            notes.append("%s is as planned already and not ours, so it stays and will stay." % file.path)
    ours = {file.path: file for file, item in zip(wanted, items) if item.state != "foreign"}
    for folder, kind in sorted(machine.folders.items()):
        if kind not in ("", _FOLDER):
            problems.append("%s is %s, expected a folder for planned files: move it away." % (folder, kind))
    removals = [path for path in sorted(owned) if path not in ours and machine.found[path] is not None]
    for path in removals:
        if machine.found[path].kind == _FOLDER:  # type: ignore[union-attr]
            problems.append("%s was a file of ours and is a folder now, so it is not removed: move it away." % path)
        elif _print_of_found(machine.found[path]) != owned[path]:
            notes.append("%s, which goes, had been changed by hand since we wrote it." % path)
    if problems:
        raise Problem(" ".join(problems))

    needed = {folder for path in ours for folder in _above(path)}
    made = sorted(folder for folder in needed if not machine.folders[folder])
    before = set(remembered.get("folders", []))
    rubbish = machine.leftovers + _orphans(before, set(removals), set(ours), machine.entries)
    folders_removed, kept = _emptied(before - needed, before, set(removals) | set(rubbish), machine.entries)
    notes.extend("%s stays, because it holds files that are not ours." % folder for folder in kept)
    folders = sorted((before | machine.claimed | set(made)) & needed)

    writes = [ours[item.path] for item in items if item.state in ("written", "edited")]
    intent: typing.Dict[str, typing.Dict[str, str]] = {path: {"written": owned[path]} for path in owned}
    for file in writes:
        intent.setdefault(file.path, {})["writing"] = _print_of(file)
    return Plan(
        items=items,
        writes=writes,
        removals=removals,
        rubbish=rubbish,
        folders_made=made,
        folders_removed=folders_removed,
        notes=notes,
        intent={"files": intent, "folders": sorted(before | set(folders))},
        after={"files": {path: {"written": _print_of(ours[path])} for path in ours}, "folders": folders},
    )


def changes(planned: Plan) -> bool:
    """Whether a plan changes anything but the record."""
    return bool(
        planned.writes or planned.removals or planned.rubbish or planned.folders_made or planned.folders_removed
    )


def differences(
    planned: Plan, machine: Machine, brief: typing.Iterable[str] = ()
) -> typing.List[typing.Dict[str, str]]:
    """The `diff` of a module: one entry per file that changes, and one for all that are below the `brief` folders."""
    entries = []
    named = ["", ""]  # lines before and after
    below = tuple(folder.rstrip("/") + "/" for folder in brief)
    for path, after in [(file.path, file) for file in planned.writes] + [(path, None) for path in planned.removals]:
        found = machine.found[path]
        if path.startswith(below):
            named[0] += _line(path, found)
            named[1] += _line(path, after)
            continue
        entry = difference(path, found and found.content, after and after.content)
        if found and after and found.kind == _FILE and found.content == after.content:
            entry["before"] = "mode %04o, owner %d:%d\n" % ((found.mode,) + found.owner)
            entry["after"] = "mode %04o, owner %d:%d\n" % ((after.mode,) + machine.owner)
        elif found and found.kind != _FILE:
            entry["before"] = "(%s)\n" % found.kind
        entries.append(entry)
    if any(named):
        header = "files below " + ", ".join(brief)
        entries.append(dict(before=named[0], after=named[1], before_header=header, after_header=header))
    return entries


def _line(path: str, file: typing.Union[Found, Wanted, None]) -> str:
    if file is None:
        return ""
    return "%s, mode %04o, %d bytes, SHA-256 %s\n" % (
        path,
        file.mode,
        len(file.content),
        hashlib.sha256(file.content).hexdigest()[:12],
    )


class Transaction:
    """A plan's changes on the machine, and the way back until they are settled."""

    def __init__(
        self, planned: Plan, machine: Machine, record: Record, remembered: typing.Dict[str, typing.Any]
    ) -> None:
        self.plan = planned
        self.machine = machine
        self.record = record
        self.remembered = remembered
        self.touched: typing.List[str] = []
        self.made: typing.List[str] = []

    def begin(self, more: typing.Optional[typing.Dict[str, typing.Any]] = None) -> None:
        """Remember what is about to happen, with whatever else the caller remembers of this bundle."""
        intent = dict(self.plan.intent, **(more or {}))
        if intent != self.record.load():
            self.record.save(intent)

    def apply(self) -> None:
        """Make the changes. Raises OSError; then `take_back` is due."""
        for path in self.plan.removals:
            self.touched.append(path)
            atomic.remove(path)
            if os.path.isdir(os.path.dirname(path)):
                atomic.sync_folder(os.path.dirname(path))
        for file in self.plan.writes:
            self.made.extend(atomic.make_folders(os.path.dirname(file.path)))
            self.touched.append(file.path)
            atomic.write_by_rename(file.path, file.content, file.mode, self.machine.owner)
        for path in self.plan.rubbish:
            atomic.remove(path)
        for folder in self.plan.folders_removed:
            atomic.remove_folder_if_empty(folder)

    def settle(self, more: typing.Optional[typing.Dict[str, typing.Any]] = None) -> None:
        """Remember what is ours now; after this there is no way back."""
        after = dict(self.plan.after, **(more or {}))
        if not any(after.values()):
            after = {}
        if not after or after != self.record.load():
            self.record.save(after)

    def take_back(self) -> typing.List[str]:
        """Put everything back as it was before `begin`; returns a sentence for each path where that failed."""
        failed = []
        for path in reversed(self.touched):
            try:
                self._put_back(path, self.machine.found[path])
            except OSError as problem:
                failed.append("%s could not be put back (%s)." % (path, problem.strerror or problem))
        for folder in reversed(self.made):
            try:
                atomic.remove_folder_if_empty(folder)
            except OSError as problem:
                failed.append("The folder %s could not be removed again (%s)." % (folder, problem.strerror or problem))
        try:
            # What could not be put back stays in the record as intended, so that the next run knows of it.
            if not failed:
                self.record.save(self.remembered)
        except OSError as problem:
            failed.append("The record %s could not be put back (%s)." % (self.record.path, problem.strerror or problem))
        return failed

    def _put_back(self, path: str, before: typing.Optional[Found]) -> None:
        if before is None:
            atomic.remove(path)
            return
        atomic.make_folders(os.path.dirname(path))
        if before.kind == _FILE:
            atomic.write_by_rename(path, before.content, before.mode, before.owner)
        else:
            atomic.remove(path)
            os.symlink(before.content, os.fsencode(path))


def _state(
    file: Wanted, found: typing.Optional[Found], owned: typing.Optional[str], owner: typing.Tuple[int, int]
) -> str:
    """unchanged, written (to be), edited (by hand, to be put back), foreign (right, not ours) or taken (a problem)."""
    if found is None:
        return "edited" if owned else "written"
    there, planned = _print_of_found(found), _print_of(file)
    if owned is None:
        return "foreign" if there == planned else "taken"
    if found.kind == _FOLDER:
        return "taken"
    if found.owner != owner:
        return "edited"
    if there == planned:
        return "unchanged"
    return "written" if there == owned else "edited"


def _orphans(
    folders: typing.Set[str], gone: typing.Set[str], stays: typing.Set[str], entries: typing.Dict[str, typing.Set[str]]
) -> typing.List[str]:
    """The byte code (PEP 3147) in these folders whose source is gone and is not about to be written."""
    orphans = []
    for folder in sorted(folders):
        cache = os.path.join(folder, _CACHE)
        sources = {os.path.join(folder, name) for name in entries.get(folder, ())} - gone | stays
        for name in sorted(entries.get(cache, ())):
            if ".pyc" in name and os.path.join(folder, name.split(".")[0] + ".py") not in sources:
                orphans.append(os.path.join(cache, name))
    return orphans


def _emptied(
    unneeded: typing.Set[str], ours: typing.Set[str], gone: typing.Set[str], entries: typing.Dict[str, typing.Set[str]]
) -> typing.Tuple:
    """The folders and caches that are empty then, innermost first, and the unneeded folders that are not."""
    gone = set(gone)
    removed, kept = [], []
    for folder in sorted(ours, reverse=True):
        cache = os.path.join(folder, _CACHE)
        for path in (cache, folder) if folder in unneeded else (cache,):
            if path in entries and all(os.path.join(path, name) in gone for name in entries[path]):
                removed.append(path)
                gone.add(path)
            elif path in entries and path == folder:
                kept.append(folder)
    return removed, kept


def _in_the_way(file: Wanted, found: typing.Optional[Found]) -> str:
    what = found.kind if found else "nothing"
    if found and found.kind == _FILE:
        what = "a file of %d bytes with mode %04o" % (len(found.content), found.mode)
    return (
        "%s is %s that this collection did not write, and the plan is a file of %d bytes with mode %04o: "
        "move it away, or take the path out of the plan." % (file.path, what, len(file.content), file.mode)
    )


def _kind(folder: str) -> str:
    """What a folder above a planned path is; a symbolic link to a folder is a folder here, and missing is empty."""
    if os.path.isdir(folder):
        return _FOLDER
    found = look(folder)
    return found.kind if found else ""


def _above(path: str) -> typing.List[str]:
    """The folders above a path without the root, innermost first."""
    folders = []
    path = os.path.dirname(path)
    while path != "/":
        folders.append(path)
        path = os.path.dirname(path)
    return folders


def _print_of(file: Wanted) -> str:
    return "%04o %s" % (file.mode, hashlib.sha256(file.content).hexdigest())


def _print_of_found(found: typing.Optional[Found]) -> str:
    """The print of a file that is there; empty for anything else."""
    if found is None or found.kind != _FILE:
        return ""
    return "%04o %s" % (found.mode, hashlib.sha256(found.content).hexdigest())
