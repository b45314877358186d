# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The bundled roscore, killed again and again at random moments, while nodes register, unregister, set parameters and die.

    killed_roscore.py KILLS [SEED]

It starts the roscore itself, and plays the nodes: each is an XML-RPC server that tells what it has. What the roscore had
answered must be there after each kill, and nothing of a node that died; it ends with one line of JSON.
"""

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import xmlrpc.client
import xmlrpc.server

PORT, NODES, TOPICS = 11399, 12, 40
URI = f"http://127.0.0.1:{PORT}/"
MOST = 20.0  # seconds for all to be as it should be, on a very busy machine


class Node:
    """A node: what it has, and the server that tells so."""

    def __init__(self, name):
        self.name, self.has = name, {"publisher": set(), "subscriber": set()}
        self.parameters, self.doubtful, self.updates = {}, set(), 0
        self.server = xmlrpc.server.SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False, allow_none=True)
        self.uri = "http://127.0.0.1:%d/" % self.server.server_address[1]
        self.server.register_function(lambda _caller: [1, "", os.getpid()], "getPid")
        for kind, method in (("publisher", "getPublications"), ("subscriber", "getSubscriptions")):
            self.server.register_function(
                lambda _c, kind=kind: [1, "", [[t, "x/Y"] for t in sorted(self.has[kind])]], method
            )
        self.server.register_function(self.update, "publisherUpdate")
        threading.Thread(target=self.server.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True).start()

    def update(self, *_arguments):
        self.updates += 1
        return [1, "", 0]

    def die(self):
        self.server.shutdown()
        self.server.server_close()


class Test:
    """The roscore and its nodes."""

    def __init__(self, seed):
        self.random = random.Random(seed)
        self.folder = tempfile.mkdtemp(prefix="roscore-")
        self.count, self.changes = 0, 0
        self.nodes = []
        self.process = None

    def start(self):
        command = [
            sys.executable,
            "-m",
            "rosfleet_multimaster.roscore",
            "-p",
            str(PORT),
            "--no-rosout",
            "--store",
            self.folder,
        ]
        environment = {**os.environ, "ROS_IP": "127.0.0.1", "PATH": "/nowhere"}  # without rosversion
        self.process = subprocess.Popen(command, env=environment, stderr=open(self.folder + "/log", "ab"))
        until = time.monotonic() + MOST
        while time.monotonic() < until:
            try:
                return xmlrpc.client.ServerProxy(URI).getPid("/test")
            except OSError:
                time.sleep(0.01)
        raise SystemExit("the roscore does not start: " + open(self.folder + "/log").read()[-2000:])

    def churn(self, stop):
        """Change something until the roscore is gone. What had no answer is in doubt."""
        roscore = xmlrpc.client.ServerProxy(URI)
        change = {"parameter": self.change_parameter, "publisher": self.change_topic, "subscriber": self.change_topic}
        while not stop.is_set():
            node, kind = self.random.choice(self.nodes), self.random.choice(sorted(change))
            try:
                change[kind](roscore, node, kind)
            except (OSError, xmlrpc.client.Error):
                return
            self.changes += 1

    def change_parameter(self, roscore, node, _kind):
        name, value = f"/parameters{node.name}/p{self.random.randrange(5)}", self.random.randrange(10**6)
        node.doubtful.add(name)
        assert roscore.setParam(node.name, name, value)[0] == 1
        node.parameters[name] = value
        node.doubtful.discard(name)

    def change_topic(self, roscore, node, kind):
        """Register or unregister. The node has a topic before it registers it, and not any more before it unregisters."""
        topic = f"/topic_{self.random.randrange(TOPICS)}"
        node.doubtful.add((kind, topic))
        if topic in node.has[kind]:
            node.has[kind].discard(topic)
            answer = getattr(roscore, f"unregister{kind.capitalize()}")(node.name, topic, node.uri)
        else:
            node.has[kind].add(topic)
            answer = getattr(roscore, f"register{kind.capitalize()}")(node.name, topic, "x/Y", node.uri)
        assert answer[0] == 1
        node.doubtful.discard((kind, topic))

    def round(self):
        """One kill; how long it took until all was right."""
        while len(self.nodes) < NODES:
            self.count += 1
            self.nodes.append(Node(f"/node_{self.count}"))
        stop = threading.Event()
        thread = threading.Thread(target=self.churn, args=(stop,))
        thread.start()
        time.sleep(self.random.uniform(0.005, 0.3))
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()
        stop.set()
        thread.join()
        dead = [self.nodes.pop(self.random.randrange(len(self.nodes))) for _number in range(self.random.randrange(3))]
        for node in dead:
            node.die()
        self.start()
        began = time.monotonic()
        while (wrong := self.wrong(dead)) and time.monotonic() - began < MOST:
            time.sleep(0.01)
        if wrong:
            raise SystemExit(f"kill {self.kills}: {wrong}; log: {open(self.folder + '/log').read()[-1500:]}")
        self.mend()
        return time.monotonic() - began

    def wrong(self, dead):
        """The mistakes; empty where all is right."""
        roscore = xmlrpc.client.ServerProxy(URI)
        parts = roscore.getSystemState("/test")[2]
        held = {
            kind: {(user, topic) for topic, users in part for user in users}
            for kind, part in zip(("publisher", "subscriber"), parts)
        }
        found = []
        for kind, there in held.items():
            should = {(node.name, topic) for node in self.nodes for topic in node.has[kind]}
            unsure = {(node.name, key[1]) for node in self.nodes for key in node.doubtful if key[0] == kind}
            found += [f"lost {kind} {each}" for each in sorted(should - there - unsure)]
            found += [f"ghost {kind} {each}" for each in sorted(there - should - unsure)]
        names = {node.name for node in dead}
        found += [f"dead {name}" for name in names if roscore.lookupNode("/test", name)[0] == 1]
        tree = roscore.getParam("/test", "/parameters")
        for node in self.nodes:
            for name, value in node.parameters.items():
                kept = (tree[2] if tree[0] == 1 else {}).get(node.name[1:], {}).get(name.rpartition("/")[2])
                if kept != value and name not in node.doubtful:
                    found.append(f"parameter {name} is {kept} and not {value}")
        return found[:5]

    def mend(self):
        """Say again what is in doubt, as a node does it whose call failed."""
        roscore = xmlrpc.client.ServerProxy(URI)
        for node in self.nodes:
            for key in list(node.doubtful):
                if isinstance(key, str):
                    value = roscore.getParam(node.name, key)
                    node.parameters.pop(key, None)
                    if value[0] == 1:
                        node.parameters[key] = value[2]
                elif key[1] in node.has[key[0]]:
                    getattr(roscore, "register" + key[0].capitalize())(node.name, key[1], "x/Y", node.uri)
                else:
                    getattr(roscore, "unregister" + key[0].capitalize())(node.name, key[1], node.uri)
            node.doubtful.clear()

    def run(self, kills):
        self.start()
        try:
            times = []
            for self.kills in range(1, kills + 1):
                times.append(self.round())
        finally:
            self.process.kill()
            self.process.wait()
        shutil.rmtree(self.folder)
        times.sort()
        print(
            json.dumps(
                {
                    "kills": kills,
                    "changes": self.changes,
                    "nodes": self.count,
                    "median": round(times[len(times) // 2], 3),
                    "worst": round(times[-1], 3),
                }
            )
        )


if __name__ == "__main__":
    Test(int(sys.argv[2]) if len(sys.argv) > 2 else 1).run(int(sys.argv[1]))
