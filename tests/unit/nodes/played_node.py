# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""One of the real programs as a process: `played_node.py PROGRAM ARGUMENTS ...`. Only rospy and rosmaster are played.

A discovery is told nothing by others. A sync asks DISCOVERY, an XML-RPC server, what is announced.
"""

import importlib
import os
import socketserver
import sys
import threading
import time
import types
import xmlrpc.client
import xmlrpc.server

from rosmaster_model import installed


class Server(socketserver.ThreadingMixIn, xmlrpc.server.SimpleXMLRPCServer):
    """As rosgraph has it."""

    allow_reuse_address = daemon_threads = True

    def __init__(self, address):
        super().__init__(address, xmlrpc.server.SimpleXMLRPCRequestHandler, logRequests=False)


def play_rosgraph():
    """Have what the roscore takes of rosgraph."""
    if installed():
        return
    sys.modules["rosgraph.xmlrpc"].ThreadingXMLRPCServer = Server
    network = sys.modules["rosgraph.network"]
    network.get_bind_address = lambda: ""
    network.create_local_xmlrpc_uri = lambda port: f"http://{os.environ['ROS_IP']}:{port}/"


class DiscoveryNode:
    """The node of discovery."""

    def __init__(self, *_given):
        self.publish_change = self.links = lambda *_news: None

    def service_uri(self):
        return "", ""


class SyncNode:
    """The node of sync, and the topic that it listens to."""

    def __init__(self, _held):
        self.service_uri = lambda: ("", "")

    def subscribe(self, _topic, callback):
        def run():
            before = []
            while True:
                now = list_masters("")
                for master in [master for master in now if master not in before]:
                    callback("changed", master)
                before = now
                time.sleep(0.05)

        threading.Thread(target=run, daemon=True).start()


def list_masters(_service):
    from rosfleet_multimaster.protocol.messages import AnnouncedMaster

    return [AnnouncedMaster(*fields) for fields in xmlrpc.client.ServerProxy(os.environ["DISCOVERY"]).list()]


def play_rospy():
    """Have the module edge/ros.py, without ROS."""
    ros = types.ModuleType("rosfleet_multimaster.edge.ros")
    ros.master_uri, ros.hostname = lambda: os.environ["ROS_MASTER_URI"], lambda: os.environ["ROS_IP"]
    ros.node_name, ros.master_name = lambda default: f"/{default}", lambda uri: "own"
    ros.start = lambda default: (f"/{default}", "http://127.0.0.1:1/")
    ros.on_shutdown = ros.stop = ros.md5sum = lambda _what: None
    ros.sync_info = lambda _service: {}
    ros.DiscoveryNode, ros.SyncNode = DiscoveryNode, SyncNode
    ros.ListMasters = lambda: list_masters
    ros.Diagnostics = lambda: types.SimpleNamespace(has_listeners=lambda: False, publish=lambda *_what: None)
    sys.modules[ros.__name__] = ros


def main():
    """Run the program."""
    name = sys.argv.pop(1)
    play_rosgraph()
    play_rospy()
    from rosfleet_multimaster.edge.process import program

    program.run(importlib.import_module(f"rosfleet_multimaster.{name}").main)


if __name__ == "__main__":
    main()
