# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A connection to a computer that is not there: a module gets the answer that a real one gave, at once.

So a run costs what the controller does, and nothing else: forks, templates, and the making of what is sent.
"""

import json
import re
from pathlib import Path

from ansible.errors import AnsibleConnectionFailure
from ansible.plugins.connection import ConnectionBase

DOCUMENTATION = r"""
name: recorded
short_description: Answer modules with what a real computer said
description:
  - Takes modules by way of pipelining. Other commands do nothing.
options:
  computer:
    description: The name of the computer.
    vars:
      - name: inventory_hostname
    required: true
  answers:
    description:
      - The folder with a file of JSON for each computer, such as C(kobuki1computer.json). It has an answer for each module, or for
        each value of the option O(ignore:action) of a module, as in C({"multimaster_verify collect":{}}).
    vars:
      - name: recorded_answers
    required: true
"""

MODULE = re.compile(rb"^ansible_module='rosfleet\.multimaster\.(\w+)'", re.MULTILINE)
ACTION = re.compile(rb'"action": ?"(\w+)"')


class Connection(ConnectionBase):
    """See DOCUMENTATION."""

    transport = "recorded"
    has_pipelining = True

    def _connect(self):
        self._connected = True
        return self

    def exec_command(self, cmd, in_data=None, sudoable=True):
        found = MODULE.search(in_data or b"")
        if not found:
            return 0, b"", b""
        answers = json.loads((Path(self.get_option("answers")) / f"{self.get_option('computer')}.json").read_bytes())
        keys = [found.group(1).decode()] * 2
        keys[0] += "".join(f" {action.decode()}" for action in ACTION.findall(in_data)[:1])
        for key in keys:
            if key in answers:
                return 0, json.dumps(answers[key]).encode(), b""
        raise AnsibleConnectionFailure(f"there is no answer of {keys[0]}")

    def put_file(self, in_path, out_path):
        raise AnsibleConnectionFailure("nothing is kept here")

    def fetch_file(self, in_path, out_path):
        raise AnsibleConnectionFailure("nothing is kept here")

    def close(self):
        self._connected = False
