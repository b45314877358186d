# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Writes the variables of a host at the end of a playbook into the JSON file of VARIABLES_SEEN_FILE."""

import json
import os

from ansible.plugins.callback import CallbackBase

DOCUMENTATION = r"""
name: variables_seen
type: aggregate
short_description: Write the variables of a host at the end
description:
  - Writes the hosts, the groups and the variables of the host E(VARIABLES_SEEN_HOST), as far as the inventory or the connection has
    them, into the file named by E(VARIABLES_SEEN_FILE).
requirements: []
"""

#: facts and results of tasks, and values that differ in each run
PASSING = (
    "ansible_facts",
    "ansible_date_time",
    "ansible_version",
    "ansible_playbook_python",
    "ansible_search_path",
    "hostvars",
    "vars",
)


class CallbackModule(CallbackBase):
    """Looks at the variables when all plays have ended."""

    CALLBACK_VERSION = 2.0
    CALLBACK_TYPE = "aggregate"
    CALLBACK_NAME = "variables_seen"
    CALLBACK_NEEDS_ENABLED = True

    def __init__(self):
        super().__init__()
        self._play = None

    def v2_playbook_on_play_start(self, play):
        self._play = play

    def v2_playbook_on_stats(self, stats):
        manager = self._play.get_variable_manager()
        inventory = manager._inventory
        host = inventory.get_host(os.environ["VARIABLES_SEEN_HOST"])
        found = manager.get_vars(host=host, include_hostvars=False) if host else {}
        seen = {
            "hosts": sorted(one.name for one in inventory.get_hosts("all")),
            "groups": {name: sorted(one.name for one in group.get_hosts()) for name, group in inventory.groups.items()},
            "variables": {
                name: repr(value)
                for name, value in sorted(found.items())
                if name not in PASSING and name.startswith(("ansible_", "multimaster_")) and not isinstance(value, dict)
            },
        }
        with open(os.environ["VARIABLES_SEEN_FILE"], "w", encoding="utf-8") as file:
            json.dump(seen, file)
