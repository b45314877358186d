# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The contract of a back end: one program that filters packets.

A back end is a file in this folder with a class BackEnd(contract.BackEnd), and a row in table.py. Its rules are lines of
text in the words of the program, those of this collection only: rules of others are neither read nor touched. For one run
the module calls, in this order:

    active()          does the program filter the packets of this computer now?
    read()            which rules are ours at run time?
    rules(wanted)     which are wanted, in the same words?
    files(wanted)     which files does it read at boot that are ours whole?
    in_order(wanted)  is everything else right that the next boot needs?
    refusal()         would a change of the rules lose something of others?
    prepare(wanted)   before the files change
    load(wanted)      after the files have changed: run time and boot as wanted
    restore(before)   if something fails: after the files of before are back

With the dead-man's switch try_out(wanted) comes first, which changes the run time alone. `wanted` is None for nothing.
"""

import shutil
import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._firewall.wanted import Wanted
from ansible_collections.rosfleet.multimaster.plugins.module_utils._module.plain_text import LINE, quote
from ansible_collections.rosfleet.multimaster.plugins.module_utils._module.problem import Problem
from ansible_collections.rosfleet.multimaster.plugins.module_utils._process import commands

MARK = "rosfleet.multimaster"
HEADER = "Managed by Ansible: rosfleet.multimaster.firewall writes this whole file, so changes here do not last."

_LIMIT = 60.0  # seconds; each command needs less than one, on a busy machine a few
Rules = typing.List[str]
Command = typing.List[str]
File = typing.Dict[str, str]  # path, content and mode, as _changes/files.py takes them


class BackEnd:
    """One program that filters packets."""

    name = ""  # the value of the option `backend`

    def __init__(self, booted: bool) -> None:
        """`booted`: systemd runs here, so units can be told."""
        self.booted = booted

    # For every back end to write

    def active(self) -> bool:
        """True where this program filters the packets of this computer now."""
        raise NotImplementedError

    def read(self) -> Rules:
        """Our rules at run time, none where the program is not there. Raises Problem."""
        raise NotImplementedError

    def rules(self, wanted: Wanted) -> Rules:
        """The wanted rules as `read` shows them. Raises Problem where this computer cannot have them."""
        raise NotImplementedError

    def load(self, wanted: typing.Optional[Wanted]) -> None:
        """Make run time and boot as wanted; the files are there already. Raises Problem or OSError."""
        raise NotImplementedError

    def try_out(self, wanted: typing.Optional[Wanted]) -> None:
        """Make the run time alone as wanted. Raises Problem or OSError; the caller restores then."""
        raise NotImplementedError

    def restore(self, before: Rules) -> None:
        """Bring the run time back. Raises Problem or OSError."""
        raise NotImplementedError

    # For a back end to override where its program needs it

    def files(self, wanted: Wanted) -> typing.List[File]:
        """The files that are ours whole, and that are read at boot."""
        return []

    def in_order(self, wanted: typing.Optional[Wanted]) -> bool:
        """True where nothing but rules and files could be missing at the next boot."""
        return True

    def refusal(self) -> str:
        """The sentence that says why the rules cannot be changed now, empty where they can. Raises Problem."""
        return ""

    def prepare(self, wanted: typing.Optional[Wanted]) -> None:
        """Do what comes before the files change. Raises Problem."""

    def undo_commands(self, before: Rules) -> typing.List[Command]:
        """The commands with which the dead-man's switch begins the way back."""
        return []

    def undo_files(self) -> typing.List[typing.Tuple[str, typing.Optional[bytes]]]:
        """The files that it restores then, None for a file that was not there."""
        return []

    def undo_last(self) -> typing.List[Command]:
        """The commands after that."""
        return []


def ask(argv: typing.Sequence[str]) -> commands.Answer:
    """Run a command with a limit of time."""
    return commands.run(argv, limit=_LIMIT)


def do(argv: typing.Sequence[str]) -> str:
    """Run a command; returns what it printed. Raises Problem with what it said."""
    answer = ask(argv)
    output = answer.output.decode("utf-8", "replace")
    if answer.status != 0:
        said = quote((answer.error + " " + output).strip(), LINE) or f"status {answer.status}"
        raise Problem(
            f"{quote(' '.join(argv))} failed ({said}), expected it to change the packet filter: see what it says."
        )
    return output


def program(name: str) -> str:
    """The path of a program, empty where there is none."""
    return shutil.which(name, path=commands.BASE_PATH) or ""
