# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The contract of a back end: one program that filters packets.

A back end is a file in this folder with a class BackEnd(contract.BackEnd), and a row in table.py. Its rules are lines of
text in the words of the program. They are those of this collection only: foreign rules are neither read nor touched.
For one run the module asks the class for is_active(): does the program filter the packets of this computer now? Then it
makes a back end with the filter that it shall have, None if no rules are wanted. That asks itself for its rules:

    plan_rules(filter)    only with a filter: which rules of ours shall it have? They are in `after`.
    read_rules()          which ones does it have? They are in `before`.

The module calls, in this order:

    plan_files(filter)    only with a filter: which files of ours does the program read at boot?
    is_ready_for_boot()   is everything else right that the next boot needs?
    refusal()             why a change of the rules would lose something foreign, "" if it would not
    prepare()             before the files change
    load()                after the files have changed: make run time and boot as planned
    read_rules()          are they?
    restore()             if something fails, after the former files are back

With the dead-man's switch, a run before that calls, after refusal():

    undo_steps()          how does the machine bring the run time back by itself?
    try_out()             change only the run time
    restore()             if that fails
"""

import contextlib
import shutil
import typing

from ...._base import commands
from ...._base.plain_text import LINE, quote
from ...._base.problem import Problem
from ...transaction import atomic
from ...transaction.deadman import FileBefore, UndoStep
from ..packet_filter import PacketFilter

MARK = "rosfleet.multimaster"
HEADER = "Managed by Ansible: rosfleet.multimaster.firewall writes this whole file, so changes here do not last."

_LIMIT = 60.0  # seconds; each command needs less than one, on a busy machine a few
Rules = typing.List[str]
Command = typing.List[str]
File = typing.Dict[str, str]  # path, content and mode, as _apply/transaction/files.py takes them


class BackEnd:
    """One program that filters packets, and our rules in it before and after the run."""

    name = ""  # the value of the option `backend`

    def __init__(self, booted: bool, packet_filter: typing.Optional[PacketFilter]) -> None:
        """`booted`: systemd runs here, so units can be started and stopped. Raises Problem."""
        self.booted, self.packet_filter = booted, packet_filter
        self.after = self.plan_rules(packet_filter) if packet_filter else []
        self.before = self.read_rules()

    @property
    def changes(self) -> bool:
        """True if the rules change at run time."""
        return self.before != self.after

    # For every back end to write

    @staticmethod
    def is_active() -> bool:
        """True if this program filters the packets of this computer now."""
        raise NotImplementedError

    def read_rules(self) -> Rules:
        """Our rules at run time, an empty list if the program is not installed. Raises Problem."""
        raise NotImplementedError

    def plan_rules(self, packet_filter: PacketFilter) -> Rules:
        """The wanted rules in the words of `read_rules`. Raises Problem if this computer cannot have them."""
        raise NotImplementedError

    def load(self) -> None:
        """Make run time and boot as planned; the files are there already. Raises Problem or OSError."""
        raise NotImplementedError

    def try_out(self) -> None:
        """Make only the run time as planned. Raises Problem or OSError; then the caller restores."""
        raise NotImplementedError

    def restore(self) -> None:
        """Bring the run time back. Raises Problem or OSError."""
        raise NotImplementedError

    def undo_steps(self) -> typing.Sequence[UndoStep]:
        """The steps with which the dead-man's switch brings it back. Raises OSError."""
        raise NotImplementedError

    # For a back end to override if its program needs it

    def plan_files(self, packet_filter: PacketFilter) -> typing.List[File]:
        """The files of ours that the program reads at boot."""
        return []

    def is_ready_for_boot(self) -> bool:
        """True if the next boot finds all that it needs besides rules and files, for example a unit that is enabled."""
        return True

    def refusal(self) -> str:
        """The sentence why the rules cannot be changed now, empty if they can. Raises Problem."""
        return ""

    def prepare(self) -> None:
        """Do the work before the files change. Raises Problem."""


def read_files(paths: typing.Iterable[str]) -> typing.List[FileBefore]:
    """The files as they are now. Raises OSError."""
    return [FileBefore(path, atomic.read_bytes(path)) for path in paths]


@contextlib.contextmanager
def keep_files(files: typing.Iterable[FileBefore]) -> typing.Iterator[None]:
    """Give files this content again at the end, whatever was written meanwhile. Raises OSError."""
    try:
        yield
    finally:
        write_files(files)


def write_files(files: typing.Iterable[FileBefore]) -> None:
    """Give files this content, with the permissions that they have. Raises OSError."""
    for path, content in files:
        if content is None:
            atomic.remove_for_good(path)
        elif atomic.read_bytes(path) != content:
            atomic.write_by_rename(path, content, *atomic.permissions(path))


def run_command(argv: typing.Sequence[str]) -> commands.Answer:
    """Run a command with a limit of time."""
    return commands.run(argv, limit=_LIMIT)


def run_or_fail(argv: typing.Sequence[str]) -> str:
    """Run a command; returns its output. Raises Problem with its message."""
    answer = run_command(argv)
    output = answer.text
    if answer.status != 0:
        message = quote((answer.error + " " + output).strip(), LINE) or f"status {answer.status}"
        raise Problem(
            f"{quote(' '.join(argv))} failed ({message}), expected it to change the packet filter: read its message."
        )
    return output


def find_program(name: str) -> str:
    """The path of a program, "" if it is not installed."""
    return shutil.which(name, path=commands.BASE_PATH) or ""
