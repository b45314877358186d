# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""One run of the module sysctl, over the kernel's values, the drop-in and the record.

The record of the values from before is on disk before the first write, and the drop-in is written after the last. So
after a killed run, the next one knows everything that it needs to repair.
"""

import errno
import os
import re
import typing

from ..._base.difference import difference, difference_of_lines, mode_difference
from ..._base.plain_text import quote
from ..._base.problem import Problem, sentence
from ..transaction import atomic, transaction, writable
from ..transaction.module import Concern, ModuleRun
from ..transaction.network import state as network_state
from ..transaction.record import RECORDS, Record, check_absolute
from . import boot, kernel, plan, record
from .record import Data

_REMOVALS = {
    "restored": "{name} is {runtime_after} again.",
    "left": "{name} is left at {runtime_after}: it was changed by hand or another program since this module set {expected}.",
    "missing": "{name} is gone from this kernel, so there is nothing to take back.",
}

_MODE = 0o644  # of the drop-in
RULES = "/etc/udev/rules.d/90-rosfleet-multimaster.rules"  # for the keys of modules that are loaded late
# $1: a file of the kernel, $2: its value. One that has the value already is not set apart by writing it.
_RESTORE = 'set -f; [ ! -e "$1" ] || [ "$(echo $(cat "$1"))" = "$2" ] || printf "%s\\n" "$2" >"$1"'

SETTING = {
    "name": {"type": "str", "required": True},
    "value": {"type": "raw", "required": True},
    "ignore_missing": {"type": "bool", "default": False},
    "enough": {"type": "list", "elements": "raw", "default": []},
}
OPTIONS = {
    "settings": {"type": "list", "elements": "dict", "required": True, "options": SETTING},
    "drop_in": {"type": "path", "default": "/etc/sysctl.d/90-rosfleet-multimaster.conf"},
    "on_conflict": {"type": "str", "default": "fail", "choices": ["fail", "report"]},
    "root": {"type": "path", "default": "/"},
    "proc": {"type": "path", "default": "/proc/sys"},
    "records": {"type": "path", "default": RECORDS},
}

Options = typing.Mapping[str, typing.Any]


class SysctlRun(ModuleRun):
    """One run of the module: reads the machine and plans, then applies the plan or reports the obstacle."""

    def __init__(self, options: Options, memory: typing.Optional[Data] = None) -> None:
        """Read and plan; changes nothing. `memory`: that of the run whose change at run time this one confirms.

        Raises Problem for options, files or a record that cannot be used.
        """
        check_absolute(options, "root", "proc", "records")
        self.optional = plan.optional_of(options["settings"])
        self.drop_in = options["drop_in"]
        plan.check_drop_in(self.drop_in)
        self.fails_on_conflict = options["on_conflict"] == "fail"
        self.kernel = kernel.Kernel(options["proc"])
        self.record = Record("sysctl", options["records"], record.SHAPE)
        self.stored = self.record.load()
        self.recorded = self.record.parse(record.read, self.stored if memory is None else memory)
        self.tree = boot.Tree(options["root"])
        self.settings = self._prefer_boot_values(options["settings"])
        self.file = self._place(self.drop_in)
        # Our drop-in, and those under earlier names.
        self.texts_before = {self.drop_in: self._read_own_text(self.drop_in), **self._read_stale_texts()}
        self.lost: typing.List[str] = []  # the keys with which IPv6 was off for a moment
        self.unknown: typing.List[str] = []  # the sentences of check mode on facts that only the change itself shows

        keys = [setting.key for setting in self.settings]
        owned = [entry.key for entry in self.recorded.settings.values()]
        self.states = self.kernel.read_with_others(keys + owned)
        self.current = {key: state.value for key, state in self.states.items()}
        folders = self.recorded.folders or atomic.find_missing_folders(os.path.dirname(self.file))
        self.plan = plan.plan(self.settings, self.current, self.recorded._replace(folders=folders), self.drop_in)
        text = plan.drop_in_text(self.settings, self.optional)
        self.texts_after = {**dict.fromkeys(self.texts_before), self.drop_in: text}
        self._add_rules()
        self.items = self._items()
        self.wrong_mode = self._wrong_mode()
        self.runtime_changes = bool(self.plan.writes)
        on_kernel = self.kernel.proc == kernel.PROC and self.runtime_changes
        self.watch = network_state.StateWatch(self._is_planned_to_go) if on_kernel else None
        self.memory = self.plan.interim.plain()  # the record while the change is on its way
        # Anything to do: in the kernel, in the drop-ins, or in the record.
        files = self.texts_before != self.texts_after or self.wrong_mode is not None
        self.changed = self.runtime_changes or files or self.stored != self.plan.final.plain()

    def _prefer_boot_values(self, items: typing.Iterable[Options]) -> typing.List[kernel.WantedValue]:
        """The listed settings. If the value of another file is enough, it is taken, so the file stays."""
        settings, enough = plan.settings_of(items), plan.enough_of(items)
        if not enough:
            return settings
        ours = [self.drop_in, *self.stored.get("drop_ins", [])]
        decides = boot.find_boot_assignments(boot.Tree(self.tree.root, dict.fromkeys(ours)), enough)
        texts = {key: one.value for key, one in decides.items() if one and one.value is not None}
        taken = [boot.read_value(texts.get(setting.key, ""), setting.value) for setting in settings]
        return [
            setting._replace(value=value) if value in enough.get(setting.key, ()) else setting
            for setting, value in zip(settings, taken)
        ]

    # The drop-in

    def _place(self, path: str) -> str:
        """The path of a drop-in below the root folder. Links of folders are followed, the file itself is not."""
        return os.path.join(self.tree.real(os.path.dirname(path)), os.path.basename(path))

    def _add_rules(self) -> None:
        """Add the rules of udev that the settings need, where there is an udev, or those of ours that they need no longer."""
        has_udev = boot.boots_with_systemd(self.tree) and self.tree.exists(os.path.dirname(RULES))
        wanted = plan.rules_text(self.settings) if has_udev else None
        if wanted or self.tree.read(RULES).startswith(plan.HEADER):
            self.texts_before[RULES], self.texts_after[RULES] = self._read_own_text(RULES), wanted

    def _read_own_text(self, path: str) -> typing.Optional[str]:
        """The text of a file of ours, the drop-in or the rules; None if the file is missing. Raises Problem for a file of others."""
        place = self._place(path)
        if not os.path.lexists(place):
            return None
        regular = os.path.isfile(place) and not os.path.islink(place)
        text = self.tree.read(path) if regular else ""
        if regular and (text.startswith(plan.HEADER) or path in self.stored.get("drop_ins", [])):
            return text
        why = "neither our first line nor our record" if regular else "no regular file, as this module writes one"
        what, other = ("drop_in: ", ", or name another file in drop_in") if path == self.drop_in else ("", "")
        raise Problem(
            f"{what}{path} is there and not ours ({why}), expected no file or one that this module wrote: "
            f"move it away{other}."
        )

    def _wrong_mode(self) -> typing.Optional[int]:
        """The mode of our drop-in if it stays and is not 0644; else None."""
        if None in (self.texts_before[self.drop_in], self.texts_after[self.drop_in]):
            return None
        mode, _owner = atomic.permissions(self.file)
        return None if mode == _MODE else mode

    def _read_stale_texts(self) -> typing.Dict[str, str]:
        """Our drop-ins under earlier names, with their texts. A file that is no longer ours stays."""
        others = [path for path in self.stored.get("drop_ins", []) if path != self.drop_in]
        texts = {path: self.tree.read(path) for path in others if not os.path.islink(self._place(path))}
        return {path: text for path, text in texts.items() if text.startswith(plan.HEADER)}

    # The result per setting

    def _items(self) -> typing.List[Data]:
        after = boot.Tree(self.tree.root, self.texts_after)
        deciding = boot.find_boot_assignments(after, [setting.key for setting in self.settings])
        hidden = boot.find_hiding_file(after, self.drop_in)
        lines = {line.key: line.value for line in boot.parse(self.texts_before[self.drop_in] or "", self.drop_in)}
        items = []
        for setting in self.settings:
            decides, present, writes = deciding[setting.key], self.states[setting.key], setting in self.plan.writes
            state, problem = self._refusal(setting, writes)
            changes = problem is None and (writes or lines.get(setting.key) != setting.value)
            boot_value = (
                None if decides is None or decides.value is None else boot.read_value(decides.value, setting.value)
            )
            item: Data = {
                "name": boot.name_of(setting.key),
                "value": setting.value,
                "runtime_before": present.value,
                "runtime_after": self.plan.after[setting.key],
                "boot_value": boot_value,
                "boot_file": decides.file if decides else None,
                "changed": changes,
                "state": state or ("changed" if changes else "ok"),
                "problem": problem,
                "conflict": None,
            }
            if boot_value != setting.value:
                # The file that gives it another value at boot, or keeps our drop-in from being read.
                item["conflict"] = {
                    "file": decides.file if decides else hidden,
                    "line": decides.line if decides else 0,
                    "value": boot_value,
                    "masks": hidden is not None,
                }
            items.append(item)
        return items

    def _refusal(self, setting: kernel.WantedValue, writes: bool) -> typing.Tuple[str, typing.Optional[str]]:
        """The state and the sentence for a setting that cannot be set, as far as that is known before; "" and None else."""
        present = self.states[setting.key]
        if present.value is None or (writes and present.refusal):
            state, problem = self.kernel.refusal(setting, *present)
            return state, None if state == "missing" and setting.key in self.optional else problem
        if writes and kernel.is_unfit(setting):
            return "invalid", (
                f"{boot.name_of(setting.key)}: found the value {setting.value}, expected a whole number as the kernel says it, such as "
                f"{quote(present.value)}: correct the value."
            )
        if self.plan.after[setting.key] != setting.value:
            return "invalid", self._contradiction(setting)
        return "", None

    def _contradiction(self, setting: kernel.WantedValue) -> str:
        other = next(
            other for other in self.settings if setting.key in kernel.followers(other.key, other.value, [setting.key])
        )
        return (
            f"settings: {boot.name_of(setting.key)} = {setting.value} and {boot.name_of(other.key)} = {other.value} cannot both be, since "
            f"the kernel sets the first to {self.plan.after[setting.key]} with the second; expected one of them: remove the other."
        )

    # For the shell of the modules

    @property
    def conflicts(self) -> typing.List[str]:
        """One sentence per setting that will have another value after the next boot."""
        return [_conflict_sentence(item, self.drop_in) for item in self.items if item["conflict"]]

    @property
    def refusals(self) -> typing.List[str]:
        """The sentences that prevent the plan: refused settings, and conflicts unless they are to be reported only."""
        problems = [item["problem"] for item in self.items if item["problem"]]
        keys = {setting.key for setting in self.settings}
        for write in self.plan.writes:
            if write.key not in keys and self.states[write.key].refusal:
                problems.append("Taking back " + self.kernel.refusal(write, *self.states[write.key])[1])
        files = [*map(self._place, self.texts_before), self.record.path] if self.changed and not problems else []
        return problems + (self.conflicts if self.fails_on_conflict else []) + writable.obstacles(files)

    def foresee(self) -> typing.List[str]:
        """Try the values in a network namespace, so nothing changes here."""
        writes = {write.key: write.value for write in self.plan.writes if write in self.settings}
        if self.kernel.proc != kernel.PROC or not writes:
            return []
        from . import trial

        outcomes = trial.try_values(self.kernel, writes)
        refusals = [
            self.kernel.refusal(kernel.WantedValue(key, writes[key]), self.current[key] if number else value, number)[1]
            for key, (value, number) in outcomes.items()
            if (value, number) != (writes[key], 0)
        ]
        open_ = [key for key in writes if key not in outcomes and not _alike(writes[key], self.current[key])]
        names = ", ".join(f"{boot.name_of(key)} = {writes[key]}" for key in open_)
        self.unknown = [f"Check mode cannot know whether the kernel takes {names}."] if names else []
        return refusals

    @property
    def warnings(self) -> typing.List[str]:
        """The sentences about conflicts, and about settings that were changed after our run."""
        left = [_sentence(item) for item in self.plan.removals if item["state"] == "left"]
        return self.conflicts + left + self.unknown

    @property
    def difference(self) -> typing.List[typing.Dict[str, str]]:
        """The files and the kernel's values that change, for `diff`."""
        after = self.texts_after
        entries = [difference(path, old, after[path]) for path, old in self.texts_before.items() if old != after[path]]
        if self.wrong_mode is not None and self.texts_before[self.drop_in] == self.texts_after[self.drop_in]:
            entries.append(mode_difference(self.drop_in, self.wrong_mode, _MODE))
        keys = sorted({write.key for write in self.plan.writes})
        lines = ([f"{boot.name_of(key)} = {values[key]}" for key in keys] for values in (self.current, self.plan.after))
        return entries + difference_of_lines(f"{self.kernel.proc} (values at run time)", *lines)

    def result(self) -> Data:
        """The return values of the module."""
        return {
            "settings": self.items,
            "conflicts": self.conflicts,
            "taken_back": self.plan.removals,
            "also_changed": self.plan.side_effects,
            "drop_in": self.drop_in,
        }

    def failure(self, problem: Problem) -> Data:
        """The return values besides the sentence: those of a success, with the values that the kernel has."""
        for setting, item in zip(self.settings, self.items):
            item["runtime_after"] = self.kernel.look(setting.key).value
        return self.result()

    def summary(self, check_mode: bool) -> str:
        """The sentences of `msg`."""
        changed = sum(item["changed"] for item in self.items)
        sentences = [f"{changed} of {len(self.items)} kernel settings changed."] if self.items else []
        sentences += [_sentence(item) for item in self.plan.removals]
        sentences += [
            f"The kernel changed {item['name']} from {quote(item['before'])} to {quote(item['after'])} with it."
            for item in self.plan.side_effects
        ]
        return " ".join(sentences) or "No kernel settings are ours."

    # For the dead-man's switch

    def undo_steps(self) -> typing.List[typing.List[str]]:
        """The commands that restore the present values."""
        values = [
            (key, self.current[key])
            for key in kernel.changes_others_first(self.current)
            if not self.states[key].refusal
        ]
        # A value that the kernel refuses while another key has its present value is taken the second time.
        return [
            ["sh", "-c", program, "sh", self.kernel.path(key), value]
            for program in (f"{_RESTORE} 2>/dev/null || :", _RESTORE)
            for key, value in values
            if value is not None
        ]

    def apply_runtime(self) -> None:
        """Write only the kernel's values. Raises Problem as `apply`."""
        transaction.carry_out([*self.watch_steps(), self._kernel_step()], self._explain_failure)

    # The change

    def apply(self) -> None:
        """Make everything as planned. Raises Problem; then all is as it was, or the sentence lists the exceptions."""
        steps = [transaction.Step("leftovers of a killed run", lambda: atomic.remove_leftovers(self.file))]
        if self.changed:
            steps += [
                *self.watch_steps(),
                transaction.intent(self.record, self.memory, self.stored),
                self._kernel_step(),
                transaction.Step(
                    self.drop_in,
                    lambda: self._write_texts(self.texts_after),
                    lambda: self._write_texts(self.texts_before),
                ),
            ]
        steps.append(transaction.outcome(self.record, self.plan.final.plain()))
        transaction.carry_out(steps, self._explain_failure)

    def _is_planned_to_go(self, item: network_state.NetworkItem) -> bool:
        """True for keys that the kernel removes if IPv6 is turned off."""
        off = any(write.key.endswith("/disable_ipv6") and write.value != "0" for write in self.plan.writes)
        return off and item.version == 6

    def _kernel_step(self) -> transaction.Step:
        what = f"the values in {self.kernel.proc}"
        return transaction.Step(what, do=self._write_values, undo=self._restore_values, failure="{reason}")

    def _write_values(self) -> None:
        for write in self.plan.writes:
            try:
                self.kernel.write(write.key, write.value)
            except OSError as problem:
                if write in self.settings:
                    raise self._refusal_of(write, problem.errno or errno.EIO) from problem
                # Taken back: the kernel may take the value when another key has its value from before.
        wrong = self.kernel.settle(self.plan.goals)
        for key, number in wrong.items():
            setting = kernel.WantedValue(key, self.plan.goals[key])
            if setting not in self.settings:
                _state, text = self.kernel.refusal(setting, self.current[key], number or errno.EINVAL)
                raise Problem("Taking back " + text)
            raise self._refusal_of(setting, 0)

    def _refusal_of(self, setting: kernel.WantedValue, number: int) -> Problem:
        """Note in the item that the kernel refuses a listed value, or (0) holds another; returns the problem that ends the run."""
        # Read again: an interface may have gone with its keys.
        state, text = self.kernel.refusal(setting, self.kernel.look(setting.key).value, number)
        self.items[self.settings.index(setting)].update(state=state, problem=text, changed=False)
        return Problem(text)

    def _restore_values(self) -> typing.List[str]:
        """Bring every value back that the run may have changed; returns the keys that do not come back."""
        enabled = [key for key, value in self.current.items() if key.endswith("/disable_ipv6") and value == "0"]
        self.lost = [boot.name_of(key) for key in enabled if self.kernel.look(key).value == "1"]
        return self.kernel.restore(self.current)

    def _explain_failure(self, cause: Exception, left: typing.List[str]) -> str:
        if not self.lost or left:
            return transaction.explain_failure(cause, left)
        if self.watch is None:
            end = "not the addresses and routes of IPv6 that the kernel removed with"
            return f"{sentence(cause)} The values are as they were before, but {end} {', '.join(self.lost)}."
        end = "and so are the addresses and routes of IPv6 that the kernel removed with"
        return f"{sentence(cause)} The values are as they were before, {end} {', '.join(self.lost)}."

    def _write_texts(self, texts: typing.Mapping[str, typing.Optional[str]]) -> None:
        """Give drop-ins these texts, None for no file; without our drop-in, its folders go if we made them."""
        for path, text in texts.items():
            place, content = self._place(path), (text or "").encode("utf-8", "surrogateescape")
            if text is None:
                atomic.remove_for_good(place)
            elif atomic.read_bytes(place) != content or (path == self.drop_in and self.wrong_mode is not None):
                atomic.make_folders(os.path.dirname(place))
                atomic.write_by_rename(place, content)
        for path in sorted({RULES, *self.stored.get("drop_ins", [])}.difference(texts)):
            atomic.sync_removal(self._place(path))  # a run that was killed may have removed it right before
        if texts[self.drop_in] is None:
            for folder in reversed(self.plan.interim.folders):
                atomic.remove_folder_if_empty(folder)


def _alike(value: str, current: typing.Optional[str]) -> bool:
    """True if both texts hold only whole numbers, equally many."""
    forms = [[bool(re.fullmatch(r"-?[0-9]+", word)) for word in (text or "").split()] for text in (value, current)]
    return forms[0] == forms[1] and all(forms[0])


def _sentence(item: Data) -> str:
    values = {when: quote(item[when]) for when in ("runtime_after", "expected")}
    return _REMOVALS[item["state"]].format(name=item["name"], **values)


def _conflict_sentence(item: Data, drop_in: str) -> str:
    conflict = item["conflict"]
    where = quote(conflict["file"]) + (f" line {conflict['line']}" if conflict["line"] else "")
    if conflict["value"] is None and conflict["masks"]:
        problem = f"{where} keeps {drop_in} from being read at boot"
    elif conflict["value"] is None:
        problem = f"{where} excludes it from being set at boot"
    elif conflict["masks"]:
        problem = f"{where} sets {quote(conflict['value'])} at boot, and {drop_in} is not read"
    else:
        problem = f"{where} sets {quote(conflict['value'])} at boot, after {drop_in}"
    return f"{item['name']}: {problem}, expected {item['value']}: correct or remove it there, or set on_conflict to report to go on."


CONCERN = Concern("sysctl", OPTIONS, lambda module, memory: SysctlRun(module.params, memory), "kernel settings")
