# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Files that a bundle owns whole, and the folders made for them: the present state, the plan, and the steps of the change.

A bundle's record holds for each path the fingerprint of the written content (`written`) and, while a run is at work, of
the content that it is about to write (`writing`). It is saved before the first change, so a run that is killed leaves nothing on
the machine that the next run does not know of. A path with only `writing` is owned if it holds that content.
`pending` names the service that has yet to read them again.

Root acts only in folders that only root can change. Elsewhere it does not even remove its own files: a link in the
place of a folder would lead it to another folder.
"""

import contextlib
import functools
import hashlib
import os
import pathlib
import re
import stat
import typing

from ..._base import trust
from ..._base.difference import difference
from ..._base.plain_text import quote
from ..._base.problem import Problem
from . import atomic, ownership
from .record import Record, check_absolute, records
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
    sha256: str = ""  # of the content, if only that is known: such a file is compared and never written


class FileState(typing.NamedTuple):
    """The thing at a path."""

    kind: str  # empty if nothing is there
    content: bytes  # of a symbolic link its target; empty for a folder or a device
    mode: int
    owner: typing.Tuple[int, int]  # (uid, gid)
    attributes: atomic.Attributes = {}  # of a file


_NOTHING = FileState("", b"", 0, (0, 0))


class FileResult(typing.NamedTuple):
    """A planned file in the result: unchanged, written, edited (drift, to be repaired) or foreign (right, not owned)."""

    file: PlannedFile
    state: str


Pair = typing.Tuple[FileState, typing.Optional[PlannedFile]]  # a file before and after


def parse_files(files: typing.Iterable[Data]) -> typing.List[PlannedFile]:
    """Read the planned files from mappings of path, content (text), mode, and owner and group, which may be missing. Raises Problem."""
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
    check_absolute({"records": folder}, "records")
    return Record(f"{kind}-{bundle}", folder, _SHAPE)


def digest(files: typing.Iterable[PlannedFile]) -> str:
    """One SHA-256 (hexadecimal) over the paths, modes and contents, whatever their order."""
    total = hashlib.sha256()
    for file in sorted(files):
        total.update(f"{file.path} {_fingerprint(file)}\n".encode("utf-8", "surrogateescape"))
    return total.hexdigest()


# The machine


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
    view = trust.TrustCheck()
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


def look(path: str) -> FileState:
    """Look at a path itself, without following a symbolic link."""
    try:
        status = os.lstat(path)
    except (FileNotFoundError, NotADirectoryError):
        return _NOTHING
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


def _parents(path: str) -> typing.List[str]:
    """The folders above a path without the root, innermost first."""
    return [str(folder) for folder in pathlib.PurePosixPath(path).parents][:-1]


def _is_plain(path: str) -> bool:
    """Return True if a path is absolute, without '..'. Only for normpath, two slashes in front are a place of their own (POSIX)."""
    return _PLAIN.fullmatch(path) is not None and os.path.normpath(path) == path


def _fingerprint(file: PlannedFile) -> str:
    """The mode and the digest of a planned file, and its owner if one is asked for."""
    owner = f" {file.owner[0]}:{file.owner[1]}" if file.owner else ""
    return f"{file.mode:04o} {file.sha256 or hashlib.sha256(file.content).hexdigest()}{owner}"


def _matches(state: FileState, fingerprint: str) -> bool:
    """True for a file with this fingerprint; one without an owner says nothing about it."""
    if state.kind != _FILE:
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


def _refuse(problems: typing.Sequence[str]) -> None:
    """Raise Problem with these sentences, if there are any."""
    if problems:
        raise Problem(" ".join(problems))


def _describe_conflict(file: PlannedFile, present: FileState) -> str:
    what = present.kind
    if what == _FILE:
        what = f"a file of {len(present.content)} bytes with mode {present.mode:04o}"
        what += f" and owner {present.owner[0]}:{present.owner[1]}" if file.owner else ""
    planned = f" and owner {file.owner[0]}:{file.owner[1]}" if file.owner else ""
    return (
        f"{file.path} is {what} that this collection did not write, and the plan is a file of {len(file.content)} bytes "
        f"with mode {file.mode:04o}{planned}: move it away, or take the path out of the plan."
    )


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


# The steps

_RESTORE_FAILURE = "{what} could not be put back ({reason})."
RECORD_RESTORE_FAILURE = "The record {what} could not be put back ({reason})."


def removal(path: str, before: FileState) -> Step:
    """The step that removes a file."""
    return Step(path, lambda: atomic.remove_for_good(path), lambda: restore(path, before), failure=_RESTORE_FAILURE)


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


def restore(path: str, before: FileState) -> None:
    """Bring back the thing that was at a path. Raises OSError."""
    if look(path) == before:  # the step has failed before it changed anything
        return
    if not before.kind:
        atomic.remove_for_good(path)
        return
    atomic.make_folders(os.path.dirname(path))
    if before.kind == _FILE:
        atomic.write_by_rename(path, before.content, before.mode, before.owner, before.attributes)
    else:
        atomic.remove(path)
        os.symlink(before.content, os.fsencode(path))
        atomic.sync_folder(os.path.dirname(path))


class FileBundle:
    """The files of a bundle on the machine, and those that are wanted."""

    def __init__(self, kind: str, bundle: str, folder: str, entries: typing.Iterable[Data]) -> None:
        """Read the machine. `kind`: files or services; `folder`: that of the records. Raises OSError, Problem."""
        self.record = record_of(kind, bundle, folder)
        self.wanted = parse_files(entries)
        self.remembered = self.record.load()
        self.owner = (os.geteuid(), os.getegid())  # owns a planned file by default
        files, folders = self.remembered.get("files", {}), self.remembered.get("folders", [])
        paths = {file.path for file in self.wanted} | set(files)
        self.unsafe = _unsafe(paths, folders)  # each with the reason
        self.states = {path: look(path) for path in paths if path not in self.unsafe}
        self.owned: typing.Dict[
            str, str
        ] = {}  # path -> the content that was written last, also by a run that was killed
        for path, entry in files.items():
            if path in self.unsafe:
                continue
            if "writing" in entry and _matches(self.states[path], entry["writing"]):
                self.owned[path] = entry["writing"]
            elif "written" in entry:
                self.owned[path] = entry["written"]

    def make_plan(self) -> "FilePlan":
        """Plan the changes.

        Raises OSError, and Problem with a sentence per path if something not owned is in the way.
        """
        self._refuse_unsafe()
        return FilePlan(self)

    def _refuse_unsafe(self) -> None:
        """Raise Problem with a sentence for every planned path that other users can replace."""
        _refuse(
            [
                f"{file.path} is not written, since {self.unsafe[file.path]}; expected folders that only root can change: choose "
                "another path, or give its folders to root (chown, chmod)."
                for file in self.wanted
                if file.path in self.unsafe
            ]
        )

    def find_state(self, file: PlannedFile) -> str:
        """The state of a planned file as in FileResult, or "conflict": something that is not owned is in its way."""
        present, owned = self.states[file.path], self.owned.get(file.path)
        if not present.kind:
            return "edited" if owned else "written"
        right = _matches(present, _fingerprint(file))
        if owned is None:
            return "foreign" if right else "conflict"
        if present.kind == _FOLDER:
            return "conflict"
        if right and present.owner == (file.owner or self.owner):
            return "unchanged"
        has_owner = len(owned.split()) > 2
        return "written" if _matches(present, owned) and (has_owner or present.owner == self.owner) else "edited"

    def find_leftovers(self) -> typing.List[str]:
        """Find the half-written neighbours of an interrupted run."""
        entries = self.remembered.get("files", {})
        begun = [path for path, entry in entries.items() if path not in self.unsafe and "writing" in entry]
        return sorted(leftover for path in begun for leftover in atomic.leftovers(path))


class FolderPlan(typing.NamedTuple):
    """The folders of a bundle, and the files in them that go although no record has them."""

    before: typing.Set[str]  # those in the record that only root can change
    made: typing.List[str]  # outermost first
    removed: typing.List[str]  # with byte-code caches, innermost first
    kept: typing.List[str]  # needed no more, and with foreign files
    owned: typing.List[str]  # from now on
    rubbish: typing.List[str]  # of an interrupted run, and byte code in owned folders whose source is gone


def _plan_folders(bundle: FileBundle, kept: typing.Collection[str], removals: typing.Iterable[str]) -> FolderPlan:
    """Plan the folders for the files that are owned from now on (`kept`)."""
    before = set(bundle.remembered.get("folders", [])) - set(bundle.unsafe)
    needed = {folder for path in kept for folder in _parents(path)}
    made = sorted(folder for folder in needed if not os.path.isdir(folder))
    entries, gone = _entries(before), set(removals)
    rubbish = bundle.find_leftovers() + _orphans(before, gone, set(kept), entries)
    removed, staying = _find_empty_folders(before - needed, before, gone | set(rubbish), entries)
    owned = sorted((before | _folders_of_others(bundle.record) | set(made)) & needed)
    return FolderPlan(before, made, removed, staying, owned, rubbish)


class FilePlan:
    """The changes of a bundle, and the steps that carry them out."""

    def __init__(self, bundle: FileBundle) -> None:
        """See FileBundle.make_plan."""
        self.bundle, self.record, self.remembered = bundle, bundle.record, bundle.remembered
        self.items = [FileResult(file, bundle.find_state(file)) for file in bundle.wanted]  # in their order
        kept = {item.file.path: item.file for item in self.items if item.state != "foreign"}
        self.writes = [item.file for item in self.items if item.state in ("written", "edited")]
        self.removals = [path for path in sorted(bundle.owned) if path not in kept and bundle.states[path].kind]
        # A run that was killed may have removed these right before: then a loss of power brings them back.
        absent = {path for path, state in bundle.states.items() if not state.kind}
        self.gone = sorted(absent.intersection(self.remembered.get("files", {})).difference(kept))
        self._refuse_obstacles()
        self.folders = folders = _plan_folders(bundle, kept, self.removals)
        self.changed = any([self.writes, self.removals, folders.rubbish, folders.made, folders.removed])
        self.notes = self._notes()
        files = {path: {"written": fingerprint} for path, fingerprint in bundle.owned.items()}
        for file in self.writes:
            files.setdefault(file.path, {})["writing"] = _fingerprint(file)
        # The record while the run is at work, and after it.
        self.intent: Data = {"files": files, "folders": sorted(folders.before | set(folders.owned))}
        written = {path: {"written": _fingerprint(file)} for path, file in kept.items()}
        self.after: Data = {"files": written, "folders": folders.owned}

    def _refuse_obstacles(self) -> None:
        """Raise Problem with a sentence for every file or folder that blocks the plan."""
        problems = [
            _describe_conflict(item.file, self.bundle.states[item.file.path])
            for item in self.items
            if item.state == "conflict"
        ]
        above = sorted({folder for file in self.bundle.wanted for folder in _parents(file.path)})
        kinds = {folder: look(folder).kind for folder in above if not os.path.isdir(folder)}
        problems += [
            f"{folder} is {kind}, expected a folder for planned files: move it away."
            for folder, kind in kinds.items()
            if kind
        ]
        problems += [
            f"{path} was a file of ours and is a folder now, so it is not removed: move it away."
            for path in self.removals
            if self.bundle.states[path].kind == _FOLDER
        ]
        _refuse(problems)

    def _notes(self) -> typing.List[str]:
        """The notes on drift, on files that are right but not owned, and on files and folders that stay."""
        notes = [_NOTES[item.state].format(path=item.file.path) for item in self.items if item.state in _NOTES]
        edited = [path for path in self.removals if not _matches(self.bundle.states[path], self.bundle.owned[path])]
        notes += [f"{path}, which goes, had been changed by hand since we wrote it." for path in edited]
        notes += [f"{quote(folder)} stays, because it holds files that are not ours." for folder in self.folders.kept]
        ours = [*self.remembered.get("files", {}), *self.remembered.get("folders", [])]
        return notes + [
            f"{path} was ours and stays, since {self.bundle.unsafe[path]}; expected folders that only root can change: remove it by hand."
            for path in ours
            if path in self.bundle.unsafe
        ]

    # The change

    @property
    def places(self) -> typing.List[str]:
        """The paths that the steps write or remove, with the record; empty if nothing changes."""
        paths = [file.path for file in self.writes] + self.removals + self.folders.rubbish
        return [*paths, self.record.path] if self.changed else []

    def steps(self) -> typing.List[Step]:
        """The steps that carry out the plan, without its record."""
        result = [*self._sync_steps(), *(removal(path, self.bundle.states[path]) for path in self.removals)]
        for file in self.writes:
            result += [_folders_for(file.path), self._write(file)]
        return [*result, Step("the remains", self._tidy)]

    def _sync_steps(self) -> typing.List[Step]:
        """The steps that come before the record forgets files that are gone."""
        return [Step(path, functools.partial(atomic.sync_removal, path)) for path in self.gone]

    def _write(self, file: PlannedFile) -> Step:
        return Step(
            file.path,
            lambda: atomic.write_by_rename(file.path, file.content, file.mode, file.owner or self.bundle.owner),
            lambda: restore(file.path, self.bundle.states[file.path]),
            failure=_RESTORE_FAILURE,
        )

    def _tidy(self) -> None:
        for path in self.folders.rubbish:
            atomic.remove(path)
        for folder in self.folders.removed:
            atomic.remove_folder_if_empty(folder)

    def steps_around(self, others: typing.Iterable[Step] = ()) -> typing.List[Step]:
        """The steps that carry out the plan, with its record, around other steps."""
        begin = self._sync_steps()
        if self.changed:
            begin = [intent(self.record, self.intent, self.remembered, RECORD_RESTORE_FAILURE), *self.steps()]
        return [*begin, *others, outcome(self.record, self.after)]

    def expect(self, action: str, is_about: typing.Callable[[str], bool], due: bool = False) -> bool:
        """Return True if a action is to follow the steps: one that is due, that is about a path which changes, or that was left undone.

        The record has it until `forget_pending`, also for the next run if this one fails or is killed.
        """
        paths = [file.path for file in self.writes] + self.removals
        if not (due or action in self.remembered.get("pending", []) or any(map(is_about, paths))):
            return False
        self.intent["pending"] = self.after["pending"] = [action]
        return True

    def forget_pending(self) -> None:
        """Save that the work that was pending after the steps is done. If that fails, the next run does it once more."""
        with contextlib.suppress(OSError):
            self.record.save({**self.after, "pending": []})

    def differences(self, brief: typing.Iterable[str] = ()) -> typing.List[typing.Dict[str, str]]:
        """The `diff` of a module: an entry per file that changes, and one line for all below a `brief` folder."""
        entries = []
        folders: typing.Dict[str, typing.List[Pair]] = {folder.rstrip("/"): [] for folder in brief}
        after: typing.Optional[PlannedFile]
        for path, after in [(file.path, file) for file in self.writes] + [(path, None) for path in self.removals]:
            before = self.bundle.states[path]
            folder = next((folder for folder in folders if path.startswith(folder + "/")), None)
            if folder is None:
                entries.append(_difference_of(path, before, after, self.bundle.owner))
            else:
                folders[folder].append((before, after))
        return entries + [_summary(folder, pairs) for folder, pairs in folders.items() if pairs]


# The difference


def _summary(folder: str, pairs: typing.List[Pair]) -> typing.Dict[str, str]:
    """Count the changes below a folder; for example "3 files, 900 bytes: 1 new, 2 changed, 0 removed"."""
    before = [old for old, new in pairs if old.kind]
    left = [new for old, new in pairs if new]
    changed = len(before) + len(left) - len(pairs)
    actions = f"{len(left) - changed} new, {changed} changed, {len(before) - changed} removed"
    size = f"{_size(before)}\n" if before else ""
    return difference(f"files below {folder} that change", size, f"{_size(left)}: {actions}\n")


def _size(files: typing.Sequence[typing.Union[FileState, PlannedFile]]) -> str:
    return f"{len(files)} files, {sum(len(file.content) for file in files)} bytes"


def _difference_of(
    path: str, before: FileState, after: typing.Optional[PlannedFile], owner: typing.Tuple[int, int]
) -> typing.Dict[str, str]:
    if after and before.kind == _FILE and before.content == after.content:
        uid, gid = after.owner or owner
        was = f"mode {before.mode:04o}, owner {before.owner[0]}:{before.owner[1]}\n"
        return difference(path, was, f"mode {after.mode:04o}, owner {uid}:{gid}\n")
    entry = difference(path, before.content if before.kind else None, after and after.content)
    if before.kind not in ("", _FILE):
        entry["before"] = f"({before.kind})\n"
    return entry
