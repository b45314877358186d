# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Fixtures for the tests of several probes."""

import threading
import xmlrpc.server

import pytest


@pytest.fixture
def served():
    """Serve objects over XML-RPC; returns their URIs."""
    running = []

    def serve(instance):
        server = xmlrpc.server.SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False)
        server.register_instance(instance)
        server.register_multicall_functions()
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05})
        thread.start()
        running.append((server, thread))
        return f"http://127.0.0.1:{server.server_address[1]}/"

    yield serve
    for server, thread in running:
        server.shutdown()
        thread.join()
        server.server_close()
