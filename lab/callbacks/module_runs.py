# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Counts the module runs of each host and their changes, into the JSON file of MODULE_RUNS_FILE."""

import collections
import json
import os

from ansible.plugins.callback import CallbackBase

DOCUMENTATION = r"""
name: module_runs
type: aggregate
short_description: Count the module runs of each host
description:
  - Writes the number of module runs per host, and of the changed ones, into the file named by E(MODULE_RUNS_FILE).
requirements: []
"""

# Actions that never leave the controller.
CONTROLLER_ONLY = (
    "assert",
    "debug",
    "fail",
    "fleet_adopt",
    "fleet_bundle",
    "fleet_check",
    "fleet_finding",
    "fleet_plan",
    "fleet_predict",
    "fleet_report",
    "fleet_summary",
    "fleet_verdict",
    "fleet_watch",
    "import_role",
    "include_role",
    "meta",
    "set_fact",
    "validate_argument_spec",
)


class CallbackModule(CallbackBase):
    """Listens to every result of a module that ran on a host."""

    CALLBACK_VERSION = 2.0
    CALLBACK_TYPE = "aggregate"
    CALLBACK_NAME = "module_runs"
    CALLBACK_NEEDS_ENABLED = True

    def __init__(self):
        super().__init__()
        self.runs = collections.Counter()
        self.changed = collections.Counter()

    def v2_runner_on_ok(self, result):
        self._count(result)

    def v2_runner_on_failed(self, result, ignore_errors=False):
        self._count(result)

    def _count(self, result):
        if result._task.action.rpartition(".")[2] in CONTROLLER_ONLY:
            return
        host = result._host.get_name()
        self.runs[host] += 1 + bool(result._result.get("confirmed"))  # a second run confirms
        self.changed[host] += bool(result._result.get("changed"))

    def v2_playbook_on_stats(self, stats):
        path = os.environ.get("MODULE_RUNS_FILE")
        if path:
            with open(path, "w", encoding="utf-8") as stream:
                json.dump({"runs": dict(self.runs), "changed": dict(self.changed)}, stream)
