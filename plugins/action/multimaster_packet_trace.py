# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action multimaster_packet_trace: runs the module multimaster_packet_trace, and returns its documented answer."""

from __future__ import annotations

from ..plugin_utils._robot_io.robot_action import RobotAction


class ActionModule(RobotAction):
    """Runs the module."""
