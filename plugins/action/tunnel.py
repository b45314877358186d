# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action tunnel: runs the module tunnel, and confirms its change. A tunnel that cuts the controller off is not confirmed."""

from __future__ import annotations

from ..plugin_utils._robot_io.confirmation import GuardedAction


class ActionModule(GuardedAction):
    """Runs the module, and confirms over a new connection."""

    what = "peers of the tunnel"
