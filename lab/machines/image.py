# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The images of a robot's computer: Debian with systemd, ssh and ROS 1, as Debian packages it.

There are two of each release. A demonstration needs only "robot". "full" is a layer on top of it: more network managers,
packet filters, and the tools by which tests inject faults.

Built once per recipe; the archive stays in the user's cache, so that another checkout or an emptied podman needs seconds.
Each checkout has names of its own for the images that it uses. So podman itself knows when the last checkout has left one.
"""

from __future__ import annotations

import hashlib
import json
import os
import shlex
import shutil
import subprocess
import time
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

from machines.podman import CHECKOUT, ROOT, LabError, hold, podman

NAME = "localhost/rosfleet-lab"
SUITE = "bookworm"
KEPT = 3  # archives of each kind and suite

ROBOT = """
systemd systemd-sysv udev dbus dbus-user-session libpam-systemd kmod procps sudo less
iproute2 iputils-ping nftables openssh-server ifupdown smcroute python3
python3-roslaunch python3-rosmaster python3-rospy python3-rosgraph rosout rosbash topic-tools
python3-rostopic python3-rosnode python3-rosservice python3-rosmsg python3-rosparam
python3-std-msgs python3-std-srvs python3-geometry-msgs python3-diagnostic-msgs
python3-actionlib python3-actionlib-msgs
ros-std-msgs ros-std-srvs ros-geometry-msgs ros-diagnostic-msgs ros-actionlib-msgs
""".split()

FULL = """
network-manager netplan.io ufw firewalld frr cloud-init wireguard-tools
python3-tf2 python3-tf2-msgs
net-tools tcpdump conntrack libfaketime acl attr python3-apt chrony wireguard-go
""".split()

# Documentation is a third of the files and no robot needs it.
EXCLUDED = ("/usr/share/doc/*", "/usr/share/man/*", "/usr/share/locale/*", "/usr/share/info/*")
# For the packages after the first few, and for those of the layer above. (As an option of mmdebstrap, path-exclude makes it
# start a filter for each of the first few, which takes longer than to remove the files.) A half-written image is not used.
DPKG = ["force-unsafe-io", *(f"path-exclude={path}" for path in EXCLUDED)]

# The debootstrap hooks run with the new root as $1.
ESSENTIAL_HOOK = f"""printf '%s\\n' {" ".join(f"'{line}'" for line in DPKG)} > "$1"/etc/dpkg/dpkg.cfg.d/lab"""
ROBOT_HOOKS = [
    # A person's account; Debian already has a group of this name.
    'chroot "$1" useradd --create-home --uid 1000 --gid operator --shell /bin/bash operator',
    # There is no archive to ask.
    'systemctl --root="$1" --quiet mask apt-daily.timer apt-daily-upgrade.timer',
    # Every network manager is ready; each computer masks those that it does not have (managers.py).
    'systemctl --root="$1" --quiet enable systemd-networkd.service systemd-networkd-wait-online.service',
]
FULL_HOOKS = [
    ': > "$1"/etc/cloud/cloud-init.disabled',
    # The support of a kernel for tunnels, on a computer that is no container.
    'echo "c! /dev/net/tun 0600 root root - 10:200" > "$1"/etc/tmpfiles.d/lab-tunnel.conf',
]
HOOKS = [
    "rm -rf " + " ".join(f'"$1"{path}' for path in EXCLUDED),
    # Empty, not missing: each container gets an id of its own, and no boot is a "first boot" that would preset units.
    ': > "$1"/etc/machine-id',
    # Installed for who wants them. (ufw is not active until it is enabled; its unit starts nothing before that.)
    "for unit in firewalld frr smcroute smcroute-helper; do "
    'if [ -e "$1/usr/lib/systemd/system/$unit.service" ]; then systemctl --root="$1" --quiet disable $unit.service; fi; '
    "done",
]


@dataclass(frozen=True)
class Release:
    """The differences of a release of Debian."""

    without: tuple[str, ...] = ()  # packages that its archive does not have
    options: tuple[str, ...] = ()  # of mmdebstrap


# mmdebstrap of a newer release makes a separate /usr here, for which systemd and ROS are not made.
_MERGED_USR = (
    'mkdir -p "$1"/usr/bin "$1"/usr/sbin "$1"/usr/lib "$1"/usr/lib64 && ln -s usr/bin usr/sbin usr/lib usr/lib64 "$1"/'
)
RELEASES = {
    "bullseye": Release(without=("frr",), options=(f"--setup-hook={_MERGED_USR}",)),  # frr's files are gone
    "bookworm": Release(),
    "trixie": Release(without=("firewalld",)),  # cloud-init conflicts with it there
}


@dataclass(frozen=True)
class Image:
    """An image: a release of Debian, with the packages of a robot or all."""

    suite: str
    full: bool

    @property
    def kind(self) -> str:
        return f"{self.suite}-{'full' if self.full else 'robot'}"

    @property
    def base(self) -> Image | None:
        """The image below this one."""
        return Image(self.suite, full=False) if self.full else None

    def recipe(self) -> list[str]:
        """The command that builds the archive, without its base and its target."""
        if self.suite not in RELEASES:
            raise LabError(f"There is no image of {self.suite}; expected one of {', '.join(RELEASES)}.")
        release = RELEASES[self.suite]
        packages, hooks = (FULL, FULL_HOOKS) if self.full else (ROBOT, ROBOT_HOOKS)
        return [
            "mmdebstrap",
            f"--variant={'custom' if self.full else 'minbase'}",
            f"--include={','.join(package for package in packages if package not in release.without)}",
            *(() if self.full else (f"--essential-hook={ESSENTIAL_HOOK}", *release.options)),
            *(f"--customize-hook={hook}" for hook in [*hooks, *HOOKS]),
            self.suite,
        ]

    @property
    def name(self) -> str:
        """The name by its inputs, for all checkouts."""
        inputs = [self.recipe(), self.base.name if self.base else ""]
        return f"{self.kind}-{hashlib.sha256(json.dumps(inputs).encode()).hexdigest()[:12]}"

    @property
    def tag(self) -> str:
        """The name of this checkout."""
        return f"{NAME}:{self.name}-{CHECKOUT}"

    @property
    def archive(self) -> Path:
        return cache() / f"{self.name}.tar.zst"


def cache() -> Path:
    """The folder of the archives."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "rosfleet-multimaster"


def build(wanted: Image) -> None:
    """Make the archive of an image, on top of its base."""
    if wanted.archive.exists():
        return
    for tool in ("mmdebstrap", "zstd"):
        if not shutil.which(tool):
            raise LabError(f"{tool} is not installed: run 'make lab'.")
    command = wanted.recipe()
    if wanted.base:
        build(wanted.base)
        unpack = f"tar --extract --xattrs --xattrs-include='*' --file {shlex.quote(str(wanted.base.archive))} --directory \"$1\""
        command = [*command[:-1], f"--setup-hook={unpack}", command[-1]]
    print(f"image: building {wanted.kind} from Debian's packages (a minute or two) ...", flush=True)
    started = time.monotonic()
    unfinished = wanted.archive.with_name(f"unfinished-{wanted.archive.name}")
    done = subprocess.run([*command, str(unfinished)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False)
    if done.returncode:
        unfinished.unlink(missing_ok=True)
        raise LabError(f"mmdebstrap failed:\n{done.stdout.decode(errors='replace')[-3000:]}")
    unfinished.rename(wanted.archive)
    _forget_old(wanted.kind)
    print(f"image: built in {time.monotonic() - started:.0f} s", flush=True)


def _forget_old(kind: str) -> None:
    archives = sorted(cache().glob(f"{kind}-*.tar.zst"), key=lambda path: path.stat().st_mtime, reverse=True)
    for archive in archives[KEPT:]:
        archive.unlink()


def hold_alone() -> AbstractContextManager[None]:
    """One checkout at a time builds, names and removes images."""
    return hold(cache() / "lock")


def _tags() -> list[str]:
    """The names of the images, of all checkouts."""
    return podman("images", "--format", "{{.Repository}}:{{.Tag}}", NAME).split()


def _name(tag: str) -> str:
    """The name of an image for all checkouts, of that of one."""
    return tag.rpartition(":")[2].rpartition("-")[0]


def _link(checkout: str) -> Path:
    """The link that leads to a checkout."""
    return cache() / "checkouts" / checkout


def _make(wanted: Image) -> None:
    """Build and import an image if it is missing, after its base."""
    tags = _tags()
    if wanted.tag in tags:
        return
    if wanted.base:
        _make(wanted.base)
    same = [tag for tag in tags if _name(tag) == wanted.name]
    if same:
        podman("tag", same[0], wanted.tag)
        return
    build(wanted)
    print(f"image: importing {wanted.archive.name} ...", flush=True)
    settings = ['CMD ["/lib/systemd/systemd"]', "STOPSIGNAL SIGRTMIN+3"]
    podman("import", *(word for change in settings for word in ("--change", change)), str(wanted.archive), wanted.tag)


def ensure(suite: str = SUITE, *, full: bool = True) -> str:
    """Build and import the image if it is missing; return its name."""
    wanted = Image(suite, full)
    with hold_alone():
        link = _link(CHECKOUT)
        link.parent.mkdir(exist_ok=True)
        link.unlink(missing_ok=True)
        link.symlink_to(ROOT)
        _make(wanted)
    return wanted.tag


def remove() -> None:
    """Take this checkout's names off the images, and those of deleted checkouts; an image without a name goes, with its archive."""
    with hold_alone():
        gone = {link.name for link in _link("").glob("*") if not link.exists()} | {CHECKOUT}
        ours = [tag for tag in _tags() if tag.rpartition("-")[2] in gone]
        for tag in ours:
            podman("rmi", tag, check=False)  # refused for the last name of an image that a container uses
        staying = _tags()
        kept = {_name(tag) for tag in staying}
        for tag in ours:
            if _name(tag) not in kept:
                (cache() / f"{_name(tag)}.tar.zst").unlink(missing_ok=True)
        for checkout in gone - {tag.rpartition("-")[2] for tag in staying}:
            _link(checkout).unlink(missing_ok=True)
    for name in sorted({_name(tag) for tag in ours}):
        print(f"image: {f'{name} stays in use' if name in kept else f'removed {name}'}", flush=True)
