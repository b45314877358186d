# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Ports of this computer, by the kernel's own tables."""

import socket
import time

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
