# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The program that puts the metrics of the nodes in the folder that node_exporter reads: only root may write there.

The nodes write files in memory, each in its own folder; this copies them. Their text is bounded, since strangers
talk with them. The file of a node goes with the node, and its values here go with the file: old values would be worse than missing ones.
It runs on the system's Python (`python3 -I`), only on files of root, and without ROS.
"""

import os
import signal
import sys
from typing import Dict, Mapping

from .edge.clock import sleep
from .edge.journal import plain_streams, say
from .edge.process import textfile
from .edge.process.systemd import notify, watchdog

LOOK = 5.0  # seconds between two looks at the files of the nodes
MOST = 1 << 20  # bytes of a file
#: name in the folder of node_exporter -> file of the node
FILES = {f"multimaster_{node}.prom": f"/run/multimaster-{node}/metrics.prom" for node in ("discovery", "sync", "relay")}


class Publisher:
    """Copies files into a folder."""

    def __init__(self, folder: str, files: Mapping[str, str] = FILES) -> None:
        self._files = {os.path.join(folder, name): source for name, source in files.items()}
        self._seen: Dict[str, str] = {}  # the present files

    def look(self) -> None:
        """Copy new files, and remove those that have no source any more. Raises OSError if that is not possible."""
        for target, source in self._files.items():
            try:
                text = textfile.read(source, MOST)
            except (OSError, ValueError):
                text = ""
            if not text:
                textfile.remove(target)
            elif text != self._seen.get(target):
                textfile.write(target, text)
            self._seen[target] = text

    def end(self) -> None:
        """Remove the copies."""
        for target in self._files:
            textfile.remove(target)


def main(folder: str) -> None:
    """Copy for ever, until SIGTERM."""
    plain_streams()
    publisher = Publisher(folder)
    signal.signal(signal.SIGTERM, lambda *_about: sys.exit(0))
    every = min(LOOK, watchdog() or LOOK)
    try:
        publisher.look()
        notify("READY=1", f"STATUS=the metrics are in {folder}")
        while True:
            sleep(every)
            publisher.look()
            notify("WATCHDOG=1")
    except OSError as problem:
        say(f"the metrics cannot be written to {folder}: {problem}")
        sys.exit(1)
    finally:
        publisher.end()
