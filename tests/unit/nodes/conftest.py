# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The nodes are imported as they are installed: from the folder that the role copies."""

import pathlib
import sys

_NODES = pathlib.Path(__file__).parents[3] / "roles/nodes/files"
sys.path.insert(0, str(_NODES / "python"))
