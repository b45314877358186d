# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A connection to a computer that is not there: a module gets the answer that a real one gave, at once.

So a run costs what the controller does, and nothing else: forks, templates, and the making of what is sent.
"""

import json
import re

from ansible.errors import AnsibleConnectionFailure
from ansible.plugins.connection import ConnectionBase

DOCUMENTATION = r"""
name: recorded
short_description: Answer modules with what a real computer said
description:
  - Takes modules by way of pipelining, and answers those that a run of site.yml has on a computer that is as planned.
options:
  address:
    description: The address of the computer.
    vars:
      - name: multimaster_address
    required: true
  computer:
    description: The name of the computer.
    vars:
      - name: inventory_hostname
    required: true
  master:
    description: The computer with the roscore of its robot.
    vars:
      - name: multimaster_master
    required: true
  machine:
    description: The file with the return of multimaster_info on a real computer, as JSON.
    vars:
      - name: recorded_machine
    required: true
"""

MODULE = re.compile(rb"^ansible_module='rosfleet\.multimaster\.(\w+)'", re.MULTILINE)


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
            raise AnsibleConnectionFailure(f"there is no answer to {cmd[:100]}")
        return 0, json.dumps(self._answer(found.group(1).decode())).encode(), b""

    def _answer(self, module):
        if module == "multimaster_computer":
            nothing = {"changed": False, "unconfirmed": False, "same_connection": False}
            return {**nothing, "concerns": {}, "diff": [], "msg": "All is as planned."}
        if module != "multimaster_info":
            raise AnsibleConnectionFailure(f"there is no answer of the module {module}")
        with open(self.get_option("machine"), encoding="utf-8") as stream:
            text = stream.read()
        for word, option in (("@ADDRESS@", "address"), ("@NAME@", "computer"), ("@MASTER@", "master")):
            text = text.replace(word, self.get_option(option))
        return json.loads(text)

    def put_file(self, in_path, out_path):
        raise AnsibleConnectionFailure("nothing is kept here")

    def fetch_file(self, in_path, out_path):
        raise AnsibleConnectionFailure("nothing is kept here")

    def close(self):
        self._connected = False
