# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Kernel settings of ours: the plan from what the kernel holds to what is wanted, and the steps that apply it.

The record of the values from before is on disk before the first write, and the drop-in is written after the last:
whatever ends a run, the next one finds what it needs to mend it.
"""

import errno
import os
import re
import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._changes import atomic
from ansible_collections.rosfleet.multimaster.plugins.module_utils._changes.difference import difference
from ansible_collections.rosfleet.multimaster.plugins.module_utils._changes.record import Record
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.problem import Problem, sentence
from ansible_collections.rosfleet.multimaster.plugins.module_utils._sysctl.boot import (
    SYSCTL_FOLDERS,
    Tree,
    at_boot,
    hidden_by,
    key_of,
    matches,
    name_of,
    normal,
    parse,
    variable_of,
)

HEADER = "# Managed by Ansible: rosfleet.multimaster.sysctl writes this whole file, so changes here do not last.\n"

Values = typing.Dict[str, typing.Optional[str]]
Step = typing.Tuple[str, typing.Callable[[], typing.Any], typing.Callable[[], typing.Any]]


def _same(value: str) -> str:
    return value


def _opposite(value: str) -> str:
    return "1" if value == "0" else "0"


# What the kernel sets beside a key when the key changes (inet_forward_change() in net/ipv4/devinet.c,
# addrconf_fixup_forwarding() in net/ipv6/addrconf.c).
_IPV4_FORWARDING = (
    ("net/ipv4/ip_forward", _same),
    ("net/ipv4/conf/*/forwarding", _same),
    ("net/ipv4/conf/all/accept_redirects", _opposite),
)
BESIDE = {
    "net/ipv4/ip_forward": _IPV4_FORWARDING,
    "net/ipv4/conf/all/forwarding": _IPV4_FORWARDING,
    "net/ipv6/conf/all/forwarding": (("net/ipv6/conf/*/forwarding", _same),),
}

STATES = {
    errno.ENOENT: "missing",
    errno.ENOTDIR: "missing",
    errno.EISDIR: "missing",
    errno.EROFS: "read_only",
    errno.EACCES: "denied",
    errno.EPERM: "denied",
}
SENTENCES = {
    "missing": "{name}: this kernel has no {path}, expected to set {wanted} there: load the kernel module or bring up the "
    "interface that brings it, or take it off the settings.",
    "read_only": "{name}: {path} is on a read-only mount, as in a container without the right, and holds {found}, "
    "expected {wanted}: set it where the container is started, or give the container a writable /proc/sys.",
    "denied": "{name}: user {user} may not change {path} ({reason}), which holds {found}, expected {wanted}: "
    "run as root (become: true), in a container with the capability for it.",
    "invalid": "{name}: the kernel refuses the value {wanted} ({reason}) and keeps {found}: "
    "give a value that it accepts.",
}


class Setting(typing.NamedTuple):
    """A key and the value that it shall have, in normal form."""

    key: str
    value: str


class Found(typing.NamedTuple):
    """What the kernel holds for a key, and what keeps it from being written (an errno, 0 for nothing)."""

    value: typing.Optional[str]
    refusal: int


class Plan(typing.NamedTuple):
    """What a run does: the writes in their order, the drop-in, and the record before and after them."""

    writes: typing.List[Setting]
    text: typing.Optional[str]
    interim: typing.Dict[str, typing.Any]
    final: typing.Dict[str, typing.Any]
    after: Values
    taken_back: typing.List[typing.Dict[str, typing.Any]]
    also_changed: typing.List[typing.Dict[str, typing.Any]]


# What is wanted


def settings_of(items: typing.Iterable[typing.Mapping[str, str]]) -> typing.List[Setting]:
    """The settings of a list of {name, value}, each key once. Raises Problem with the item that cannot be meant."""
    wanted: typing.Dict[str, typing.Tuple[str, Setting]] = {}
    for item in items:
        name, key, value = item["name"], key_of(item["name"].lstrip("-").strip()), normal(item["value"])
        plain = re.match(r"[^\s=#;*?\[\]/]+(/[^\s=*?\[\]/]+)+$", key) and key.isprintable()
        if not plain or key_of(name_of(key)) != key or ".." in key:
            raise Problem(
                "settings: found the name %r, expected one key such as net.ipv4.ip_forward, without patterns." % name
            )
        if not value.isprintable():
            raise Problem("settings: %s has the value %r, expected printable text on one line." % (name, value))
        earlier_name, earlier = wanted.setdefault(variable_of(key), (name, Setting(key, value)))
        if earlier.value != value:
            raise Problem(
                "settings: %s = %s and %s = %s are one key of the kernel, expected one value for it: remove one of them."
                % (earlier_name, earlier.value, name, value)
            )
    # What changes other keys comes first, so that those have the last word; also in the drop-in.
    return sorted((setting for name, setting in wanted.values()), key=lambda setting: setting.key not in BESIDE)


def drop_in_text(settings: typing.Iterable[Setting]) -> typing.Optional[str]:
    """The drop-in for these settings, None for no drop-in."""
    lines = ["%s = %s\n" % (name_of(setting.key), setting.value) for setting in settings]
    return HEADER + "".join(lines) if lines else None


def check_drop_in(path: str) -> None:
    """Raises Problem where a drop-in would not be read at boot, or not be there any more."""
    lasting = [folder for folder in SYSCTL_FOLDERS if not folder.startswith("/run/")]
    name = os.path.basename(path)
    usable = name.endswith(".conf") and not name.startswith(".") and name.isprintable()
    if os.path.dirname(path) not in lasting or not usable:
        raise Problem("drop_in: found %s, expected a file NAME.conf in one of %s." % (path, ", ".join(lasting)))


# The plan


def beside(key: str, value: str, values: typing.Iterable[str]) -> typing.Dict[str, str]:
    """What else the kernel sets when this key changes to this value, among the keys of `values`."""
    return {
        other: rule(value)
        for pattern, rule in BESIDE.get(key, ())
        for other in values
        if other != key and matches(pattern, other)
    }


def plan(
    settings: typing.List[Setting],
    current: Values,
    record: typing.Dict[str, typing.Any],
    drop_in: str,
    folders: typing.Iterable[str] = (),
) -> Plan:
    """What leads from the kernel's current values and the record to the settings.

    `current` holds the value of every key of settings and record and of every key that these change beside them, None
    where there is no such key; `folders` are those that will be made for the drop-in.
    """
    owned = record.get("settings", {})
    kept = {variable_of(setting.key) for setting in settings}
    start = {key: value for key, value in current.items() if value is not None}
    state = dict(start)
    writes: typing.List[Setting] = []

    def write(key: str, value: str) -> None:
        if state[key] != value:
            writes.append(Setting(key, value))
            state.update(beside(key, value, state))
            state[key] = value

    taken_back = []
    gone = sorted(set(owned) - kept, key=lambda variable: (owned[variable]["key"] not in BESIDE, variable))
    for entry in (owned[variable] for variable in gone):
        key, found = entry["key"], state.get(entry["key"])
        if found is None:
            fate = "missing"
        elif found != entry["before"] and found not in entry["set"]:
            fate = "left"
        else:
            fate = "restored"
            ours, others = beside(key, found, state), dict(state)
            write(key, entry["before"])
            for other, value in beside(key, entry["before"], state).items():
                # Beside keys: as they were before us, or as somebody else has set them since.
                untouched = others[other] == ours[other]
                if variable_of(other) not in kept | {variable_of(key)}:
                    write(other, entry["beside"].get(other, value) if untouched else others[other])
        taken_back.append(
            {
                "name": name_of(key),
                "runtime_before": found,
                "runtime_after": state.get(key),
                "expected": entry["set"][-1],
                "state": fate,
            }
        )

    base = dict(state)
    entries, interim_entries = {}, dict(owned)
    for setting in settings:
        variable = variable_of(setting.key)
        entry = owned.get(variable) or _entry(setting, start, owned)
        entries[variable] = dict(entry, key=setting.key, set=[setting.value])
        earlier = [value for value in entry["set"] if value != setting.value]
        interim_entries[variable] = dict(entry, key=setting.key, set=earlier + [setting.value])
    for setting in settings:
        if setting.key in state:
            write(setting.key, setting.value)

    listed = {setting.key for setting in settings}
    also_changed = [
        {"name": name_of(other), "before": base[other], "after": state[other]}
        for setting in settings
        if setting in writes
        for other in beside(setting.key, setting.value, state)
        # Only those that somebody has set apart from the others: the rest follows by itself.
        if other not in listed
        and base[other] != state[other]
        and base[other] != beside(setting.key, base[setting.key], [other])[other]
    ]

    ours = sorted(set(record.get("drop_ins", [])) | {drop_in})
    made = record.get("folders") or list(folders)
    return Plan(
        writes=writes,
        text=drop_in_text(settings),
        interim={"drop_ins": ours, "folders": made, "settings": interim_entries},
        final={"drop_ins": [drop_in], "folders": made, "settings": entries} if entries else {},
        after={key: state.get(key) for key in current},
        taken_back=taken_back,
        also_changed=also_changed,
    )


def _entry(
    setting: Setting, start: typing.Dict[str, str], owned: typing.Dict[str, typing.Any]
) -> typing.Dict[str, typing.Any]:
    """What to remember of a key that becomes ours: its value from before, and those that it changes beside it."""

    def before(key: str) -> typing.Optional[str]:
        if variable_of(key) in owned:
            return owned[variable_of(key)]["before"]
        for entry in owned.values():
            ours = beside(entry["key"], entry["set"][-1], [key])
            if key in ours and ours[key] == start.get(key):  # our own doing, so not the value from before
                return entry["beside"].get(key, beside(entry["key"], entry["before"], [key])[key])
        return start.get(key)

    value = before(setting.key)
    others = {} if value is None else beside(setting.key, value, start)
    apart = {other: before(other) for other in others if before(other) != others[other]}
    return {"key": setting.key, "before": value, "set": [], "beside": apart}


# The kernel


class Kernel:
    """The kernel's settings, read and written through the folder /proc/sys."""

    def __init__(self, proc: str = "/proc/sys") -> None:
        self.proc = proc

    def path(self, key: str) -> str:
        """The file of a key."""
        return os.path.join(self.proc, key)

    def read(self, key: str) -> str:
        """The current value in normal form. Raises OSError."""
        with open(self.path(key), "rb") as stream:
            return normal(stream.read().decode("utf-8", "surrogateescape"))

    def write(self, key: str, value: str) -> None:
        """Set a value. Raises OSError with the errno of the kernel."""
        descriptor = os.open(self.path(key), os.O_WRONLY | os.O_TRUNC)
        try:
            os.write(descriptor, value.encode("utf-8", "surrogateescape") + b"\n")
        finally:
            os.close(descriptor)

    def look(self, key: str) -> Found:
        """The value and whether it can be written, tried by opening the file, which changes nothing."""
        value = None
        try:
            value = self.read(key)
            os.close(os.open(self.path(key), os.O_WRONLY))
        except OSError as problem:
            return Found(value, problem.errno)
        return Found(value, 0)

    def keys(self, pattern: str) -> typing.List[str]:
        """The keys that a pattern means here; `*` stands for one whole level."""
        folder, star, rest = pattern.partition("/*/")
        if not star:
            return [pattern]
        try:
            return ["%s/%s/%s" % (folder, name, rest) for name in sorted(os.listdir(self.path(folder)))]
        except OSError:
            return []

    def current(self, keys: typing.Iterable[str]) -> typing.Dict[str, Found]:
        """What these keys hold, and the keys that the kernel changes beside them."""
        patterns = [pattern for key in keys for pattern, rule in BESIDE.get(key, ())]
        others = [other for pattern in patterns for other in self.keys(pattern)]
        found = {key: self.look(key) for key in keys}
        found.update((key, self.look(key)) for key in others if key not in found)
        return found

    def restore(self, values: Values) -> None:
        """Bring values back; those that change others first. Raises OSError."""
        for key in sorted(values, key=lambda key: (key not in BESIDE, key)):
            value = values[key]
            if value is not None and self.read(key) != value:
                self.write(key, value)


def refusal(path: str, setting: Setting, found: typing.Optional[str], number: int) -> typing.Tuple[str, str]:
    """The state and the sentence for a setting that the kernel refuses with this errno."""
    state = STATES.get(number, "invalid")
    return state, SENTENCES[state].format(
        name=name_of(setting.key),
        path=path,
        wanted=setting.value,
        found="nothing that can be read" if found is None else found,
        reason=os.strerror(number),
        user=os.geteuid(),
    )


# The module's run


class Run:
    """One run of the module: looks at the machine and plans, then applies the plan or says what stands against it."""

    def __init__(
        self, options: typing.Mapping[str, typing.Any], memory: typing.Optional[typing.Dict[str, typing.Any]] = None
    ) -> None:
        """Changes nothing. `memory` is that of the run whose change at run time this one confirms, and stands for the record.

        Raises Problem for options, files or a record that cannot be used.
        """
        for option in ("root", "proc", "records"):
            if not os.path.isabs(options[option]):
                raise Problem("%s is %r, expected an absolute path." % (option, options[option]))
        self.settings = settings_of(options["settings"])
        self.drop_in = options["drop_in"]
        check_drop_in(self.drop_in)
        self.kernel = Kernel(options["proc"])
        self.record = Record("sysctl", options["records"])
        self.on_disk = self.record.load()
        self.recorded = self.on_disk if memory is None else memory
        self.tree = Tree(options["root"])
        self.file = self._place(self.drop_in)
        self.before = self._own_text()
        self.stale = self._stale()

        listed = [setting.key for setting in self.settings]
        owned = [entry["key"] for entry in self.recorded.get("settings", {}).values()]
        self.found = self.kernel.current(listed + owned)
        self.current = {key: found.value for key, found in self.found.items()}
        self.plan = plan(self.settings, self.current, self.recorded, self.drop_in, self._missing_folders())
        self.items = self._items()

    def _place(self, path: str) -> str:
        """Where a drop-in lies on this machine: links of folders are followed, the file itself is not."""
        return os.path.join(self.tree.real(os.path.dirname(path)), os.path.basename(path))

    def _own_text(self) -> typing.Optional[str]:
        """The text of our drop-in, None where there is none. Raises Problem where the file is somebody else's."""
        if not os.path.lexists(self.file):
            return None
        regular = os.path.isfile(self.file) and not os.path.islink(self.file)
        text = self.tree.read(self.drop_in) if regular else ""
        if regular and (text.startswith(HEADER) or self.drop_in in self.on_disk.get("drop_ins", [])):
            return text
        raise Problem(
            "drop_in: %s is there and not ours (neither our first line nor our record), expected no file or one that "
            "this module wrote: move it away, or name another file in drop_in." % self.drop_in
        )

    def _stale(self) -> typing.Dict[str, str]:
        """Our drop-ins under earlier names, with their text; what is no longer ours stays."""
        others = [path for path in self.on_disk.get("drop_ins", []) if path != self.drop_in]
        texts = {path: self.tree.read(path) for path in others if not os.path.islink(self._place(path))}
        return {path: text for path, text in texts.items() if text.startswith(HEADER)}

    def _missing_folders(self) -> typing.List[str]:
        missing, folder = [], os.path.dirname(self.file)
        while not os.path.isdir(folder):
            missing.append(folder)
            folder = os.path.dirname(folder)
        return missing[::-1]

    def _items(self) -> typing.List[typing.Dict[str, typing.Any]]:
        """What the module returns per setting."""
        planned: typing.Dict[str, typing.Optional[str]] = dict.fromkeys(self.stale, None)
        planned[self.drop_in] = self.plan.text
        after = Tree(self.tree.root, planned)
        boot = at_boot(after, [setting.key for setting in self.settings])
        hidden = hidden_by(after, self.drop_in)
        lines = {line.key: line.value for line in parse(self.before or "", self.drop_in)}

        items = []
        for setting in self.settings:
            found, decides = self.found[setting.key], boot[setting.key]
            writes = setting in self.plan.writes
            state, problem = "ok", None
            if found.value is None or (writes and found.refusal):
                state, problem = refusal(self.kernel.path(setting.key), setting, found.value, found.refusal)
            elif writes or lines.get(setting.key) != setting.value:
                state = "changed"
            boot_value = None if decides is None or decides.value is None else normal(decides.value)
            conflict = None
            if boot_value != setting.value:
                conflict = {
                    "file": decides.file if decides else hidden,
                    "line": decides.line if decides else 0,
                    "value": boot_value,
                    "masks": hidden is not None,
                }
            items.append(
                {
                    "name": name_of(setting.key),
                    "value": setting.value,
                    "runtime_before": found.value,
                    "runtime_after": self.plan.after[setting.key],
                    "boot_value": boot_value,
                    "boot_file": decides.file if decides else None,
                    "changed": state == "changed",
                    "state": state,
                    "problem": problem,
                    "conflict": conflict,
                }
            )
        return items

    @property
    def changed(self) -> bool:
        """Whether there is anything to do: in the kernel, in the drop-in or in the record."""
        return bool(self.plan.writes or self.stale or self.before != self.plan.text or self.on_disk != self.plan.final)

    @property
    def runtime_changes(self) -> bool:
        """Whether values of the kernel change."""
        return bool(self.plan.writes)

    @property
    def memory(self) -> typing.Dict[str, typing.Any]:
        """What the run that confirms has to know: the values from before this one, which keeps no record of them."""
        return self.plan.interim

    @property
    def problems(self) -> typing.List[str]:
        """One sentence per setting that the kernel refuses, known before anything changes."""
        found = [item["problem"] for item in self.items if item["problem"]]
        listed = {setting.key for setting in self.settings}
        for write in self.plan.writes:
            if write.key not in listed and self.found[write.key].refusal:
                path, held = self.kernel.path(write.key), self.found[write.key]
                found.append("Taking back " + refusal(path, write, held.value, held.refusal)[1])
        return found

    @property
    def conflicts(self) -> typing.List[str]:
        """One sentence per setting that will have another value after the next boot."""
        return [_conflict_sentence(item, self.drop_in) for item in self.items if item["conflict"]]

    @property
    def difference(self) -> typing.List[typing.Dict[str, str]]:
        """The files and the kernel's values, before and after."""

        def encoded(text: typing.Optional[str]) -> typing.Optional[bytes]:
            return None if text is None else text.encode("utf-8", "surrogateescape")

        changes = [(self.drop_in, self.before, self.plan.text)]
        changes += [(path, text, None) for path, text in self.stale.items()]
        found = [difference(path, encoded(old), encoded(new)) for path, old, new in changes if old != new]
        keys = sorted({write.key for write in self.plan.writes})
        if keys:
            header = "%s (values at run time)" % self.kernel.proc
            before, after = (
                encoded("".join("%s = %s\n" % (name_of(key), values[key]) for key in keys))
                for values in (self.current, self.plan.after)
            )
            found.append(difference(header, before, after))
        return found

    def undo_commands(self) -> typing.List[typing.List[str]]:
        """The commands that bring the present values back; those that change others first."""
        program = '[ ! -e "$1" ] || printf "%s\\n" "$2" >"$1"'
        return [
            ["sh", "-c", program, "sh", self.kernel.path(key), self.current[key]]
            for key in sorted(self.current, key=lambda key: (key not in BESIDE, key))
            if not self.found[key].refusal
        ]

    def undo_files(self) -> typing.Sequence[typing.Tuple[str, typing.Optional[bytes]]]:
        """The files to be put back with the values: none, since apply_runtime() touches no file."""
        return ()

    def apply(self) -> None:
        """Do it: record, kernel, files, record. Raises Problem; then everything is as it was, or the sentence says what
        is not."""
        steps: typing.List[Step] = [("leftovers of a killed run", self._tidy, lambda: None)]
        if self.changed:
            steps += [
                (self.record.path, lambda: self.record.save(self.plan.interim), lambda: self.record.save(self.on_disk)),
                self._values(),
                (self.drop_in, self._write_files, self._restore_files),
            ]
        self._do(steps)

    def apply_runtime(self) -> None:
        """The kernel alone: no record, no file. Raises Problem as apply()."""
        self._do([self._values()])

    def _values(self) -> Step:
        return "the values in " + self.kernel.proc, self._write_values, lambda: self.kernel.restore(self.current)

    def _do(self, steps: typing.List[Step]) -> None:
        """Do steps, each given as (what it changes, do, undo), or none of them."""
        begun = []
        try:
            for what, step, undo in steps:
                begun.append((what, undo))
                step()
        except (OSError, ValueError, Problem) as problem:
            kept = []
            for what, undo in reversed(begun):
                try:
                    undo()
                except (OSError, ValueError) as failure:
                    kept.append("%s (%s)" % (what, getattr(failure, "strerror", None) or failure))
            end = "Not put back: %s." % ", ".join(kept) if kept else "Everything is as it was before."
            raise Problem("%s %s" % (sentence(problem), end)) from problem

    def _tidy(self) -> None:
        """Remove what a killed run left of its writing."""
        for path in (self.record.path, self.file):
            atomic.remove_leftovers(path)
        if not self.on_disk:
            self.record.save({})

    def _write_values(self) -> None:
        for write in self.plan.writes:
            try:
                self.kernel.write(write.key, write.value)
            except OSError as problem:
                path, held = self.kernel.path(write.key), self.current[write.key]
                raise Problem(refusal(path, write, held, problem.errno)[1]) from problem
        for setting, item in zip(self.settings, self.items):
            held = item["runtime_after"] = self.kernel.read(setting.key)
            if held != setting.value:
                raise Problem(
                    "%s: the kernel was given %s and holds %s, expected the same: write the value as the kernel says it."
                    % (name_of(setting.key), setting.value, held)
                )

    def _write_files(self) -> None:
        text = self.plan.text
        if text is not None and text != self.before:
            atomic.make_folders(os.path.dirname(self.file))
            atomic.write_by_rename(self.file, text.encode("utf-8", "surrogateescape"))
        for path in self.stale:
            atomic.remove(self._place(path))
        if text is None:
            atomic.remove(self.file)
            for folder in reversed(self.plan.interim["folders"]):
                atomic.remove_folder_if_empty(folder)
        self.record.save(self.plan.final)

    def _restore_files(self) -> None:
        before: typing.Dict[str, typing.Optional[str]] = dict(self.stale)
        before[self.drop_in] = self.before
        for path, text in before.items():
            place = self._place(path)
            if text is None:
                atomic.remove(place)
            elif atomic.read_bytes(place) != text.encode("utf-8", "surrogateescape"):
                atomic.make_folders(os.path.dirname(place))
                atomic.write_by_rename(place, text.encode("utf-8", "surrogateescape"))
        if self.before is None:
            for folder in reversed(self.plan.interim["folders"]):
                atomic.remove_folder_if_empty(folder)


def _conflict_sentence(item: typing.Mapping[str, typing.Any], drop_in: str) -> str:
    conflict = item["conflict"]
    where = conflict["file"] + (" line %d" % conflict["line"] if conflict["line"] else "")
    if conflict["value"] is None and conflict["masks"]:
        found = "%s keeps %s from being read at boot" % (where, drop_in)
    elif conflict["value"] is None:
        found = "%s excludes it from being set at boot" % where
    elif conflict["masks"]:
        found = "%s sets %s at boot, and %s is not read" % (where, conflict["value"], drop_in)
    else:
        found = "%s sets %s at boot, after %s" % (where, conflict["value"], drop_in)
    return "%s: %s, expected %s: correct or remove it there, or set on_conflict to report to go on." % (
        item["name"],
        found,
        item["value"],
    )
