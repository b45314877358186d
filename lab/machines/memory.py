# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The memory of a lab: the sum of the processes of its containers (anonymous memory, no page cache), every second.

The kernel accounts it per container; it is read in the file memory.stat of each container's control group.
"""

from __future__ import annotations

import threading
from pathlib import Path

from machines.containers import label
from machines.podman import list_labelled, podman

GROUPS = Path("/sys/fs/cgroup")
# Control groups of version 2 and 1: the root, and the field that counts a group and those below it.
KINDS = (("", "anon"), ("memory", "total_rss"))


def _files(lab: str) -> list[tuple[Path, str]]:
    names = [entry["Names"][0] for entry in list_labelled("container", label(lab))]
    groups = podman("inspect", "--format", "{{.State.CgroupPath}}", *names).split() if names else []
    places = [(GROUPS / root / group.lstrip("/") / "memory.stat", field) for group in groups for root, field in KINDS]
    return [(file, field) for file, field in places if file.exists()]


def _field(file: Path, field: str) -> int:
    try:
        lines = dict(line.split() for line in file.read_text().splitlines())
    except OSError:  # a container that has gone
        return 0
    return int(lines.get(field, 0))


class Peak:
    """The most that a lab held between the beginning and the end of the block, in bytes; 0 if the kernel does not account it."""

    def __init__(self, lab: str) -> None:
        self.bytes = 0
        self._files = _files(lab)
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def _watch(self) -> None:
        while not self._end.wait(1.0):
            self.bytes = max(self.bytes, sum(_field(*place) for place in self._files))

    def __enter__(self) -> Peak:
        self._thread.start()
        return self

    def __exit__(self, *_exception: object) -> None:
        self._end.set()
        self._thread.join()
