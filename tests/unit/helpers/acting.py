# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Actions of Ansible, run by themselves."""

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._robot_io.refusal import PlainFailure


def act(action, task_vars):
    """Run an action; return its result, also one that it fails with."""
    try:
        return action.run(task_vars=task_vars)
    except PlainFailure as failure:
        return {**failure.result, "failed": True, "msg": failure.message}
