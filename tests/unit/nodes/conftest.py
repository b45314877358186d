# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The nodes are imported as they are installed: from the folder that the role copies. `virtual_time` is beside the tests."""

import pathlib
import sys

_HERE = pathlib.Path(__file__).parent
_NODES = _HERE.parents[2] / "roles/nodes/files"
sys.path[:0] = [str(_NODES / "python"), str(_HERE)]
