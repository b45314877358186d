# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The duration, the host and the change of each task of a run, into the JSON file of TASK_TIMES_FILE."""

import json
import os
import resource
import time

from ansible.plugins.callback import CallbackBase
from ansible.plugins.connection import ssh

DOCUMENTATION = r"""
name: task_times
type: aggregate
short_description: Time the tasks of a run
description:
  - Writes one entry per task into the file named by E(TASK_TIMES_FILE), with its name, its seconds, how many results it
    had on all hosts (one per item of a loop), and on which hosts it changed something.
  - Beside its seconds stand those of processors. C(systems) are those of the control groups whose files are named, with colons, by
    E(TASK_TIMES_SYSTEMS), C(transfers) those of the ssh clients, C(controller) those of all other processes of Ansible.
requirements: []
"""


def processors():
    """The seconds of processors until now: of Ansible with its ended children, of the systems, and of ssh clients."""
    own = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    systems = 0.0
    for path in filter(None, os.environ.get("TASK_TIMES_SYSTEMS", "").split(":")):
        with open(path, encoding="ascii") as stream:
            systems += int(stream.read()) / 1e9
    return sum(usage.ru_utime + usage.ru_stime for usage in own), systems, _transfers()


def _transfers():
    """The notes of the workers."""
    try:
        with open(os.environ["TASK_TIMES_FILE"] + ".ssh", encoding="ascii") as stream:
            return sum(map(float, stream))
    except OSError:
        return 0.0


def _children():
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def _noted(run):
    """A run of an ssh client, which notes the client's seconds. It happens in a worker."""

    def noted(*arguments, **options):
        before = _children()
        try:
            return run(*arguments, **options)
        finally:
            with open(os.environ["TASK_TIMES_FILE"] + ".ssh", "a", encoding="ascii") as stream:
                stream.write(f"{_children() - before}\n")

    return noted


class CallbackModule(CallbackBase):
    """Listens to the beginnings of tasks and to their results."""

    CALLBACK_VERSION = 2.0
    CALLBACK_TYPE = "aggregate"
    CALLBACK_NAME = "task_times"
    CALLBACK_NEEDS_ENABLED = True

    def __init__(self):
        super().__init__()
        self.tasks = []
        ssh.Connection._bare_run = _noted(ssh.Connection._bare_run)
        self.began, self.before = time.monotonic(), processors()

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
        now, spent = time.monotonic(), processors()
        if self.tasks:
            own, systems, transfers = (after - before for after, before in zip(spent, self.before))
            times = {"controller": own - transfers, "systems": systems, "transfers": transfers}
            self.tasks[-1].update(times, seconds=now - self.began)
        self.began, self.before = now, spent
