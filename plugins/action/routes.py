# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action routes: runs the module routes, and confirms its changes. A change that cuts the controller off is not confirmed."""

from __future__ import annotations

from ..plugin_utils._robot_io.confirmation import GuardedAction


class ActionModule(GuardedAction):
    """Runs the module, and confirms its changes over a new connection."""

    what = "routes"
