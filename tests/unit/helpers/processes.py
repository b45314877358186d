# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Processes that a test starts, and that import what the test can import (pytest.ini)."""

import os
import sys


def with_paths(**more):
    """Return the environment of this process, with its import paths and these variables."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path)), **more}
