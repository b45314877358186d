# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""One run of the module tunnel_key: the private key of this computer, made here. Only its public half leaves it."""

import os
import stat
import typing

from .._changes import atomic
from .._changes.module import Fields, ModuleRun
from .._changes.record import RECORDS
from .._module.plain_text import LINE, quote
from .._module.problem import Problem, unreadable
from .._process import commands

KEY = "/etc/wireguard/multimaster0.key"
OPTIONS = {
    "wanted": {"type": "bool", "default": True},
    "rotate": {"type": "bool", "default": False},
    "path": {"type": "path", "default": KEY},
    "records": {"type": "path", "default": RECORDS},
}


class TunnelKey(ModuleRun):
    """The run, planned from the options of the module."""

    def __init__(self, options: typing.Mapping[str, typing.Any]) -> None:
        self.path = options["path"]
        self.is_wanted = options["wanted"]
        self.is_there = self._look()
        self.makes = self.is_wanted and (options["rotate"] or not self.is_there)
        self.changed = self.makes or (self.is_there and not self.is_wanted)
        self.public = self._publish() if self.is_wanted and self.is_there else ""

    def _look(self) -> bool:
        """Say if the key is there. Raises Problem where others than root may read or replace it."""
        try:
            state = os.lstat(self.path)
        except FileNotFoundError:
            return False
        except OSError as problem:
            raise Problem(f"{unreadable(problem)} Nothing was changed.") from problem
        if not stat.S_ISREG(state.st_mode) or state.st_uid != os.geteuid() or state.st_mode & 0o077:
            raise Problem(
                f"{quote(self.path, LINE)} is no file that its owner alone may read (mode {stat.S_IMODE(state.st_mode):04o}, owner "
                f"{state.st_uid}); expected the key of the tunnel with the mode 0600 and the owner {os.geteuid()}: somebody else may "
                "know it, so remove it, and run site.yml with -e tunnel_rotate=true. Nothing was changed."
            )
        return True

    def _publish(self) -> str:
        """Return the public half. Raises Problem."""
        try:
            key = atomic.read_bytes(self.path) or b""
        except OSError as problem:
            raise Problem(f"{unreadable(problem)} Nothing was changed.") from problem
        return _run_wg("pubkey", key)

    def apply(self) -> None:
        """Make the key, or remove it. Raises Problem."""
        if not self.changed:
            return
        try:
            if not self.is_wanted:
                os.remove(self.path)
                return
            key = _run_wg("genkey", b"").encode() + b"\n"
            os.makedirs(os.path.dirname(self.path), 0o700, exist_ok=True)
            atomic.write_by_rename(self.path, key, 0o600)
            self.public = _run_wg("pubkey", key)
        except OSError as problem:
            raise Problem(f"{unreadable(problem)} The key is as it was before.") from problem

    def result(self) -> Fields:
        """The return values beside `changed` and `msg`. In check mode a new key is not known yet."""
        return {"public_key": self.public}

    def summary(self, check_mode: bool) -> str:
        """One sentence on what was done."""
        if not self.changed:
            return "The key was there." if self.is_wanted else "There was no key."
        return f"The key {'would be' if check_mode else 'was'} {'made' if self.makes else 'removed'}."


def _run_wg(word: str, given: bytes) -> str:
    """Run a command of wg(8) that reads and writes keys alone; what it says of an error has no key in it. Raises Problem."""
    answer = commands.run(["wg", word], given=given)
    if answer.status != 0:
        reason = quote(answer.error, LINE) or f"status {answer.status}"
        raise Problem(f"wg {word} failed ({reason}); expected the Debian package wireguard-tools: install it.")
    return answer.text.strip()
