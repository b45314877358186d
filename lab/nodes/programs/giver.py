# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Registers publishers at the own roscore as it is asked, over TCP: a line of JSON in, one out.

giver.py ADDRESS PORT : lines are ["register" or "unregister", [[NODE, TOPIC], ...]]; the answer is [BEFORE, AFTER], the times
of the kernel's steady clock, which all containers share. Its nodes have one server for all, and answer as nodes do.
"""

import http.client
import json
import os
import socketserver
import sys
import threading
import time
import xmlrpc.client
from socketserver import ThreadingMixIn
from xmlrpc.server import SimpleXMLRPCRequestHandler, SimpleXMLRPCServer

ADDRESS, PORT = sys.argv[1], int(sys.argv[2])
TYPE = "std_msgs/String"
topics = {}  # of the nodes
own = {}  # thread -> its connection to the roscore


class Handler(SimpleXMLRPCRequestHandler):
    protocol_version = "HTTP/1.1"


class Node(ThreadingMixIn, SimpleXMLRPCServer):
    daemon_threads = True

    def _dispatch(self, method, _parameters):
        answers = {
            "getPid": os.getpid(),
            "getMasterUri": os.environ["ROS_MASTER_URI"],
            "getPublications": [[topic, TYPE] for names in list(topics.values()) for topic in list(names)],
            "getSubscriptions": [],
            "requestTopic": ["TCPROS", ADDRESS, 9],
        }
        return [1, "", answers.get(method, 0)]


def call(method, *arguments):
    """A call to the roscore, tried again for a while if it does not answer, as nodes do."""
    for attempt in range(100):
        try:
            done = getattr(roscore(), method)(*arguments)
            break
        except (OSError, http.client.HTTPException):
            own.clear()
            if attempt == 99:
                raise
            time.sleep(0.2)
    assert done[0] == 1, done


def roscore():
    """The connection of this thread, which stays open."""
    own.setdefault(threading.get_ident(), xmlrpc.client.ServerProxy(os.environ["ROS_MASTER_URI"]))
    return own[threading.get_ident()]


class Orders(socketserver.StreamRequestHandler):
    def handle(self):
        for line in self.rfile:
            order, wanted = json.loads(line)
            before = time.monotonic()
            for node, topic in wanted:
                if order == "register":
                    topics.setdefault(node, set()).add(topic)
                    call("registerPublisher", node, topic, TYPE, uri)
                else:
                    topics.get(node, set()).discard(topic)
                    call("unregisterPublisher", node, topic, uri)
            self.wfile.write(json.dumps([before, time.monotonic()]).encode() + b"\n")


node = Node((ADDRESS, 0), requestHandler=Handler, logRequests=False)
uri = f"http://{ADDRESS}:{node.server_address[1]}/"
threading.Thread(target=node.serve_forever, daemon=True).start()
socketserver.ThreadingTCPServer.allow_reuse_address = True
with socketserver.ThreadingTCPServer((ADDRESS, PORT), Orders) as server:
    print("ready", flush=True)
    server.serve_forever()
