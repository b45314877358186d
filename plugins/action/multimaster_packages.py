# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action multimaster_packages: runs the module multimaster_packages, of which the documented answer comes back."""

from __future__ import annotations

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._changes.asked import RobotAction


class ActionModule(RobotAction):
    """Runs the module."""
