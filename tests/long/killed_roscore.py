# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The bundled roscore, killed again and again at random moments, while nodes register, unregister, set parameters and die.

    killed_roscore.py KILLS [SEED]

It starts the roscore itself, and plays most of the nodes: each tells what it has, as real ones do. A few real ones (roscpp
and rospy) live beside them. What the roscore had answered must be there after each kill, and nothing of a node that died;
it ends with one line of JSON.
"""

import json
import os
import random
import shutil
import signal
import socketserver
import struct
import subprocess
import sys
import tempfile
import threading
import time
import xmlrpc.client
import xmlrpc.server

PORT, NODES, TOPICS, SERVICES = 11399, 12, 40, 4
URI = f"http://127.0.0.1:{PORT}/"
HERE = {**os.environ, "ROS_IP": "127.0.0.1", "ROS_HOSTNAME": "127.0.0.1"}
MOST = 60.0  # seconds for all to be as it should be, on a very busy machine
KINDS = ("publisher", "subscriber", "service")
ROSCPP = ["/usr/lib/rosout/rosout"]
ROSPY = [sys.executable, os.path.join(os.path.dirname(os.path.abspath(__file__)), "sample_node.py")]


def roscore():
    return xmlrpc.client.ServerProxy(URI, allow_none=True)


class Answers(socketserver.ThreadingTCPServer):
    """The port of a node's services, which answers probes as rospy and roscpp do."""

    daemon_threads, request_queue_size = True, 64

    def __init__(self, node):
        super().__init__(("127.0.0.1", 0), Probe)
        self.node = node


class Probe(socketserver.BaseRequestHandler):
    """One connection: the header says which service, the answer says whose it is."""

    def handle(self):
        (size,) = struct.unpack("<I", self.request.recv(4, 0x100))  # MSG_WAITALL
        head, fields = self.request.recv(size, 0x100), {}
        while head:
            (size,) = struct.unpack_from("<I", head)
            name, _equals, value = head[4 : 4 + size].decode().partition("=")
            fields[name], head = value, head[4 + size :]
        node = self.server.node
        known = fields["service"] in node.has["service"]
        answer = (f"callerid={node.name}" if known else "error=no such service").encode()
        self.request.sendall(struct.pack("<II", len(answer) + 4, len(answer)) + answer)


class Node:
    """A node: what it has, and the servers that tell so."""

    def __init__(self, name):
        self.name, self.has, self.hears = name, {kind: set() for kind in KINDS}, set()
        self.parameters, self.doubtful, self.told = {}, set(), {}
        self.server = xmlrpc.server.SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False, allow_none=True)
        self.answers = Answers(self)
        self.uri = "http://127.0.0.1:%d/" % self.server.server_address[1]
        self.rosrpc = "rosrpc://127.0.0.1:%d" % self.answers.server_address[1]
        self.server.register_function(lambda _caller: [1, "", os.getpid()], "getPid")
        for kind, method in (("publisher", "getPublications"), ("subscriber", "getSubscriptions")):
            self.server.register_function(
                lambda _c, kind=kind: [1, "", [[t, "x/Y"] for t in sorted(self.has[kind])]], method
            )
        self.server.register_function(lambda *_arguments: [1, "", 0], "publisherUpdate")
        self.server.register_function(self.hear, "paramUpdate")
        for server in (self.server, self.answers):
            threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True).start()

    def hear(self, _caller, name, value):
        self.told[name.rstrip("/")] = value
        return [1, "", 0]

    def die(self):
        for server in (self.server, self.answers):
            server.shutdown()
            server.server_close()


class Real:
    """A real node, and the parameter /NAME/word that the rospy one listens to."""

    def __init__(self, name, command, folder):
        self.name, self.output = f"/{name}", f"{folder}/{name}.out"
        self.hears = command is ROSPY
        environment = {**HERE, "ROS_MASTER_URI": URI, "ROS_LOG_DIR": folder}
        words = [name] if self.hears else [f"__name:={name}"]
        with open(self.output, "wb") as output:
            self.process = subprocess.Popen([*command, *words], env=environment, stdout=output, stderr=output)

    def has(self):
        """The registrations that the node itself names, by kind; None while it is not there yet."""
        uri = roscore().lookupNode("/test", self.name)
        if uri[0] != 1:
            return None
        node = xmlrpc.client.ServerProxy(uri[2])
        publishes, subscribes = node.getPublications("/test")[2], node.getSubscriptions("/test")[2]
        return {
            "publisher": {topic for topic, _type in publishes},
            "subscriber": {topic for topic, _type in subscribes},
            "service": {f"{self.name}/get_loggers"},
        }

    def heard(self, word):
        with open(self.output, encoding="utf-8") as output:
            return not self.hears or f"word {word}\n" in output.read()

    def die(self):
        self.process.kill()
        self.process.wait()


class Test:
    """The roscore and its nodes."""

    def __init__(self, seed):
        self.random = random.Random(seed)
        self.folder = tempfile.mkdtemp(prefix="roscore-")
        self.count, self.changes, self.kills = 0, 0, 0
        self.nodes, self.real = [], []
        self.process = None
        self.change = {
            "publisher": self.change_topic,
            "subscriber": self.change_topic,
            "service": self.change_service,
            "parameter": self.change_parameter,
            "listener": self.change_listener,
        }

    def start(self):
        command = [sys.executable, "-m", "rosfleet_multimaster.roscore", "-p", str(PORT), "--no-rosout", "--store"]
        environment = {**HERE, "PATH": "/nowhere"}  # without rosversion
        with open(self.folder + "/log", "ab") as log:
            self.process = subprocess.Popen([*command, self.folder], env=environment, stderr=log)
        time.sleep(0.05)  # what the one before had sent has arrived, and this one is not there yet
        for node in self.nodes:
            node.told.clear()
        until = time.monotonic() + MOST
        while time.monotonic() < until:
            try:
                return roscore().getPid("/test")
            except OSError:
                time.sleep(0.01)
        raise SystemExit("the roscore does not start: " + self.log())

    def log(self):
        with open(self.folder + "/log", encoding="utf-8") as log:
            return log.read()[-2000:]

    # Changes

    def churn(self, stop):
        """Change something until the roscore is gone. What had no answer is in doubt."""
        caller = roscore()
        while not stop.is_set():
            node, kind = self.random.choice(self.nodes), self.random.choice(sorted(self.change))
            try:
                self.change[kind](caller, node, kind)
            except (OSError, xmlrpc.client.Error):
                return
            self.changes += 1

    def change_parameter(self, caller, node, _kind):
        name, value = f"/parameters{node.name}/p{self.random.randrange(5)}", self.random.randrange(10**6)
        node.doubtful.add(("parameter", name))
        assert caller.setParam(node.name, name, value)[0] == 1
        node.parameters[name] = value
        node.doubtful.discard(("parameter", name))

    def change_topic(self, caller, node, kind):
        self.turn(caller, node, kind, f"/topic_{self.random.randrange(TOPICS)}")

    def change_service(self, caller, node, kind):
        self.turn(caller, node, kind, f"{node.name}/serve_{self.random.randrange(SERVICES)}")

    def change_listener(self, caller, node, kind):
        other = self.random.choice(self.nodes)
        self.turn(caller, node, kind, f"/parameters{other.name}/p{self.random.randrange(5)}")

    def turn(self, caller, node, kind, name):
        """Register or unregister. The node has a thing before it registers it, and not any more before it unregisters."""
        held = node.hears if kind == "listener" else node.has[kind]
        node.doubtful.add((kind, name))
        there = name not in held
        (held.add if there else held.discard)(name)
        assert self.call(caller, node, kind, name, there)[0] == 1
        node.doubtful.discard((kind, name))

    def call(self, caller, node, kind, name, there):
        """Tell the roscore that a node has something, or has it no more."""
        if kind == "listener":
            return (caller.subscribeParam if there else caller.unsubscribeParam)(node.name, node.uri, name)
        method = getattr(caller, ("register" if there else "unregister") + kind.capitalize())
        if kind == "service":
            return method(node.name, name, node.rosrpc, *([node.uri] if there else []))
        return method(node.name, name, *(["x/Y"] if there else []), node.uri)

    # A kill

    def round(self):
        """One kill; how long it took from there until all was right, and until the first answer."""
        self.complete()
        stop = threading.Event()
        thread = threading.Thread(target=self.churn, args=(stop,))
        thread.start()
        time.sleep(self.random.uniform(0.005, 0.3))
        killed = time.monotonic()
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()
        stop.set()
        thread.join()
        dead = [self.nodes.pop(self.random.randrange(len(self.nodes))) for _number in range(self.random.randrange(3))]
        if self.random.random() < 0.1:
            dead.append(self.real.pop(self.random.randrange(len(self.real))))
        for node in dead:
            node.die()
        self.start()
        answered = time.monotonic() - killed
        self.until_right(lambda: self.wrong(dead))
        took = time.monotonic() - killed
        for node in self.real:
            roscore().setParam("/test", f"{node.name}/word", f"of kill {self.kills}")
            self.until_right(lambda node=node: [] if node.heard(f"of kill {self.kills}") else [f"{node.name} is deaf"])
        self.mend()
        return took, answered

    def complete(self):
        """Have new nodes in the place of those that died."""
        while len(self.nodes) < NODES:
            self.count += 1
            self.nodes.append(Node(f"/node_{self.count}"))
        while len(self.real) < 3:
            self.count += 1
            if any(node.hears for node in self.real):
                self.real.append(Real(f"roscpp_{self.count}", ROSCPP, self.folder))
            else:
                self.real.insert(0, Real(f"rospy_{self.count}", ROSPY, self.folder))
        self.until_right(lambda: [node.name for node in self.real if not self.there(node)])

    def there(self, node):
        """True where a real node has registered everything."""
        listed = {name for name, _users in roscore().getSystemState("/test")[2][2]}
        return f"{node.name}/get_loggers" in listed and (not node.hears or node.heard("first"))

    def until_right(self, wrong):
        until = time.monotonic() + MOST
        while found := wrong():
            if time.monotonic() > until:
                raise SystemExit(f"kill {self.kills}: {found}; log: {self.log()}")
            time.sleep(0.01)

    def wrong(self, dead):
        """The mistakes; empty where all is right."""
        caller = roscore()
        parts = caller.getSystemState("/test")[2]
        held = {kind: {(user, name) for name, users in part for user in users} for kind, part in zip(KINDS, parts)}
        should = {kind: {(node.name, name) for node in self.nodes for name in node.has[kind]} for kind in KINDS}
        unsure = {(kind, node.name, name) for node in self.nodes for kind, name in node.doubtful}
        more = {node.name for node in self.real}  # they have more services than are known here
        for node in self.real:
            for kind, names in (node.has() or {"service": {"nothing"}}).items():
                should[kind] |= {(node.name, name) for name in names}
        found = []
        for kind in KINDS:
            sure = {each for each in should[kind] ^ held[kind] if (kind, *each) not in unsure}
            found += [f"lost {kind} {each}" for each in sorted(sure & should[kind])]
            found += [
                f"ghost {kind} {each}" for each in sorted(sure & held[kind]) if kind != "service" or each[0] not in more
            ]
        found += [f"dead {node.name}" for node in dead if caller.lookupNode("/test", node.name)[0] == 1]
        return (found + self.wrong_parameters(caller, unsure))[:5]

    def wrong_parameters(self, caller, unsure):
        """Mistakes of values, and of who is told of them."""
        found = []
        tree = caller.getParam("/test", "/parameters")
        kept = {
            f"/parameters/{node}/{name}": value
            for node, values in (tree[2] if tree[0] == 1 else {}).items()
            for name, value in values.items()
        }
        for node in self.nodes:
            for name, value in node.parameters.items():
                if kept.get(name) != value and ("parameter", node.name, name) not in unsure:
                    found.append(f"parameter {name} is {kept.get(name)} and not {value}")
            told = dict(node.told)
            for name in (node.hears ^ set(told)) | {name for name in told if told[name] != kept.get(name, {})}:
                if ("listener", node.name, name) not in unsure:
                    found.append(f"{node.name} is told {told.get(name)} of {name}, which is {kept.get(name)}")
        return found

    def mend(self):
        """Say again what is in doubt, as a node does it whose call failed."""
        caller = roscore()
        for node in self.nodes:
            for kind, name in list(node.doubtful):
                if kind == "parameter":
                    value = caller.getParam(node.name, name)
                    node.parameters.pop(name, None)
                    if value[0] == 1:
                        node.parameters[name] = value[2]
                else:
                    held = node.hears if kind == "listener" else node.has[kind]
                    self.call(caller, node, kind, name, name in held)
            node.doubtful.clear()

    def run(self, kills):
        times = []
        self.start()
        try:
            for self.kills in range(1, kills + 1):
                times.append(self.round())
        finally:
            self.process.kill()
            self.process.wait()
            for node in self.real:
                node.die()
        shutil.rmtree(self.folder)
        found = {"kills": kills, "changes": self.changes, "nodes": self.count}
        values = {"": times, "_answer": [(answered,) for _took, answered in times]}
        values["_after_the_answer"] = [(took - answered,) for took, answered in times]
        for name, each in values.items():
            ordered = sorted(value[0] for value in each)
            found["median" + name], found["worst" + name] = (round(ordered[at], 3) for at in (len(ordered) // 2, -1))
        print(json.dumps(found))


if __name__ == "__main__":
    Test(int(sys.argv[2]) if len(sys.argv) > 2 else 1).run(int(sys.argv[1]))
