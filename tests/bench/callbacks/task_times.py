# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""How long each task of a run took, and what it changed, into the JSON file of TASK_TIMES_FILE."""

import json
import os
import time

from ansible.plugins.callback import CallbackBase

DOCUMENTATION = r"""
name: task_times
type: aggregate
short_description: Time the tasks of a run
description:
  - Writes one entry per task into the file named by E(TASK_TIMES_FILE), with its name, its seconds, how many results it
    had on all hosts (one per item of a loop), and on which hosts it changed something.
requirements: []
"""


class CallbackModule(CallbackBase):
    """Listens to the beginnings of tasks and to their results."""

    CALLBACK_VERSION = 2.0
    CALLBACK_TYPE = "aggregate"
    CALLBACK_NAME = "task_times"
    CALLBACK_NEEDS_ENABLED = True

    def __init__(self):
        super().__init__()
        self.tasks = []
        self.began = time.monotonic()

    def v2_playbook_on_task_start(self, task, is_conditional):
        self._end()
        self.tasks.append({"task": task.get_name(), "results": 0, "changed": []})

    def v2_playbook_on_handler_task_start(self, task):
        self.v2_playbook_on_task_start(task, False)

    def v2_runner_item_on_ok(self, result):
        self.tasks[-1]["results"] += 1

    def v2_runner_on_ok(self, result):
        if "results" not in result._result or not result._task.loop:
            self.tasks[-1]["results"] += 1
        if result._result.get("changed"):
            self.tasks[-1]["changed"].append(result._host.get_name())

    def v2_playbook_on_stats(self, stats):
        self._end()
        path = os.environ.get("TASK_TIMES_FILE")
        if path:
            with open(path, "w", encoding="utf-8") as stream:
                json.dump(self.tasks, stream)

    def _end(self):
        now = time.monotonic()
        if self.tasks:
            self.tasks[-1]["seconds"] = now - self.began
        self.began = now
