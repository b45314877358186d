# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Plays many masters from one computer, with the bundled nodes' own code for heartbeats and documents, and no roscores.

simulated.py GROUP TOPICS ADDRESS... : each address has a master "simulated_N" with so many topics of one node. All send
a heartbeat a second. A line on standard input is a number: that master has one topic more.
"""

import socket
import sys
import threading
import time

sys.path.insert(0, "/usr/local/lib/rosfleet-multimaster/python")

from rosfleet_multimaster.discovery.rpc_methods import RpcMethods, ServedMaster  # noqa: E402
from rosfleet_multimaster.discovery.state_feed import StateFeed  # noqa: E402
from rosfleet_multimaster.edge.rpc_server import callers, serve  # noqa: E402
from rosfleet_multimaster.protocol.graph import LOCAL, ExportPolicy, Node, State  # noqa: E402
from rosfleet_multimaster.protocol.heartbeat import Heartbeat, Kind, Stamp, encode  # noqa: E402
from rosfleet_multimaster.protocol.members import Members  # noqa: E402

PORT, RPC_PORT, NODE_PORT = 11511, 11611, 45000
GROUP, TOPICS = sys.argv[1], int(sys.argv[2])


class Master:
    def __init__(self, number, address):
        self.number, self.address, self.count = number, address, TOPICS
        uri = f"http://{address}:11311/"
        self.own = ServedMaster(uri, f"simulated_{number}", "/master_discovery", lambda: address, RPC_PORT)
        self.own.state, self.own.away = self.state(), ""
        feed = StateFeed(self.own.current)
        feed.update(self.own.state, None)
        self.feed = feed
        here = {address}
        served = RpcMethods(
            self.own,
            ExportPolicy.from_parameters({}),
            {},
            here.__contains__,
            lambda: None,
            lambda _type: None,
            lambda: (),
            feed,
        )
        who = callers(Members(), uri, here.__contains__)
        self.server = serve(address, RPC_PORT, served.methods(), lambda _host, _why: None, who)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(address))
        self.socket.bind((address, PORT))

    def state(self):
        node = f"/simulated_{self.number}"
        topics = [f"{node}/topic_{topic}" for topic in range(self.count)]
        now = time.time()
        uri = f"http://{self.address}:11311/"
        return State(
            uri=uri,
            name=f"simulated_{self.number}",
            stamp=now,
            local_stamp=now,
            publishers=dict.fromkeys(topics, (node,)),
            types=dict.fromkeys(topics, "std_msgs/String"),
            nodes={node: Node(f"http://{self.address}:{NODE_PORT}/", uri, LOCAL)},
        )

    def more(self):
        self.count += 1
        self.own.state = self.state()
        self.feed.update(self.own.state, None)
        self.beat()

    def beat(self):
        stamp = Stamp.from_seconds(self.own.state.stamp)
        self.socket.sendto(encode(Heartbeat(Kind.STATE, RPC_PORT, 1.0, stamp, stamp)), (GROUP, PORT))


masters = [Master(number, address) for number, address in enumerate(sys.argv[3:])]


def beats():
    while True:
        for master in masters:
            master.beat()
            time.sleep(1 / len(masters))


threading.Thread(target=beats, daemon=True).start()
print("ready", flush=True)
for line in sys.stdin:
    masters[int(line)].more()
threading.Event().wait()
