# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Lets the tests of modules import namespaces.py."""

import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).parent))
