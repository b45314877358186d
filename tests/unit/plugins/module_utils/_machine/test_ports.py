# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Ports of this computer, by the kernel's own tables."""

import os
import pwd
import socket
import time

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import ports


def test_connections_that_nobody_takes_are_counted():
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        port = listener.getsockname()[1]
        assert ports.count_waiting(port) is None
        listener.listen(5)
        assert ports.count_waiting(port) == 0
        callers = [socket.create_connection(("127.0.0.1", port), timeout=5) for _number in range(3)]
        deadline = time.monotonic() + 5
        while ports.count_waiting(port) != 3 and time.monotonic() < deadline:
            time.sleep(0.01)
        assert ports.count_waiting(port) == 3
        listener.accept()[0].close()
        assert ports.count_waiting(port) == 2
        for caller in callers:
            caller.close()


OWN = pwd.getpwuid(os.getuid()).pw_name
MANAGER = f"/user.slice/user-{os.getuid()}.slice/user@{os.getuid()}.service"


@pytest.mark.parametrize(
    ("groups", "unit", "person"),
    [
        (f"0::{MANAGER}/app.slice/odom.service\n", "odom.service", OWN),
        (f"12:pids:/x\n1:name=systemd:{MANAGER}/odom.service\n", "odom.service", OWN),
        (f"0::{MANAGER}/init.scope\n", "init.scope", OWN),
        # A person makes folders below, with any name.
        (f"0::{MANAGER}/app.slice/user@4123456789.service/odom.service\n", "odom.service", OWN),
        (f"0::{MANAGER}\n", f"user@{os.getuid()}.service", ""),
        ("0::/system.slice/user@x.service/odom.service\n", "odom.service", ""),
        ("0::/user.slice/user@4123456789.service/odom.service\n", "odom.service", "4123456789"),  # nobody's number
        ("0::/user.slice/user@9999999999.service/odom.service\n", "odom.service", "9999999999"),
        ("0::/system.slice/odom.service\n", "odom.service", ""),
        ("", "", ""),
    ],
)
def test_the_unit_of_a_process_is_of_the_computer_or_of_a_person(groups, unit, person):
    assert (ports.unit(groups), ports.person(groups)) == (unit, person)
