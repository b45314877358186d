# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""One run of the concern tunnel: its files, tried under the dead-man's switch before they are written.

On trial, the tunnel is up by copies of the new files in a folder of /run, and by a new key that waits next to the one in use. Without a
confirmation its unit starts again by the files and the key of before. The run that confirms writes the files and takes the key into use,
and the unit starts by them. All keys go with the last file.
"""

import os
import re
import shutil
import typing

from ..._apply.transaction import atomic, file_bundle, files
from ..._apply.transaction.module import Concern
from ..._apply.transaction.network import state as network_state
from ..._apply.transaction.record import RECORDS
from ..._apply.transaction.transaction import Step
from ..._base import commands
from ..._base.plain_text import LINE, quote
from ..._base.problem import Problem, explain_unreadable
from ..._machine import ports, systemd
from . import key
from .wireguard import INTERFACE

UNIT = "multimaster-tunnel.service"
FOLDER = "/run/rosfleet-multimaster/tunnel-on-trial"
OPTIONS = {
    "files": {"type": "list", "elements": "dict", "default": [], "options": file_bundle.FILE},
    "records": {"type": "str", "default": RECORDS},
}

_LIMIT = 30  # seconds for wg-quick, which needs some tenths
# By systemd, which lets a wireguard-go live on. It ends with its interface.
_TRIAL = (
    *("systemd-run", "--quiet", "--collect", "--unit=multimaster-tunnel-on-trial", "--service-type=oneshot"),
    *("--property=KillMode=process", "wg-quick", "up"),
)
_END = ["ip", "link", "delete", "dev", INTERFACE]
_PORT = re.compile(r"^ListenPort = (\d+)$", re.M)
_PUBLIC = re.compile(r"^# PublicKey = (\S+)$", re.M)  # in the configuration, of the computer itself


class TunnelRun(file_bundle.ManagedFiles):
    """The run, planned from the options of the module. The state of before is in its unit and files, so it needs no memory."""

    def __init__(self, options: typing.Mapping[str, typing.Any], confirms: bool = False) -> None:
        """`confirms`: an earlier run has the tunnel up by these files already."""
        super().__init__({**options, "bundle": "tunnel", "brief": []})
        self._left = [] if options["files"] else key.list_keys(key.KEY)
        self._waits = bool(options["files"]) and self._is_next_planned()
        # Routes by the interface come and go with it.
        self.watch = network_state.StateWatch(lambda item: item.device == INTERFACE, filtered=True)
        self._lost = not self.changed and bool(options["files"]) and not confirms and self._has_lost()
        self.changed = self.runtime_changes = self.changed or bool(self._left) or self._waits or self._lost

    def _has_lost(self) -> bool:
        """Return True if another program or a person has taken the interface from under the unit."""
        return _runs() and commands.run(["ip", "link", "show", "dev", INTERFACE]).status != 0

    def result(self) -> typing.Dict[str, typing.Any]:
        """The return values besides `changed`, `msg` and `diff`."""
        return {name: value for name, value in super().result().items() if name in ("files", "removed")}

    def undo_steps(self) -> typing.List[typing.List[str]]:
        """Return the step that brings the tunnel of before back: the unit by its own files. Without an earlier tunnel, no step starts one."""
        return [_END, *([["systemctl", "restart", UNIT]] if _runs() else []), ["rm", "-rf", FOLDER]]

    def apply_runtime(self) -> None:
        """Bring the tunnel up by the new files, or end it if the plan has no files. Raises Problem."""
        if not self.options["files"]:
            commands.run(_END)  # there may be no tunnel
            return
        used = key.KEY + key.NEXT if self._waits else key.KEY
        with explain_unreadable("The tunnel is as it was before."):
            atomic.make_folders(FOLDER)
            for entry in self.options["files"]:
                here, name = os.path.split(entry["path"])
                text = entry["content"].replace(f"{here}/", f"{FOLDER}/").replace(key.KEY, used)
                atomic.write_by_rename(os.path.join(FOLDER, name), text.encode(), 0o600)
        way_back = self.undo_steps()
        commands.run(_END)
        answer = commands.run([*_TRIAL, f"{FOLDER}/{INTERFACE}.conf"], limit=_LIMIT)
        if answer.status != 0:
            reason = quote(answer.last_error, LINE) or f"status {answer.status}"
            remedy = "".join(map(_free, self._find_holders())) or "read the message of wg-quick."
            for command in way_back:
                commands.run(command, limit=_LIMIT)
            state = "cannot be brought back" if self._has_lost() else "is as it was before"
            raise Problem(f"The tunnel does not come up ({reason}), and {state}: {remedy}")

    def _find_holders(self) -> typing.List[typing.Dict[str, typing.Any]]:
        """Find who else has the port of the tunnel."""
        planned = [int(found) for entry in self.options["files"] for found in _PORT.findall(entry["content"])]
        return ports.holders({"protocol": "udp", "port": port} for port in planned)[:1]

    def apply(self) -> None:
        """Write the files, by which the unit of the tunnel is then started. Raises Problem."""
        if self._lost and commands.run(["systemctl", "restart", UNIT], limit=_LIMIT).status != 0:
            raise Problem(f"{UNIT} cannot be started again: look at systemctl status {UNIT}.")
        super().apply()
        if self.runtime_changes and not self.options["files"]:  # its unit cannot end it without them
            commands.run(_END)
        shutil.rmtree(FOLDER, ignore_errors=True)

    def make_other_steps(self) -> typing.List[Step]:
        """Return the steps that take the key that waits into use, or remove all keys with the last file."""
        gone = [key.KEY + key.NEXT] if self._waits else self._left
        steps = [files.removal(path, files.look(path)) for path in gone]
        if self._waits:
            used, new = files.look(key.KEY), files.look(key.KEY + key.NEXT).content
            write = Step(
                key.KEY, lambda: atomic.write_by_rename(key.KEY, new, 0o600), lambda: files.restore(key.KEY, used)
            )
            steps.insert(0, write)
        return steps

    def _is_next_planned(self) -> bool:
        """Return True if the key that waits is the one of the new configuration. Raises Problem."""
        planned = {found for entry in self.options["files"] for found in _PUBLIC.findall(entry["content"])}
        return os.path.lexists(key.KEY + key.NEXT) and key.publish(key.KEY + key.NEXT) in planned


def _free(holder: typing.Mapping[str, typing.Any]) -> str:
    """Return the remedy against the holder of the port. A socket without a process is the kernel's, as of another WireGuard."""
    who = (
        f"{quote(holder['command'], LINE)} (pid {holder['pid']})" if holder["pid"] else "another interface of WireGuard"
    )
    return f"UDP port {holder['port']} is held by {who}; stop that one, or give the tunnel another multimaster_tunnel_port."


def _runs() -> bool:
    return systemd.states([UNIT], ("ActiveState",))[0].get("ActiveState") == "active"


CONCERN = Concern(
    "tunnel", OPTIONS, lambda module, memory: TunnelRun(module.params, memory is not None), "peers of the tunnel"
)
