# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The controller's side of the module sysctl: a change that cuts it off is not confirmed."""

from __future__ import annotations

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._changes.confirmed import GuardedAction


class ActionModule(GuardedAction):
    """Runs the module, and confirms what it changed over a new connection."""

    what = "kernel settings"
