# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Every call of podman goes through here.

A machine may lack cgroups v2 (which crun needs) or the right to raise limits (which podman tries by default):
the lab finds out and writes a configuration for podman, unless CONTAINERS_CONF already names one.
"""

from __future__ import annotations

import contextlib
import fcntl
import hashlib
import json
import os
import resource
import shutil
import subprocess
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from machines.signals import defer_signals

ROOT = Path(__file__).resolve().parents[2]
WORK = ROOT / ".work" / "lab"
LOCK = WORK / ".lock"  # of the files that all labs of this checkout have in common
CHECKOUT = hashlib.sha256(str(ROOT).encode()).hexdigest()[:4]  # identifies this checkout in names


class LabError(Exception):
    """Something in the lab failed; the text is for the person who called it."""


def _limit(kind: int, soft: int, hard: int) -> str:
    """The limits of an ordinary machine, as far as this one allows them: `soft:hard`."""
    allowed = resource.getrlimit(kind)[1]
    if allowed != resource.RLIM_INFINITY:
        soft, hard = min(soft, allowed), min(hard, allowed)
    return f"{soft}:{hard}"


def configuration() -> str:
    """The text of containers.conf for this machine."""
    nofile = _limit(resource.RLIMIT_NOFILE, 1024, 524288)
    nproc = _limit(resource.RLIMIT_NPROC, 16384, 16384)  # podman itself goes down to the kernel's pid_max
    lines = ["[containers]", f'default_ulimits = ["nofile={nofile}", "nproc={nproc}"]']
    if not Path("/sys/fs/cgroup/cgroup.controllers").exists() and shutil.which("runc"):
        lines += ["[engine]", 'runtime = "runc"']
    return "\n".join(lines) + "\n"


@contextlib.contextmanager
def hold(lock: Path) -> Iterator[None]:
    """Hold the lock of this file: no other thread has it, in this process or in another one."""
    lock.parent.mkdir(parents=True, exist_ok=True)
    with lock.open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


@cache
def environment() -> dict[str, str]:
    """The environment of every podman command."""
    if "CONTAINERS_CONF" in os.environ:
        return dict(os.environ)
    path = WORK / "containers.conf"
    text = configuration()
    with hold(LOCK):
        if not path.exists() or path.read_text() != text:
            draft = path.with_suffix(".new")
            draft.write_text(text)
            draft.rename(path)  # the podman of another lab may read it now
    return {**os.environ, "CONTAINERS_CONF": str(path)}


def podman(*words: str, stdin: bytes | None = None, check: bool = True, timeout: float = 300) -> str:
    """Run one podman command and return its output; raise LabError when it fails, unless check is off."""
    if not shutil.which("podman"):
        raise LabError("podman is not installed: run 'make lab'.")
    # A command that is killed leaves remains over which the next one stumbles: half a container, a network without its file.
    # So no signal reaches it, not even one for the whole group of processes, as that of Ctrl+C.
    apart = words[0] != "exec"
    whole = defer_signals() if apart else contextlib.nullcontext()
    try:
        with whole:
            done = subprocess.run(
                ["podman", *words],
                env=environment(),
                input=stdin,
                capture_output=True,
                timeout=timeout,
                check=False,
                start_new_session=apart,
            )
    except subprocess.TimeoutExpired:
        raise LabError(f"'podman {' '.join(words)}' did not end within {timeout:.0f} s.") from None
    if check and done.returncode:
        raise LabError(f"'podman {' '.join(words)}' failed: {done.stderr.decode(errors='replace').strip()}")
    return done.stdout.decode(errors="replace").strip()


def list_labelled(kind: str, label: str) -> list[dict[str, Any]]:
    """The containers (kind "container") or networks (kind "network") that carry a label."""
    words = ["ps", "--all"] if kind == "container" else ["network", "ls"]
    return json.loads(podman(*words, "--filter", f"label={label}", "--format", "json") or "[]")
