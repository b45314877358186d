# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The files that a computer of the lab gets before its first boot, whether it is a container or a virtual machine."""

from __future__ import annotations

import io
import subprocess
import tarfile
import time
from collections.abc import Mapping
from pathlib import Path

from machines.layout import Host
from machines.managers import list_masked_units
from machines.podman import LOCK, WORK, hold

FILES = Path(__file__).parents[1] / "files"
UNITS = ("lab-ssh.socket", "lab-ssh@.service")  # only of containers
OPERATOR = (1000, 37)  # a person's account: its user and group, the group being Debian's own "operator"
# A program that keeps secrets in a file insists that its user alone may read the file.
PRIVATE = ("root/.ssh/", "home/operator/.ssh/", "etc/NetworkManager/system-connections/", "etc/netplan/")

Files = dict[str, tuple[str, int]]  # path -> content, mode


def ssh_key() -> Path:
    """The lab's own ssh key, made at first use."""
    key, draft = WORK / "id_ed25519", WORK / "draft_ed25519"
    halves = [(path.with_suffix(".pub"), path) for path in (draft, key)]  # the key last: who sees it finds both
    with hold(LOCK):
        if not key.exists():
            for path in halves[0]:
                path.unlink(missing_ok=True)  # of a run that was killed; ssh-keygen would ask
            subprocess.run(
                ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-C", "rosfleet-lab", "-f", str(draft)], check=True
            )
            for new, path in zip(*halves, strict=True):
                new.rename(path)
    return key


def list_files(host: Host, more: Mapping[str, str]) -> Files:
    """The files of a computer, and more of them."""
    key = ssh_key().with_suffix(".pub").read_text()
    keys = {"root/.ssh/authorized_keys": key, "home/operator/.ssh/authorized_keys": key}
    paths = [path for path in sorted(FILES.iterdir()) if path.is_file()]
    tools = {f"usr/local/share/lab/{path.name}": path.read_text() for path in paths if path.name not in UNITS}

    def mode(path: str, text: str) -> int:
        return 0o600 if path.startswith(PRIVATE) else 0o755 if text.startswith("#!") else 0o644

    files = {"etc/resolv.conf": "", **host.files(), **keys, **tools, **more}
    return {path: (text, mode(path, text)) for path, text in files.items()}


def list_links(host: Host) -> dict[str, str]:
    """The links of a computer: units of the managers that it does not have lead nowhere."""
    return {f"etc/systemd/system/{unit}": "/dev/null" for unit in list_masked_units(host.manager)}


def pack(files: Files, links: Mapping[str, str]) -> bytes:
    """Files and links as an archive of tar."""
    buffer = io.BytesIO()
    with tarfile.open(fileobj=buffer, mode="w") as archive:

        def add(path: str, kind: bytes, mode: int, content: bytes = b"", target: str = "") -> None:
            member = tarfile.TarInfo(path)
            member.type, member.mode, member.size, member.mtime = kind, mode, len(content), int(time.time())
            member.linkname = target
            if path.startswith("home/operator/"):
                member.uid, member.gid = OPERATOR
            archive.addfile(member, io.BytesIO(content))

        for folder, mode in {"root/.ssh": 0o700, "home/operator/.ssh": 0o700, "usr/local/share/lab": 0o755}.items():
            add(folder, tarfile.DIRTYPE, mode)
        for path, (text, mode) in files.items():
            add(path, tarfile.REGTYPE, mode, text.encode())
        for path, target in links.items():
            add(path, tarfile.SYMTYPE, 0o777, target=target)
    return buffer.getvalue()
