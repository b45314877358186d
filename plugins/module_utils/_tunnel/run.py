# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""One run of the concern tunnel: its files, tried under the dead-man's switch before they are written.

On trial, the tunnel is up by copies of the new files in a folder of /run. Without a confirmation its unit starts again by the files of
before. The run that confirms writes the files, and the unit starts by them.
"""

import os
import shutil
import typing

from .._changes import atomic, file_bundle
from .._changes.record import RECORDS
from .._machine import systemd
from .._module.plain_text import LINE, quote
from .._module.problem import Problem, unreadable
from .._process import commands
from .probe import INTERFACE

TABLE = "rosfleet_tunnel"
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
_OPEN = ["nft", "delete", "table", "inet", TABLE]


class Tunnel(file_bundle.ManagedFiles):
    """The run, planned from the options of the module. The state of before is in its unit and files, so it needs no memory."""

    memory: typing.Mapping[str, typing.Any] = {}

    def __init__(self, options: typing.Mapping[str, typing.Any], folder: str = FOLDER) -> None:
        super().__init__({**options, "bundle": "tunnel", "brief": []})
        self.folder = folder

    @property
    def runtime_changes(self) -> bool:
        """Say if the tunnel is to be another one."""
        return self.changed

    def result(self) -> typing.Dict[str, typing.Any]:
        """The return values beside `changed`, `msg` and `diff`."""
        return {name: value for name, value in super().result().items() if name in ("files", "removed")}

    def undo_commands(self) -> typing.List[typing.List[str]]:
        """Return what brings the tunnel of before back: the unit by its own files, or none."""
        runs = systemd.states([UNIT], ("ActiveState",))[0].get("ActiveState") == "active"
        return [_END, ["systemctl", "restart", UNIT] if runs else _OPEN, ["rm", "-rf", self.folder]]

    def apply_runtime(self) -> None:
        """Bring the tunnel up by the new files, or end it where there are none. Raises Problem."""
        commands.run(_END)  # there may be none
        if not self.options["files"]:
            commands.run(_OPEN)
            return
        try:
            atomic.make_folders(self.folder)
            for entry in self.options["files"]:
                here, name = os.path.split(entry["path"])
                text = entry["content"].replace(f"{here}/", f"{self.folder}/")
                atomic.write_by_rename(os.path.join(self.folder, name), text.encode(), 0o600)
        except OSError as problem:
            raise Problem(f"{unreadable(problem)} The tunnel is as it was before.") from problem
        answer = commands.run([*_TRIAL, f"{self.folder}/{INTERFACE}.conf"], limit=_LIMIT)
        if answer.status != 0:
            reason = quote(answer.last_error, LINE) or f"status {answer.status}"
            raise Problem(
                f"The tunnel does not come up ({reason}), and is as it was before: look at what wg-quick says."
            )

    def apply(self) -> None:
        """Write the files, by which the unit of the tunnel is then started. Raises Problem."""
        super().apply()
        shutil.rmtree(self.folder, ignore_errors=True)
