# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action managed_services: runs the module managed_services, and returns its documented answer."""

from __future__ import annotations

from ..plugin_utils._robot_io.robot_action import RobotAction


class ActionModule(RobotAction):
    """Runs the module."""
