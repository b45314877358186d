# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The implementation beside the bundled one: multimaster_fkie (`FKIE=<checkout>`), or its successor fkie_mas (`MAS=<checkout>`).

What every computer of a lab sees of this machine, and how the nodes are started there.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from machines.podman import ROOT

HERE = Path(__file__).parent
SETUP = "/opt/interop/setup.bash"
MAS = bool(os.environ.get("MAS"))


@dataclass(frozen=True)
class Upstream:
    """An implementation: where its checkout is in a computer, and its programs there."""

    place: str
    programs: tuple[str, str]  # of discovery, of sync
    names: tuple[str, str]  # of their nodes, where nobody gives them others
    environment: str = ""  # what a person sets before
    ready: str = "true"  # what makes a computer ready

    def program(self, node: str) -> str:
        """The path of the program of "discovery" or "sync"."""
        return f"{self.place}/{self.programs[node == 'sync']}"

    def name(self, node: str) -> str:
        return self.names[node == "sync"]


FKIE = Upstream(
    "/opt/fkie",
    ("fkie_master_discovery/nodes/master_discovery", "fkie_master_sync/nodes/master_sync"),
    ("master_discovery", "master_sync"),
)
FKIE_MAS = Upstream(
    "/opt/mas",
    ("fkie_mas_discovery/nodes/mas-discovery", "fkie_mas_sync/nodes/mas-sync"),
    ("mas_discovery", "mas_sync"),
    environment="ROS_VERSION=1 ROS_DISTRO=noetic",
    ready="python3 /opt/interop/messages.py /opt/mas/fkie_mas_msgs /opt/made && cp -r /opt/needs/programs/. / && ldconfig",
)
UPSTREAM = FKIE_MAS if MAS else FKIE

MOUNTS = {
    UPSTREAM.place: Path(os.environ.get("MAS") or os.environ.get("FKIE") or "/nowhere"),
    "/opt/interop": HERE / "modules",
    "/opt/messages/fkie_multimaster_msgs": ROOT / "roles/nodes/files/python/fkie_multimaster_msgs",
    "/opt/nodes": ROOT / "lab" / "nodes",
    **({"/opt/needs": ROOT / ".work" / "mas"} if MAS else {}),
}
