# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""One run of the module managed_files: the files of a bundle, written or removed together."""

import typing

from ..._base import commands
from ..._base.plain_text import LINE, quote
from ..._base.problem import Problem, explain_unreadable, sentence
from ..._machine import systemd
from . import files, transaction, writable
from .module import Concern, Fields, ModuleRun
from .record import RECORDS

FILE = dict(
    path=dict(type="str", required=True),
    content=dict(type="str", required=True),
    mode=dict(type="raw", default="0644"),
    owner=dict(type="str"),
    group=dict(type="str"),
    validate=dict(type="list", elements="str", default=[]),
)
TREE = dict(  # the controller reads it, and hands its files on
    folder=dict(type="str", required=True),
    destination=dict(type="str", required=True),
    left_out=dict(type="str", default=""),
)
RELOAD = dict(
    service=dict(type="str", required=True),
    folder=dict(type="str", required=True),
    due=dict(type="bool", default=False),
    restart=dict(type="bool", default=False),
)
OPTIONS = dict(
    bundle=dict(type="str", required=True),
    files=dict(type="list", elements="dict", default=[], options=FILE),
    trees=dict(type="list", elements="dict", default=[], options=TREE),
    brief=dict(type="list", elements="str", default=[]),
    reload=dict(type="dict", options=RELOAD),
    records=dict(type="str", default=RECORDS),
)

_RELOAD_LIMIT = 60  # seconds
_VALIDATION_LIMIT = 60


class ManagedFiles(ModuleRun):
    """The run, planned from the options of the module."""

    def __init__(self, options: typing.Mapping[str, typing.Any]) -> None:
        self.options = options
        self.bundle = options["bundle"]
        with explain_unreadable():
            self.files = files.FileBundle("files", self.bundle, options["records"], options["files"]).make_plan()
        reload = options.get("reload") or {}
        self.restarts = bool(reload.get("restart"))
        service = reload.get("service")  # empty if this computer has no such service
        self.reloaded = ""  # the service that is to read its files again, empty without one
        if service and self.files.expect(service, lambda path: path.startswith(reload["folder"]), reload["due"]):
            self.reloaded = service
        self.unread = False  # its files are as planned, and it could not be reloaded
        self.changed = self.files.changed or bool(self.reloaded)

    @property
    def refusals(self) -> typing.List[str]:
        """The sentences on files that cannot be written here; else that on the first file that its own command refuses."""
        obstacles = writable.obstacles(self.files.places)
        others = sorted(file.path for file in self.files.writes if file.owner not in (None, self.files.bundle.owner))
        if others and self.files.bundle.owner[0] != 0 and not obstacles:
            obstacles = [
                f"{others[0]} is to have another owner or group, which the user {self.files.bundle.owner[0]} cannot give it; "
                "expected root: run as root (become: true)."
            ]
        if obstacles:
            return [*obstacles, "Nothing was changed."]
        checks = {entry["path"]: entry["validate"] for entry in self.options["files"] if entry["validate"]}
        for file in self.files.writes:
            refusal = self._refusal(file, checks[file.path]) if file.path in checks else ""
            if refusal:
                return [refusal]
        return []

    def _refusal(self, file: files.PlannedFile, command: typing.List[str]) -> str:
        answer = commands.run(command, limit=_VALIDATION_LIMIT, given=file.content)
        if answer.status == 0:
            return ""
        words = f"{answer.output.decode('utf-8', 'replace')} {answer.error}".strip()
        reason = quote(words, LINE) or f"status {answer.status}"
        return (
            f"The content for {file.path} is refused by '{' '.join(command)}' ({reason}); nothing was changed: "
            "correct the content."
        )

    def apply(self) -> None:
        """Write and remove the files, or put everything back and raise StepFailure."""
        transaction.carry_out(self.files.steps_around(self.make_other_steps()), self._explain_failure)
        if self.reloaded:
            self._reload()
            self.files.forget_pending()

    def make_other_steps(self) -> typing.List[transaction.Step]:
        """Return the steps that follow those of the files, before the record says that all is done."""
        return []

    def _explain_failure(self, cause: Exception, left: typing.List[str]) -> str:
        sentences = [f"The files of the bundle {self.bundle} could not be written: {sentence(cause)}"]
        return " ".join(sentences + (left or ["Everything that this run had changed was put back."]))

    def _reload(self) -> None:
        # The files may be drop-ins of the unit, so systemd reads units before a restart.
        calls = [["daemon-reload"], ["restart", self.reloaded]] if self.restarts else [["reload", self.reloaded]]
        for call in calls:
            answer = commands.run(["systemctl", *call], limit=_RELOAD_LIMIT)
            if answer.status == 0 or self._is_gone():
                continue
            reason = quote(answer.error, LINE) or f"status {answer.status}"
            self.unread = True
            raise Problem(
                f"The files of the bundle {self.bundle} are as planned, but {self.reloaded} does not read them again ({reason}); "
                f"expected a service that can be {self._deed}: look at systemctl status {self.reloaded}."
            )

    @property
    def _deed(self) -> str:
        return "started again" if self.restarts else "reloaded"

    def _is_gone(self) -> bool:
        """Return True if the last files go, and so has the service that read them."""
        if not self.restarts or self.files.items:
            return False
        return systemd.states([self.reloaded], ("LoadState",))[0].get("LoadState") == "not-found"

    def failure(self, problem: Problem) -> Fields:
        """The fields of a failed change: `changed` says that something is left of it."""
        if isinstance(problem, transaction.StepFailure):
            return {"changed": bool(problem.left)}
        return {"changed": self.files.changed} if self.unread else {}

    def result(self) -> Fields:
        """The return values besides `changed`, `msg` and `diff`."""
        return {
            "files": [
                dict(path=item.file.path, state=item.state, mode=f"{item.file.mode:04o}") for item in self.files.items
            ],
            "removed": self.files.removals,
            "folders_made": self.files.folders.made,
            "folders_removed": self.files.folders.removed,
            "notes": self.files.notes,
            "reloaded": self.reloaded,
            "digest": files.digest(self.files.bundle.wanted),
        }

    @property
    def difference(self) -> typing.List[typing.Dict[str, str]]:
        """The entries of `diff`."""
        return self.files.differences(self.options["brief"])

    def summary(self, check_mode: bool) -> str:
        """One sentence on all that was done, with the notes."""
        right = len(self.files.items) - len(self.files.writes)
        be, are = ("would be", "are") if check_mode else ("were", "were")
        text = (
            f"{len(self.files.writes)} files of the bundle {self.bundle} {be} written, {len(self.files.removals)} removed "
            f"and {right} {are} right."
        )
        reloaded = [f"{self.reloaded} {'would be' if check_mode else 'was'} {self._deed}."] if self.reloaded else []
        return " ".join([text, *reloaded, *self.files.notes])


CONCERN = Concern("managed_files", OPTIONS, lambda module, memory: ManagedFiles(module.params), many=True)
