# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A roscore as far as talkers and listeners need one, and talkers as the programs that they are."""

import contextlib
import subprocess
import sys
import threading
import time
import xmlrpc.client
import xmlrpc.server

from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.measure import talker


class Roscore:
    """It keeps publishers and subscribers of topics, and tells subscribers of publishers."""

    def __init__(self):
        self.publishers, self.subscribers = {}, {}  # topic -> {node: URI}
        self.refused = ""

    def getUri(self, caller):
        return 1, "", "http://127.0.0.1:11311/"

    def registerPublisher(self, caller, topic, kind, uri):
        if self.refused:
            return 0, self.refused, 0
        self.publishers.setdefault(topic, {})[caller] = uri
        for subscriber in self.subscribers.get(topic, {}).values():
            self.tell(subscriber, topic)
        return 1, "", []

    def tell(self, subscriber, topic):
        answer = xmlrpc.client.ServerProxy(subscriber).publisherUpdate("/master", topic, self.of(topic))
        assert answer[0] == 1

    def of(self, topic):
        return list(self.publishers.get(topic, {}).values())

    def unregisterPublisher(self, caller, topic, uri):
        return 1, "", int(self.publishers[topic].pop(caller) == uri)

    def registerSubscriber(self, caller, topic, kind, uri):
        self.subscribers.setdefault(topic, {})[caller] = uri
        return 1, "", self.of(topic)

    def unregisterSubscriber(self, caller, topic, uri):
        return 1, "", int(self.subscribers[topic].pop(caller) == uri)

    def getSystemState(self, caller):
        tables = (self.publishers, self.subscribers)
        return 1, "", [[[topic, list(nodes)] for topic, nodes in table.items() if nodes] for table in tables] + [[]]

    def lookupNode(self, caller, name):
        found = [
            nodes[name] for table in (self.publishers, self.subscribers) for nodes in table.values() if name in nodes
        ]
        return (1, "", found[0]) if found else (-1, "unknown node", "")


@contextlib.contextmanager
def served(roscore):
    """The URI of a roscore over a real socket."""
    server = xmlrpc.server.SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False)
    server.register_instance(roscore)
    server.register_multicall_functions()
    thread = threading.Thread(target=server.serve_forever, args=(0.05,))
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}"
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


@contextlib.contextmanager
def talking(uri, name, topic, text):
    """A talker, started as systemd starts it; at its end it is interrupted."""
    variables = {"ROS_MASTER_URI": uri, "ROS_IP": "127.0.0.1"}
    with subprocess.Popen(
        [sys.executable, "-I", "-", name, topic, text],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env=variables,
        text=True,
        preexec_fn=_heeding,
    ) as process:
        process.stdin.write(talker.read_program())
        process.stdin.close()
        try:
            yield process
        finally:
            process.send_signal(2)


def _heeding():
    """A program that the shell has started in the background ignores SIGINT, and so does what that starts."""
    import signal

    signal.signal(signal.SIGINT, signal.SIG_DFL)


def until(condition, seconds=10.0):
    """Wait for something."""
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, "it did not come"
        time.sleep(0.02)
