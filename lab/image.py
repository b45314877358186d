# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The image of a robot's computer: Debian with systemd, the usual network managers, ssh and ROS 1, as Debian packages it.

Built once per recipe; the archive stays in the user's cache, so that another checkout or an emptied podman needs seconds.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import shutil
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

from podman import LabError, labelled, podman

NAME = "localhost/rosfleet-lab"
SUITE = "bookworm"
TESTED = (SUITE, "trixie")  # what 'make test' needs
KEPT = 3  # archives per suite

SYSTEM = """
systemd systemd-sysv udev dbus dbus-user-session libpam-systemd kmod procps sudo less
iproute2 iputils-ping net-tools nftables tcpdump openssh-server libfaketime
ifupdown network-manager netplan.io smcroute frr
ufw firewalld wireguard-tools cloud-init acl attr
python3 python3-apt
""".split()

ROS = """
python3-roslaunch python3-rosmaster python3-rospy python3-rosgraph rosout rosbash topic-tools
python3-rostopic python3-rosnode python3-rosservice python3-rosmsg python3-rosparam
python3-std-msgs python3-std-srvs python3-geometry-msgs python3-diagnostic-msgs
python3-actionlib python3-actionlib-msgs
ros-std-msgs ros-std-srvs ros-geometry-msgs ros-diagnostic-msgs ros-actionlib-msgs
""".split()

# Documentation is a third of the files and no robot needs it.
EXCLUDED = ["/usr/share/doc/*", "/usr/share/man/*", "/usr/share/locale/*", "/usr/share/info/*"]

# The debootstrap hooks run with the new root as $1.
HOOKS = [
    # A person's account; Debian already has a group of this name.
    'chroot "$1" useradd --create-home --uid 1000 --gid operator --shell /bin/bash operator',
    # Empty, not missing: each container gets an id of its own, and no boot is a "first boot" that would preset units.
    ': > "$1"/etc/machine-id',
    # There is no archive to ask.
    'systemctl --root="$1" --quiet mask apt-daily.timer apt-daily-upgrade.timer',
    # Every network manager is ready; each computer masks those that it does not have (managers.py).
    'systemctl --root="$1" --quiet enable systemd-networkd.service systemd-networkd-wait-online.service',
    # Installed for who wants them. (ufw is not active until it is told; its unit starts nothing before that.)
    "for unit in firewalld frr smcroute smcroute-helper; do "
    'if [ -e "$1/usr/lib/systemd/system/$unit.service" ]; then systemctl --root="$1" --quiet disable $unit.service; fi; '
    "done",
    ': > "$1"/etc/cloud/cloud-init.disabled',
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


def recipe(suite: str) -> list[str]:
    """The command that builds the archive, without its target; it determines the image."""
    if suite not in RELEASES:
        raise LabError(f"There is no image of {suite}; expected one of {', '.join(RELEASES)}.")
    release = RELEASES[suite]
    return [
        "mmdebstrap",
        "--variant=minbase",
        f"--include={','.join(package for package in SYSTEM + ROS if package not in release.without)}",
        *(f"--dpkgopt=path-exclude={path}" for path in EXCLUDED),
        *release.options,
        *(f"--customize-hook={hook}" for hook in HOOKS),
        suite,
    ]


def key(suite: str) -> str:
    """The inputs by which the cache knows an image."""
    return hashlib.sha256(json.dumps(recipe(suite)).encode()).hexdigest()[:12]


def cache() -> Path:
    """The folder of the archives."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "rosfleet-multimaster"


def _build(suite: str, archive: Path) -> None:
    for tool in ("mmdebstrap", "zstd"):
        if not shutil.which(tool):
            raise LabError(f"{tool} is not installed: run 'make setup'.")
    print(f"image: building {suite} from Debian's packages (a minute or two) ...", flush=True)
    started = time.monotonic()
    unfinished = archive.with_name(f"unfinished-{archive.name}")
    done = subprocess.run(
        [*recipe(suite), str(unfinished)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False
    )
    if done.returncode:
        unfinished.unlink(missing_ok=True)
        raise LabError(f"mmdebstrap failed:\n{done.stdout.decode(errors='replace')[-3000:]}")
    unfinished.rename(archive)
    print(f"image: built in {time.monotonic() - started:.0f} s", flush=True)


def _forget_old(suite: str) -> None:
    archives = sorted(cache().glob(f"{suite}-*.tar.zst"), key=lambda path: path.stat().st_mtime, reverse=True)
    for archive in archives[KEPT:]:
        archive.unlink()


def ensure(suite: str = SUITE) -> str:
    """Build and import the image where it is missing; return its name."""
    tag, latest = f"{NAME}:{suite}-{key(suite)}", f"{NAME}:{suite}"
    cache().mkdir(parents=True, exist_ok=True)
    with (cache() / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not podman("images", "--quiet", tag):
            archive = cache() / f"{suite}-{key(suite)}.tar.zst"
            if not archive.exists():
                _build(suite, archive)
            print(f"image: importing {archive.name} ...", flush=True)
            settings = ['CMD ["/lib/systemd/systemd"]', "STOPSIGNAL SIGRTMIN+3"]
            podman("import", *(word for change in settings for word in ("--change", change)), str(archive), tag)
            _forget_old(suite)
        podman("tag", tag, latest)
    return tag


def remove() -> None:
    """Remove the images and their archives, unless there is a lab; the next one builds them anew."""
    if labelled("container", "rosfleet.lab"):
        print("image: it stays, since labs of another checkout need it", flush=True)
        return
    names = podman("images", "--format", "{{.Repository}}:{{.Tag}}", NAME).split()
    if names:
        podman("rmi", "--force", *names)
    shutil.rmtree(cache(), ignore_errors=True)
    print(f"image: removed {len(names)} images and {cache()}", flush=True)
