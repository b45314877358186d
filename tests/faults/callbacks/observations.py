# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Keeps every registered result of a run, into the JSON file of OBSERVATIONS_FILE: what fleet_report judges."""

import collections
import json
import os

from ansible.plugins.callback import CallbackBase

DOCUMENTATION = r"""
name: observations
type: aggregate
short_description: Keep the registered results of each host
description:
  - Writes the last result of each registered name, by host, into the file named by E(OBSERVATIONS_FILE).
requirements: []
"""

FLEET = "multimaster_fleet"
NOT_KEPT = ("invocation", "diff", "ansible_facts", "warnings", "deprecations")


class CallbackModule(CallbackBase):
    """Listens to every result that is registered."""

    CALLBACK_VERSION = 2.0
    CALLBACK_TYPE = "aggregate"
    CALLBACK_NAME = "observations"
    CALLBACK_NEEDS_ENABLED = True

    def __init__(self):
        super().__init__()
        self.registered = collections.defaultdict(dict)
        self.judged = {}

    def v2_runner_on_ok(self, result):
        self._keep(result)

    def v2_runner_on_failed(self, result, ignore_errors=False):
        self._keep(result)

    def v2_runner_on_unreachable(self, result):
        self._keep(result, unreachable=True)

    def _keep(self, result, **more):
        name = result._task.register
        values = {
            key: value for key, value in result._result.items() if not key.startswith("_") and key not in NOT_KEPT
        }
        if result._task.action.rpartition(".")[2] == "fleet_report":
            words = result._task.args
            self.judged = {word: words[word] for word in words if isinstance(words[word], (list, str))}
        elif name:
            self.registered[result._host.get_name()][name] = {**values, **more}

    def v2_playbook_on_stats(self, stats):
        path = os.environ.get("OBSERVATIONS_FILE")
        if path:
            plans = [of.pop(FLEET) for of in self.registered.values() if FLEET in of]
            document = {"fleet": plans[0] if plans else None, "report": self.judged, "registered": self.registered}
            with open(path, "w", encoding="utf-8") as stream:
                json.dump(document, stream, default=str)
