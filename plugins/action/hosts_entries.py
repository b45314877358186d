# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action hosts_entries: runs the module hosts_entries, and returns its documented answer."""

from __future__ import annotations

from ..plugin_utils._robot_io.robot_action import RobotAction


class ActionModule(RobotAction):
    """Runs the module."""
