# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Files that a bundle owns whole, and the folders made for them: read, plan (pure), and the steps of the change.

A bundle's record holds for each path the fingerprint of what was written (`written`) and, while a run is at work, of
what it is about to write (`writing`). It is saved before the first change, so a run that is killed leaves nothing on
the machine that the next run does not know of. A path with `writing` alone is owned if it holds that content.
`pending` names the service that has yet to read them again.

Root acts only in folders that root alone can change. Elsewhere it does not even remove its own files: a link in the
place of a folder would lead it to another folder.
"""

import contextlib
import hashlib
import os
import pathlib
import re
import stat
import typing

from .._module import trust
from .._module.difference import difference
from .._module.plain_text import quote
from .._module.problem import Problem
from . import atomic, ownership
from .record import Record, records
from .transaction import Step, intent, outcome

_FILE = "a file"
_FOLDER = "a folder"
_CACHE = "__pycache__"
_PLAIN = re.compile(r"(/[^/\0]+)+")
_BUNDLE = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,63}")

# The form of the records. Those of services have more than those of files, and both have folders.
_SHAPE = {
    "files": {"*": {"*": str}},
    "folders": [str],
    "units": [str],
    "pending": [str],
    "directories": {"*": [str]},
    "parents": [str],
}

Data = typing.Dict[str, typing.Any]
Entries = typing.Dict[str, typing.Set[str]]  # folder -> the names in it


class PlannedFile(typing.NamedTuple):
    """A planned file."""

    path: str
    content: bytes
    mode: int
    owner: typing.Optional[typing.Tuple[int, int]] = None  # (uid, gid), None for those that the module runs as
    sha256: str = ""  # of the content, where only that is known: such a file is compared and never written


class FileState(typing.NamedTuple):
    """The thing that stands at a path."""

    kind: str
    content: bytes  # of a symbolic link its target; empty for a folder or a device
    mode: int
    owner: typing.Tuple[int, int]  # (uid, gid)
    attributes: atomic.Attributes = {}  # of a file


class Machine(typing.NamedTuple):
    """All on the machine that a plan depends on."""

    states: typing.Dict[
        str, typing.Optional[FileState]
    ]  # every path of the plan and of the record, unless it is unsafe
    folders: typing.Dict[str, str]  # every folder above a planned path: its kind, "" where it is missing
    entries: Entries  # the names in every folder of this bundle and in its byte-code cache
    leftovers: typing.List[str]  # half-written neighbours of an interrupted run
    folders_of_others: typing.Set[str]  # folders that other bundles made
    owner: typing.Tuple[int, int]  # the (uid, gid) that the module runs as, which owns a planned file by default
    unsafe: typing.Dict[str, str] = {}  # paths and folders that other users can replace, each with the reason


class Item(typing.NamedTuple):
    """A planned file in the result: unchanged, written, edited (drift, to be repaired) or foreign (right, not owned)."""

    file: PlannedFile
    state: str


Pair = typing.Tuple[typing.Optional[FileState], typing.Optional[PlannedFile]]  # a file before and after


class FilePlan(typing.NamedTuple):
    """The changes, and the record before and after them."""

    items: typing.List[Item]  # one per planned file, in its order
    writes: typing.List[PlannedFile]
    removals: typing.List[str]
    folders: "FolderPlan"
    notes: typing.List[str]
    intent: Data  # the record while the run is at work
    after: Data  # the record after it


def parse_files(files: typing.Iterable[Data]) -> typing.List[PlannedFile]:
    """Read the planned files from mappings of path, content (text), mode, and owner and group or none. Raises Problem."""
    wanted = [_parse_file(entry) for entry in files]
    paths: typing.Set[str] = set()
    for file in wanted:
        if file.path in paths:
            raise Problem(f"The path {file.path} is listed twice in the files; list it once.")
        paths.add(file.path)
    for file in wanted:
        for folder in _parents(file.path):
            if folder in paths:
                raise Problem(
                    f"The files list {folder} and {file.path}, but the first cannot be a file and the folder of the "
                    "second; change one of the two paths."
                )
    return wanted


def _parse_file(entry: Data) -> PlannedFile:
    path = entry["path"]
    if not _is_plain(path):
        raise Problem(
            f"The path {path!r} of the files is not absolute and plain; expected for example /etc/example/file, "
            "without '..', '//' or '/' at the end."
        )
    mode = ownership.parse_mode(entry["mode"])
    if mode is None:
        raise Problem(
            f"The mode {entry['mode']!r} of {path} is not understood; expected octal digits in quotes, for example "
            "'0644', or a symbolic mode such as u=rw,go=r."
        )
    owner = ownership.find_owner(path, entry.get("owner"), entry.get("group"))
    content = entry["content"].encode("utf-8", "surrogateescape")
    return PlannedFile(path, content, mode, owner, entry.get("sha256") or "")


def record_of(kind: str, bundle: str, folder: str) -> Record:
    """Return the record of a bundle of this kind (files, services). Raises Problem for a label that is no file name."""
    if not _BUNDLE.fullmatch(bundle):
        raise Problem(
            f"The bundle {bundle!r} is not usable as a label; expected 1 to 64 letters, digits, '.', '_' and '-', "
            "for example nodes."
        )
    if not os.path.isabs(folder):
        raise Problem(f"records is {folder!r}, expected an absolute path.")
    return Record(f"{kind}-{bundle}", folder, _SHAPE)


def digest(files: typing.Iterable[PlannedFile]) -> str:
    """One SHA-256 (hexadecimal) over the paths, modes and contents, whatever their order."""
    total = hashlib.sha256()
    for file in sorted(files):
        total.update(f"{file.path} {_fingerprint(file)}\n".encode("utf-8", "surrogateescape"))
    return total.hexdigest()


# The machine


def read(files: typing.List[PlannedFile], remembered: Data, record: Record) -> Machine:
    """Read everything on the machine that a plan of these files and this record depends on. Raises OSError, Problem."""
    paths = {file.path for file in files} | set(remembered.get("files", {}))
    owned_folders = remembered.get("folders", [])
    unsafe = _unsafe(paths, owned_folders)
    return Machine(
        states={path: look(path) for path in paths if path not in unsafe},
        folders={folder: _kind(folder) for file in files for folder in _parents(file.path)},
        entries=_entries([folder for folder in owned_folders if folder not in unsafe]),
        leftovers=sorted(
            leftover
            for path, entry in remembered.get("files", {}).items()
            if path not in unsafe and "writing" in entry
            for leftover in atomic.leftovers(path)
        ),
        folders_of_others=_folders_of_others(record),
        owner=(os.geteuid(), os.getegid()),
        unsafe=unsafe,
    )


def _entries(folders: typing.Iterable[str]) -> Entries:
    """The names in these folders and in their byte-code caches."""
    both = [path for folder in folders for path in (folder, os.path.join(folder, _CACHE))]
    return {path: set(os.listdir(path)) for path in both if os.path.isdir(path) and not os.path.islink(path)}


def _unsafe(paths: typing.Iterable[str], folders: typing.Iterable[str]) -> typing.Dict[str, str]:
    """Find the paths and folders that other users than root can replace, each with the reason in a few words.

    A group that may write is trusted: root has given it the right, as Debian gives /usr/local to the group staff.
    """
    if os.geteuid() != 0:
        return {}  # an ordinary user has no rights to gain
    view = trust.Look()
    places = [(path, os.path.dirname(path)) for path in sorted(paths)] + [(folder, folder) for folder in folders]
    why = {
        place: [doubt.words for doubt in view.doubts(folder) if doubt.who != trust.A_GROUP] for place, folder in places
    }
    return {place: words[0] for place, words in why.items() if words}


def _folders_of_others(record: Record) -> typing.Set[str]:
    """The folders in the records of all other bundles."""
    folders: typing.Set[str] = set()
    place, own = os.path.split(record.path)
    for name in records(place):
        if name.startswith(("files-", "services-")) and f"{name}.json" != own:
            folders.update(Record(name, place, _SHAPE).load().get("folders", []))
    return folders


def look(path: str) -> typing.Optional[FileState]:
    """Look at a path itself, without following a symbolic link; None where nothing is there."""
    try:
        status = os.lstat(path)
    except (FileNotFoundError, NotADirectoryError):
        return None
    kind, content = _FILE, b""
    if stat.S_ISREG(status.st_mode):
        content = atomic.read_bytes(path) or b""
    elif stat.S_ISLNK(status.st_mode):
        content = os.readlink(os.fsencode(path))
        kind = f"a symbolic link to {quote(os.fsdecode(content))}"
    else:
        kind = _FOLDER if stat.S_ISDIR(status.st_mode) else "a device, pipe or socket"
    attributes = atomic.attributes(path)
    return FileState(kind, content, stat.S_IMODE(status.st_mode), (status.st_uid, status.st_gid), attributes)


def _kind(folder: str) -> str:
    """The kind of a folder above a planned path: a symbolic link to a folder is a folder, "" is a missing one."""
    if os.path.isdir(folder):
        return _FOLDER
    state = look(folder)
    return state.kind if state else ""


def _parents(path: str) -> typing.List[str]:
    """The folders above a path without the root, innermost first."""
    return [str(folder) for folder in pathlib.PurePosixPath(path).parents][:-1]


def _is_plain(path: str) -> bool:
    """Say if a path is absolute, without '..'. For normpath alone, two slashes in front are a place of their own (POSIX)."""
    return _PLAIN.fullmatch(path) is not None and os.path.normpath(path) == path


def _fingerprint(file: PlannedFile) -> str:
    """The mode and the digest of a planned file, and its owner where one is asked for."""
    owner = f" {file.owner[0]}:{file.owner[1]}" if file.owner else ""
    return f"{file.mode:04o} {file.sha256 or hashlib.sha256(file.content).hexdigest()}{owner}"


def _matches(state: typing.Optional[FileState], fingerprint: str) -> bool:
    """True for a file with this fingerprint; one without an owner says nothing about it."""
    if state is None or state.kind != _FILE:
        return False
    actual = [f"{state.mode:04o}", hashlib.sha256(state.content).hexdigest(), f"{state.owner[0]}:{state.owner[1]}"]
    expected = fingerprint.split()
    return actual[: len(expected)] == expected


# The plan

# The note on a planned file, by its state.
_NOTES = {
    "edited": "{path} had been changed or removed by hand since we wrote it.",
    "foreign": "{path} is as planned already and not ours, so it stays and will stay.",
}


def find_owned_files(remembered: Data, machine: Machine) -> typing.Dict[str, str]:
    """The owned paths, with the fingerprint of what was written last, also after a run that was killed; pure."""
    owned = {}
    for path, entry in remembered.get("files", {}).items():
        if path in machine.unsafe:
            continue
        if "writing" in entry and _matches(machine.states[path], entry["writing"]):
            owned[path] = entry["writing"]
        elif "written" in entry:
            owned[path] = entry["written"]
    return owned


def plan_files(files: typing.List[PlannedFile], remembered: Data, machine: Machine) -> FilePlan:
    """Plan the changes; pure. Raises Problem, with a sentence per path, where something not owned is in the way."""
    _refuse_unsafe(files, machine)
    owned = find_owned_files(remembered, machine)
    items = [Item(file, _state(file, machine.states[file.path], owned.get(file.path), machine.owner)) for file in files]
    kept = {item.file.path: item.file for item in items if item.state != "foreign"}
    removals = [path for path in sorted(owned) if path not in kept and machine.states[path] is not None]
    _refuse(items, machine, removals)

    before = set(remembered.get("folders", [])) - set(machine.unsafe)
    folders = _plan_folders(kept, removals, before, machine)
    writes = [item.file for item in items if item.state in ("written", "edited")]
    files_of_intent = {path: {"written": owned[path]} for path in owned}
    for file in writes:
        files_of_intent.setdefault(file.path, {})["writing"] = _fingerprint(file)
    return FilePlan(
        items=items,
        writes=writes,
        removals=removals,
        folders=folders,
        notes=[*_notes(items, removals, folders, owned, machine), *_notes_on_unsafe(remembered, machine)],
        intent={"files": files_of_intent, "folders": sorted(before | set(folders.owned))},
        after={"files": {path: {"written": _fingerprint(kept[path])} for path in kept}, "folders": folders.owned},
    )


def _notes(
    items: typing.List[Item],
    removals: typing.List[str],
    folders: "FolderPlan",
    owned: typing.Dict[str, str],
    machine: Machine,
) -> typing.List[str]:
    """The notes on drift, on files that are right but not owned, and on folders that stay."""
    notes = [_NOTES[item.state].format(path=item.file.path) for item in items if item.state in _NOTES]
    edited = [path for path in removals if not _matches(machine.states[path], owned[path])]
    notes += [f"{path}, which goes, had been changed by hand since we wrote it." for path in edited]
    return notes + [f"{quote(folder)} stays, because it holds files that are not ours." for folder in folders.kept]


def _notes_on_unsafe(remembered: Data, machine: Machine) -> typing.List[str]:
    """The notes on our files and folders that stay, since their place is not safe."""
    ours = [*remembered.get("files", {}), *remembered.get("folders", [])]
    return [
        f"{path} was ours and stays, since {machine.unsafe[path]}; expected folders that root alone can change: remove it by hand."
        for path in ours
        if path in machine.unsafe
    ]


def _state(
    file: PlannedFile, present: typing.Optional[FileState], owned: typing.Optional[str], owner: typing.Tuple[int, int]
) -> str:
    """The state of a planned file as in Item, or "conflict": something that is not owned is in its way.

    `owned` is the fingerprint of what was written last, None for a file that is not owned.
    """
    if present is None:
        return "edited" if owned else "written"
    right = _matches(present, _fingerprint(file))
    if owned is None:
        return "foreign" if right else "conflict"
    if present.kind == _FOLDER:
        return "conflict"
    if right and present.owner == (file.owner or owner):
        return "unchanged"
    has_owner = len(owned.split()) > 2
    return "written" if _matches(present, owned) and (has_owner or present.owner == owner) else "edited"


def _refuse_unsafe(files: typing.Iterable[PlannedFile], machine: Machine) -> None:
    """Raise Problem with a sentence for every planned path that other users can replace."""
    problems = [
        f"{file.path} is not written, since {machine.unsafe[file.path]}; expected folders that root alone can change: choose "
        "another path, or give its folders to root (chown, chmod)."
        for file in files
        if file.path in machine.unsafe
    ]
    if problems:
        raise Problem(" ".join(problems))


def _refuse(items: typing.List[Item], machine: Machine, removals: typing.List[str]) -> None:
    """Raise Problem with a sentence for every file or folder that blocks the plan."""
    problems = [
        _describe_conflict(item.file, machine.states[item.file.path]) for item in items if item.state == "conflict"
    ]
    problems += [
        f"{folder} is {kind}, expected a folder for planned files: move it away."
        for folder, kind in sorted(machine.folders.items())
        if kind not in ("", _FOLDER)
    ]
    problems += [
        f"{path} was a file of ours and is a folder now, so it is not removed: move it away."
        for path in removals
        if _is_folder(machine.states[path])
    ]
    if problems:
        raise Problem(" ".join(problems))


def _is_folder(state: typing.Optional[FileState]) -> bool:
    return state is not None and state.kind == _FOLDER


def _describe_conflict(file: PlannedFile, present: typing.Optional[FileState]) -> str:
    what = present.kind if present else "nothing"
    if present and present.kind == _FILE:
        what = f"a file of {len(present.content)} bytes with mode {present.mode:04o}"
        what += f" and owner {present.owner[0]}:{present.owner[1]}" if file.owner else ""
    planned = f" and owner {file.owner[0]}:{file.owner[1]}" if file.owner else ""
    return (
        f"{file.path} is {what} that this collection did not write, and the plan is a file of {len(file.content)} bytes "
        f"with mode {file.mode:04o}{planned}: move it away, or take the path out of the plan."
    )


class FolderPlan(typing.NamedTuple):
    """The part of a plan that is about folders."""

    made: typing.List[str]  # outermost first
    removed: typing.List[str]  # innermost first
    kept: typing.List[str]  # no longer needed, but not empty
    rubbish: typing.List[str]  # of an interrupted run, and byte code in owned folders whose source is gone
    owned: typing.List[str]  # after the change


def _plan_folders(
    kept: typing.Iterable[str], removals: typing.List[str], before: typing.Set[str], machine: Machine
) -> FolderPlan:
    """Plan the folders for the files that are owned from now on; `before` are the folders in the record."""
    needed = {folder for path in kept for folder in _parents(path)}
    made = sorted(folder for folder in needed if not machine.folders[folder])
    rubbish = machine.leftovers + _orphans(before, set(removals), set(kept), machine.entries)
    removed, staying = _find_empty_folders(before - needed, before, set(removals) | set(rubbish), machine.entries)
    owned = sorted((before | machine.folders_of_others | set(made)) & needed)
    return FolderPlan(made, removed, staying, rubbish, owned)


def _orphans(
    folders: typing.Set[str], gone: typing.Set[str], stays: typing.Set[str], entries: Entries
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


def _find_empty_folders(
    unneeded: typing.Set[str], owned: typing.Set[str], gone: typing.Set[str], entries: Entries
) -> typing.Tuple[typing.List[str], typing.List[str]]:
    """The folders and caches that are empty then, innermost first, and the unneeded folders that are not."""
    gone = set(gone)
    removed, staying = [], []
    for folder in sorted(owned, reverse=True):
        cache = os.path.join(folder, _CACHE)
        for path in (cache, folder) if folder in unneeded else (cache,):
            if path in entries and all(os.path.join(path, name) in gone for name in entries[path]):
                removed.append(path)
                gone.add(path)
            elif path in entries and path == folder:
                staying.append(folder)
    return removed, staying


def changes(plan: FilePlan) -> bool:
    """True if a plan changes anything but the record."""
    folders = plan.folders
    return bool(plan.writes or plan.removals or folders.rubbish or folders.made or folders.removed)


def places(plan: FilePlan, record: Record) -> typing.List[str]:
    """The paths that carrying out a plan writes or removes, with its record; none where nothing changes."""
    paths = [file.path for file in plan.writes] + plan.removals + plan.folders.rubbish
    return [*paths, record.path] if changes(plan) else []


# The steps

_RESTORE_FAILURE = "{what} could not be put back ({reason})."
RECORD_RESTORE_FAILURE = "The record {what} could not be put back ({reason})."


def steps(plan: FilePlan, machine: Machine) -> typing.List[Step]:
    """The steps that carry out a plan, without its record."""
    result = [_removal(path, machine.states[path]) for path in plan.removals]
    for file in plan.writes:
        result += [_folders_for(file.path), _write(file, machine)]
    result.append(Step("what is left over", lambda: _tidy(plan)))
    return result


def _removal(path: str, before: typing.Optional[FileState]) -> Step:
    def remove() -> None:
        atomic.remove(path)
        if os.path.isdir(os.path.dirname(path)):
            atomic.sync_folder(os.path.dirname(path))

    return Step(path, remove, lambda: _restore(path, before), failure=_RESTORE_FAILURE)


def _write(file: PlannedFile, machine: Machine) -> Step:
    return Step(
        file.path,
        lambda: atomic.write_by_rename(file.path, file.content, file.mode, file.owner or machine.owner),
        lambda: _restore(file.path, machine.states[file.path]),
        failure=_RESTORE_FAILURE,
    )


def _folders_for(path: str) -> Step:
    """The step that makes the missing folders above a path."""
    folder = os.path.dirname(path)
    made: typing.List[str] = []

    def remove_again() -> typing.List[str]:
        left = []
        for folder in reversed(made):
            try:
                atomic.remove_folder_if_empty(folder)
            except OSError as problem:
                left.append(f"The folder {folder} could not be removed again ({problem.strerror or problem}).")
        return left

    return Step(folder, lambda: made.extend(atomic.make_folders(folder)), remove_again)


def _tidy(plan: FilePlan) -> None:
    for path in plan.folders.rubbish:
        atomic.remove(path)
    for folder in plan.folders.removed:
        atomic.remove_folder_if_empty(folder)


def _restore(path: str, before: typing.Optional[FileState]) -> None:
    if look(path) == before:  # the step has failed before it changed anything
        return
    if before is None:
        atomic.remove(path)
        return
    atomic.make_folders(os.path.dirname(path))
    if before.kind == _FILE:
        atomic.write_by_rename(path, before.content, before.mode, before.owner, before.attributes)
    else:
        atomic.remove(path)
        os.symlink(before.content, os.fsencode(path))


class FileBundle:
    """The files of a bundle, read and planned. Making it raises OSError, Problem."""

    def __init__(self, bundle: str, folder: str, entries: typing.Iterable[Data]) -> None:
        """`folder`: that of the records."""
        self.record = record_of("files", bundle, folder)
        self.wanted = parse_files(entries)
        self.remembered = self.record.load()
        self.machine = read(self.wanted, self.remembered, self.record)
        self.plan = plan_files(self.wanted, self.remembered, self.machine)
        self.changed = changes(self.plan)

    def steps_around(self, others: typing.Iterable[Step] = ()) -> typing.List[Step]:
        """The steps that carry out the plan, with its record, around other steps."""
        begin = []
        if self.changed:
            begin = [intent(self.record, self.plan.intent, self.remembered, RECORD_RESTORE_FAILURE)]
            begin += steps(self.plan, self.machine)
        return [*begin, *others, outcome(self.record, _worth_saving(self.plan.after))]

    def forget_pending(self) -> None:
        """Save that what was pending after the steps is done. Where that fails, the next run does it once more."""
        with contextlib.suppress(OSError):
            self.record.save(_worth_saving({**self.plan.after, "pending": []}))

    @property
    def places(self) -> typing.List[str]:
        """The paths that the steps write or remove."""
        return places(self.plan, self.record)

    def differences(self, brief: typing.Iterable[str] = ()) -> typing.List[typing.Dict[str, str]]:
        """The `diff` of a module, see the function `differences`."""
        return differences(self.plan, self.machine, brief)


def _worth_saving(after: Data) -> Data:
    """The data of a record, empty where it has nothing to say."""
    return after if any(after.values()) else {}


# The difference


def differences(
    plan: FilePlan, machine: Machine, brief: typing.Iterable[str] = ()
) -> typing.List[typing.Dict[str, str]]:
    """The `diff` of a module: one entry per file that changes, and one line for all that are below a `brief` folder."""
    entries = []
    folders: typing.Dict[str, typing.List[Pair]] = {folder.rstrip("/"): [] for folder in brief}
    after: typing.Optional[PlannedFile]
    for path, after in [(file.path, file) for file in plan.writes] + [(path, None) for path in plan.removals]:
        before = machine.states[path]
        folder = next((folder for folder in folders if path.startswith(folder + "/")), None)
        if folder is None:
            entries.append(_difference_of(path, before, after, machine.owner))
        else:
            folders[folder].append((before, after))
    return entries + [_summary(folder, pairs) for folder, pairs in folders.items() if pairs]


def _summary(folder: str, pairs: typing.List[Pair]) -> typing.Dict[str, str]:
    """Count what changes below a folder; for example "3 files, 900 bytes: 1 new, 2 changed, 0 removed"."""
    before = [old for old, new in pairs if old]
    left = [new for old, new in pairs if new]
    changed = len(before) + len(left) - len(pairs)
    deeds = f"{len(left) - changed} new, {changed} changed, {len(before) - changed} removed"
    header = f"files below {folder} that change"
    return {
        "before_header": header,
        "after_header": header,
        "before": f"{_size(before)}\n" if before else "",
        "after": f"{_size(left)}: {deeds}\n",
    }


def _size(files: typing.Sequence[typing.Union[FileState, PlannedFile]]) -> str:
    return f"{len(files)} files, {sum(len(file.content) for file in files)} bytes"


def _difference_of(
    path: str, before: typing.Optional[FileState], after: typing.Optional[PlannedFile], owner: typing.Tuple[int, int]
) -> typing.Dict[str, str]:
    entry = difference(path, before and before.content, after and after.content)
    if before and after and before.kind == _FILE and before.content == after.content:
        entry["before"] = f"mode {before.mode:04o}, owner {before.owner[0]}:{before.owner[1]}\n"
        uid, gid = after.owner or owner
        entry["after"] = f"mode {after.mode:04o}, owner {uid}:{gid}\n"
    elif before and before.kind != _FILE:
        entry["before"] = f"({before.kind})\n"
    return entry
