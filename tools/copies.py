# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Writes the files that are copies of another file, after that one was edited.

The nodes and the modules have some functions in common, and each must have them in its own tree, since only that is on the
robot. Links would do in a checkout, but a link that leads out of a tree is dead on the robot. The
controller has all trees, so it takes them from the nodes (plugins/plugin_utils/_inventory/filters.py and
plain_text.py).
"""

from __future__ import annotations

import shutil
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
NODES = "roles/nodes/files/python/rosfleet_multimaster"

#: copy -> original
COPIES = {
    "plugins/module_utils/_base/plain_text.py": f"{NODES}/protocol/plain_text.py",
    "plugins/module_utils/_probe/ros_client/hosts.py": f"{NODES}/protocol/tcpros/hosts.py",
    "plugins/module_utils/_probe/ros_client/header.py": f"{NODES}/protocol/tcpros/header.py",
    "plugins/module_utils/_probe/ros_client/documents.py": f"{NODES}/protocol/xml_rpc.py",
}


def find_stale_copies() -> list[str]:
    """The copies that differ from their original."""
    return [
        copy
        for copy, original in COPIES.items()
        if (ROOT / copy).is_symlink()
        or not (ROOT / copy).exists()
        or (ROOT / copy).read_bytes() != (ROOT / original).read_bytes()
    ]


def main() -> None:
    """Write those that differ."""
    for copy in find_stale_copies():
        (ROOT / copy).unlink(missing_ok=True)
        shutil.copyfile(ROOT / COPIES[copy], ROOT / copy)
        print(f"{copy} is again as {COPIES[copy]}")


if __name__ == "__main__":
    main()
