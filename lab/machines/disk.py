# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The disks of virtual machines: the archive of the lab's image, a kernel of Debian's, and the network managers and packet filters.

A disk is built once per recipe and stays in the user's cache, with its kernel and initrd. A machine writes into a layer of its own.
"""

from __future__ import annotations

import hashlib
import json
import os
import shlex
import shutil
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

from machines import image
from machines.podman import LabError

SIZE = "4G"  # of the file system; the file has holes
KEPT = 2  # disks of each suite and kind

_COMMON = """
network-manager netplan.io ufw firewalld wireguard-tools chrony tcpdump python3-apt
""".split()
# The kinds of disks and their packages: the kernel for clouds is the smaller one, and has no drivers of Wi-Fi.
KINDS = {
    "disk": ["linux-image-cloud-amd64", "initramfs-tools", "zstd", *_COMMON],
    "wifi": [
        *("linux-image-amd64", "initramfs-tools", "zstd", *_COMMON),
        *("wpasupplicant", "hostapd", "iw", "wireless-regdb", "rfkill"),
    ],
}

# The kernel runs this before systemd: it unpacks the files of the computer, which its second disk holds, once.
INIT = """#!/bin/sh
if [ ! -e /var/lib/lab-files ]; then
  tar -x -f /dev/vdb -C / && : >/var/lib/lab-files
fi
exec /lib/systemd/systemd "$@"
"""
_INITRD = {"conf.d/lab": "MODULES=list\n", "modules": "virtio_pci\nvirtio_blk\next4\n"}


def _write(path: str, text: str, mode: str = "644") -> str:
    """A hook that writes a file into the new root."""
    place = f'"$1"{path}'
    return f'mkdir -p "$1"{os.path.dirname(path)} && printf %s {shlex.quote(text)} >{place} && chmod {mode} {place}'


SETUP_HOOKS = [_write(f"/etc/initramfs-tools/{name}", text) for name, text in _INITRD.items()]
HOOKS = [
    _write("/usr/sbin/lab-init", INIT, "755"),
    'systemctl --root="$1" --quiet mask e2scrub_reap.service serial-getty@ttyS0.service',
    'systemctl --root="$1" --quiet enable ssh.service',
]


@dataclass(frozen=True)
class Disk:
    """The disk of a release of Debian, of one of KINDS."""

    suite: str
    kind: str = "disk"

    @property
    def base(self) -> image.Image:
        """The image below it."""
        return image.Image(self.suite, full=False)

    def recipe(self) -> list[str]:
        """The command that makes the root folder, without its base and its target."""
        return [
            "mmdebstrap",
            "--variant=custom",
            "--format=directory",
            f"--include={','.join(KINDS[self.kind])}",
            *(f"--setup-hook={hook}" for hook in SETUP_HOOKS),
            *(f"--customize-hook={hook}" for hook in [*HOOKS, *image.HOOKS]),
            self.suite,
        ]

    @property
    def folder(self) -> Path:
        """The folder of its files: root.ext4, vmlinuz, initrd.img."""
        inputs = json.dumps([self.recipe(), self.base.name, SIZE])
        return image.cache() / f"{self.suite}-{self.kind}-{hashlib.sha256(inputs.encode()).hexdigest()[:12]}"


def ensure(suite: str, kind: str = "disk") -> Path:
    """Build the disk if it is missing; return its folder."""
    disk = Disk(suite, kind)
    disk.recipe()
    if os.geteuid() != 0:
        raise LabError("virtual machines need root, for their disks and their network namespace: run as root.")
    for tool in ("mmdebstrap", "mkfs.ext4", "qemu-img", "qemu-system-x86_64"):
        if not shutil.which(tool):
            raise LabError(f"{tool} is not installed: run 'make lab-vm'.")
    if disk.folder.exists():  # a caller does not wait while the disk of another release is built
        return disk.folder
    with image.hold_alone():
        if not disk.folder.exists():
            image.build(disk.base)
            _build(disk)
    return disk.folder


def _build(disk: Disk) -> None:
    print(
        f"disk: building that of {disk.suite} ({disk.kind}) from Debian's packages (two minutes or three) ...",
        flush=True,
    )
    started = time.monotonic()
    unfinished = disk.folder.with_name(f"unfinished-{disk.folder.name}")
    shutil.rmtree(unfinished, ignore_errors=True)
    unfinished.mkdir()
    root = unfinished / "root"
    unpack = (
        f"tar --extract --xattrs --xattrs-include='*' --file {shlex.quote(str(disk.base.archive))} --directory \"$1\""
    )
    *words, suite = disk.recipe()
    try:
        _run([words[0], f"--setup-hook={unpack}", *words[1:], suite, str(root)])
        for name, kernel in (("vmlinuz", "vmlinuz-*"), ("initrd.img", "initrd.img-*")):
            shutil.copy(next((root / "boot").glob(kernel)), unfinished / name)
        _run(["mkfs.ext4", "-q", "-d", str(root), str(unfinished / "root.ext4"), SIZE])
        shutil.rmtree(root)
        unfinished.rename(disk.folder)
    finally:
        shutil.rmtree(unfinished, ignore_errors=True)
    disks = sorted(
        image.cache().glob(f"{disk.suite}-{disk.kind}-*"), key=lambda path: path.stat().st_mtime, reverse=True
    )
    for old in disks[KEPT:]:
        shutil.rmtree(old)
    print(f"disk: built in {time.monotonic() - started:.0f} s", flush=True)


def _run(words: list[str]) -> None:
    done = subprocess.run(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False)
    if done.returncode:
        raise LabError(f"{words[0]} failed:\n{done.stdout.decode(errors='replace')[-3000:]}")
