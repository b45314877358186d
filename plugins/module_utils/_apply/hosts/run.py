# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""One run of the module hosts_entries: the bindings of the fleet in the hosts file."""

import os
import socket
import typing

from ..._base.difference import difference
from ..._base.plain_text import quote
from ..._base.problem import Problem, explain_unreadable, remedy
from ..transaction import transaction, writable
from ..transaction.module import Concern, Fields, ModuleRun
from ..transaction.record import RECORDS, check_absolute
from . import cloud_init
from .bindings import bindings_of
from .file import HostsFile, resolve
from .plan import plan

SYSTEM = "/etc/hosts"  # the file that libc reads
ENTRY = {
    "address": {"type": "str", "required": True},
    "names": {"type": "list", "elements": "str", "required": True},
}
OPTIONS = {
    "entries": {"type": "list", "elements": "dict", "required": True, "options": ENTRY},
    "path": {"type": "path", "default": SYSTEM},
    "own_name": {"type": "str"},
    "backup": {"type": "bool", "default": False},
    "on_conflict": {"type": "str", "choices": ["fail", "report"], "default": "fail"},
    "records": {"type": "path", "default": RECORDS},
}
_EFFECTS = {
    "shadows": "which hides the planned one",
    "adds": "which is answered in addition to the planned one",
}


class HostsRun(ModuleRun):
    """The run, planned from the options of the module."""

    def __init__(
        self,
        options: typing.Mapping[str, typing.Any],
        back_up: typing.Callable[[str], str],
    ) -> None:
        """`back_up` copies a file in its folder and returns the path of the copy (AnsibleModule.backup_local)."""
        check_absolute(options, "path", "records")
        with explain_unreadable(""):
            self.bindings = bindings_of(options["entries"])
            self.file = HostsFile(options["path"], options["records"])
            self.before = self.file.raw_content
            self.is_system = self.file.path == os.path.realpath(SYSTEM)
            self.guard = cloud_init.plan_files(bool(self.bindings), options["records"]) if self.is_system else None
        self.plan = plan(self.file.content, self.bindings)
        self.rewritten = self.plan.content != self.before
        self.changed = self.rewritten or bool(self.guard and self.guard.changed)
        self.back_up = back_up if options["backup"] else None
        self.backup_file = self.written = ""
        self.own_name: str = options["own_name"] or socket.gethostname()
        self.only_report = options["on_conflict"] == "report"
        # For each entry: name -> the addresses that libc answers, as far as it was asked.
        self.answers: typing.List[typing.Dict[str, typing.List[str]]] = [{} for entry in self.plan.entries]

    @property
    def refusals(self) -> typing.List[str]:
        """The sentences on conflicts, unless they are only to be reported, and on files that cannot be written here."""
        if self.plan.conflicts and not self.only_report:
            return self._conflicts() + ["Nothing was changed; with on_conflict: report the module goes on."]
        obstacles = [writable.obstacle(self.file.path, in_place=True)] if self.rewritten else []
        obstacles += writable.obstacles(self.guard.places) if self.guard else []
        return [*filter(None, obstacles), "Nothing was changed."] if any(obstacles) else []

    @property
    def warnings(self) -> typing.List[str]:
        """The conflicts that are only reported."""
        return self._conflicts()

    def _conflicts(self) -> typing.List[str]:
        """One sentence for each line of the user that gives a managed name another address."""
        return [
            f"{self.file.path} line {conflict['line']} gives {conflict['name']} the address {quote(conflict['found'])}, "
            f"{_EFFECTS[conflict['effect']]}; expected {conflict['expected']} (entries): "
            "correct or remove that line, or correct the entry."
            for conflict in self.plan.conflicts
        ]

    def apply(self) -> None:
        """Write the file, and ask libc for its names if it is the one that libc reads. Raises Problem."""
        replacing = transaction.Step(self.file.path, self._replace, lambda: self.file.restore(self.plan.content))
        steps = [replacing, transaction.Step(self.file.path, self.file.clean)]
        transaction.carry_out(self.guard.steps_around(steps) if self.guard else steps, self._explain_failure)
        if self.is_system:
            self.answers = list(resolve(self.bindings))
            self._check()

    def _check(self) -> None:
        """Raise Problem if libc answers a name in another way than the file."""
        wrong = self._find_unresolved()
        if wrong:
            answers = ", ".join(
                f"{item['name']} with {' '.join(map(quote, item['found'])) or 'nothing'}" for item in wrong
            )
            raise Problem(
                f"This computer answers {answers}, although {self.file.path} has the expected "
                f"{', '.join(item['expected'] for item in wrong)}: look at the line hosts of /etc/nsswitch.conf, which must "
                "begin with files, and at caches such as nscd."
            )

    def _replace(self) -> None:
        if self.rewritten:
            if self.back_up and self.before is not None:
                self.backup_file = self.back_up(self.file.path)
            self.written = self.file.replace(self.plan.content)

    def _explain_failure(self, cause: Exception, left: typing.List[str]) -> str:
        """The sentence on a change that was not done."""
        if not isinstance(cause, OSError):
            return transaction.explain_failure(cause, left)
        end = f" Not put back: {', '.join(left)}." if left else ""
        return (
            f"Cannot write {self.file.path} ({cause.strerror or cause}: {cause.filename or self.file.path}), which has its old content; "
            f"expected a writable file: {remedy(cause)}.{end}"
        )

    def failure(self, problem: Problem) -> Fields:
        """The result: as planned if conflicts are the reason, or that of a file which libc does not read."""
        if self.refusals:
            return dict(self.result(), changed=False, repaired=False)
        return dict(self.result(), changed=self.changed) if self._find_unresolved() else {}

    def _entries(self) -> typing.List[Fields]:
        """The entries with the answers of libc."""
        return [dict(entry, resolved=resolved) for entry, resolved in zip(self.plan.entries, self.answers)]

    def _find_unresolved(self) -> typing.List[Fields]:
        """The names that libc answers with another address first, or not at all."""
        return [
            {"name": name, "found": addresses, "expected": entry["address"]}
            for entry in self._entries()
            for name, addresses in entry["resolved"].items()
            if addresses[:1] != [entry["address"]]
        ]

    def result(self) -> Fields:
        """The return values besides `changed` and `msg`."""
        return {
            "entries": self._entries(),
            "unresolved": self._find_unresolved(),
            "removed": self.plan.removed,
            "replaced": self.plan.replaced,
            "conflicts": self.plan.conflicts,
            "written": self.written,
            "repaired": self.file.was_torn,
            "path": self.file.path,
            "backup_file": self.backup_file,
            "cloud_init": self._guard_items(),
            "diff": self._differences(),
        }

    def _guard_items(self) -> typing.List[Fields]:
        """The files that keep cloud-init away, each with its change."""
        if not self.guard:
            return []
        items = [{"path": item.file.path, "state": item.state} for item in self.guard.items]
        return items + [{"path": path, "state": "removed"} for path in self.guard.removals]

    def _differences(self) -> typing.Any:
        """The value of `diff`: one entry, or several if the files of the guard change, too."""
        own = difference(self.file.path, self.before, self.plan.content)
        return [own, *self.guard.differences()] if self.guard and self.guard.changed else own

    def summary(self, check_mode: bool) -> str:
        """A report in sentences, the counts first."""
        sentences = [self._counts()]
        if self.file.was_torn:
            sentences.append(
                "The file was torn by a run that was ended while it wrote in place; the old content is taken up."
            )
        if self.guard and self.guard.changed:
            be, longer = "would be" if check_mode else "is", "" if self.guard.bundle.wanted else "no longer "
            sentences.append(f"cloud-init {be} {longer}kept from writing the file at boot.")
        sentences += [self._replacement_sentence(item) for item in self.plan.replaced if item["state"] != "unchanged"]
        others = [
            f"{quote(entry['names'][0])} (line {entry['line']})" for entry in self.plan.entries if not entry["ours"]
        ]
        if others:
            sentences.append(f"Left to lines that are not ours and already right: {', '.join(others)}.")
        names = [name.lower() for binding in self.bindings for name in binding.names]
        if names and self.own_name.lower() not in names:
            sentences.append(
                f"This computer's own name {quote(self.own_name)} is not among the entries, and resolves as before."
            )
        return " ".join(sentences)

    def _counts(self) -> str:
        states = [entry["state"] for entry in self.plan.entries]
        counts = [f"{states.count(state)} {state}" for state in ("added", "changed", "unchanged") if state in states]
        counts += [f"{len(self.plan.removed)} removed"] if self.plan.removed else []
        return f"{self.file.path}: {', '.join(counts) or 'no binding of ours'}."

    def _replacement_sentence(self, item: Fields) -> str:
        """One sentence on a loopback line."""
        before, after = (" ".join(item[when].split()) for when in ("before", "after"))
        if item["state"] == "restored":
            return f"Line {item['line']} is again: {quote(before)}."
        own = self.own_name.lower() in before.lower().split()
        name = "this computer's own name" if own else "a name of the fleet"
        return f"Line {item['line']} ({quote(before)}) no longer binds {name} to loopback; of it remains: {quote(after) or 'nothing'}."


CONCERN = Concern("hosts_entries", OPTIONS, lambda module, memory: HostsRun(module.params, module.backup_local))
