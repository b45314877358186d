# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The private key of this computer, made here. Only its public half leaves it.

A new key waits next to the one that is in use, until the tunnel with it was confirmed (run.py). So a way back has the key of before.
"""

import os
import shutil
import stat
import typing

from ..._apply.transaction import atomic, files, writable
from ..._apply.transaction.module import Concern, Fields, ModuleRun
from ..._apply.transaction.record import RECORDS
from ..._apply.transaction.transaction import Step, carry_out
from ..._base import commands
from ..._base.plain_text import LINE, quote
from ..._base.problem import Problem

KEY = "/etc/wireguard/multimaster0.key"
NEXT = ".next"  # ends the path of a key that waits
OPTIONS = {
    "rotate": {"type": "bool", "default": False},
    "path": {"type": "path", "default": KEY},
    "records": {"type": "path", "default": RECORDS},
}


class TunnelKey(ModuleRun):
    """One run of the module tunnel_key, planned from its options."""

    def __init__(self, options: typing.Mapping[str, typing.Any], check_mode: bool = False) -> None:
        self.path = options["path"]
        there = list(filter(_is_there, (self.path, self.path + NEXT)))
        self.changed = options["rotate"] or not there
        known = [] if self.changed or (check_mode and shutil.which("wg") is None) else there
        self.public, self.waiting = ([publish(path) for path in known] + ["", ""])[:2]

    @property
    def refusals(self) -> typing.List[str]:
        """The sentence on a place in which no key can be written."""
        return writable.obstacles([self.path + NEXT]) if self.changed else []

    def apply(self) -> None:
        """Make the key. Raises Problem."""
        if not self.changed:
            return
        key = _run_wg("genkey", b"").encode() + b"\n"
        public = _run_wg("pubkey", key)
        before = files.look(self.path + NEXT)

        def write() -> None:
            os.makedirs(os.path.dirname(self.path), 0o700, exist_ok=True)
            atomic.write_by_rename(self.path + NEXT, key, 0o600)

        carry_out([Step(self.path + NEXT, write, lambda: files.restore(self.path + NEXT, before))])
        self.public = public

    def result(self) -> Fields:
        """The return values besides `changed` and `msg`. In check mode a new key is not known yet."""
        return {"public_key": self.public, "waiting_key": self.waiting}

    def summary(self, check_mode: bool) -> str:
        """One sentence on the change."""
        return f"The key {'would be' if check_mode else 'was'} made." if self.changed else "The key was there."


def list_keys(path: str) -> typing.List[str]:
    """List all files with private keys of the tunnel: the one in use, one that waits, and those of a killed writer."""
    found = [path, path + NEXT, *atomic.leftovers(path), *atomic.leftovers(path + NEXT)]
    return [name for name in found if os.path.lexists(name) and not (os.path.isdir(name) and not os.path.islink(name))]


def publish(path: str) -> str:
    """Return the public half of the key in a file. Raises Problem and OSError."""
    return _run_wg("pubkey", atomic.read_bytes(path) or b"")


def _is_there(path: str) -> bool:
    """Return True if a key is there. Raises OSError, and Problem if others than root may read or replace it."""
    try:
        state = os.lstat(path)
    except FileNotFoundError:
        return False
    if not stat.S_ISREG(state.st_mode) or state.st_uid != os.geteuid() or state.st_mode & 0o077:
        raise Problem(
            f"{quote(path, LINE)} is no file that only its owner may read (mode {stat.S_IMODE(state.st_mode):04o}, owner "
            f"{state.st_uid}); expected the key of the tunnel with the mode 0600 and the owner {os.geteuid()}: another user may "
            "know it, so remove it, and run site.yml with -e tunnel_rotate=true. Nothing was changed."
        )
    return True


def _run_wg(word: str, given: bytes) -> str:
    """Run a command of wg(8) that only reads and writes keys; its messages have no key in them. Raises Problem."""
    answer = commands.run(["wg", word], given=given)
    if answer.status != 0:
        reason = quote(answer.error, LINE) or f"status {answer.status}"
        raise Problem(
            f"wg {word} failed ({reason}); expected the Debian package wireguard-tools and a key: install it, or run site.yml "
            "with -e tunnel_rotate=true for another key."
        )
    return answer.text.strip()


CONCERN = Concern("tunnel_key", OPTIONS, lambda module, memory: TunnelKey(module.params, module.check_mode))
