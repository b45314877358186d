# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A connection to a robot that Ansible keeps open."""

import types

from ansible.plugins.connection import ConnectionBase


class Kept(ConnectionBase):
    """A connection that counts how often it is left."""

    transport = _connect = exec_command = put_file = fetch_file = close = None

    def __init__(self, transport):
        self.transport, self.resets = transport, 0
        self._shell = types.SimpleNamespace(tmpdir=None)

    def reset(self):
        self.resets += 1
