# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""A node as a process, a robot that costs it time, and a friend: `running_attacks.py NODE SEED COUNT FOLDER`.

It is called in a new network namespace, and prints, for each request: what was drawn, how long it is, whether the friend was
answered during and after it, the seconds of a processor that the node took for all of that, and what was answered to it.
"""

import contextlib
import http.client
import json
import os
import pathlib
import random
import socket
import subprocess
import sys
import threading
import time
import xmlrpc.client
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import hostile_inputs
from running_sync import Roscore, serve

HERE = pathlib.Path(__file__).parent
WALL = 20.0  # seconds
OWN, BAD, FRIEND = "127.0.0.1", "127.0.0.2", "127.0.0.3"
#: The roscore takes all of 127.0.0.0/8 for its own computer.
ROSCORE, ROSCORE_BAD, ROSCORE_FRIEND = "192.168.1.1", "192.168.1.2", "192.168.1.3"
PORT = 11611
COMMON = {"strangers": "allow"}
CHANNEL = {
    "whole": [],
    "topics": ["/*"],
    "services": ["/*"],
    "back": [],
    "base": "",
    "frames": "",
    "world": "",
    "root": "",
}
PROGRAMS = {
    "discovery": ("master_discovery", {"interface": OWN, "rpc_port": PORT}),
    "sync": ("master_sync", {}),
    "relay": (
        "master_relay",
        {
            "robot": "own",
            "port": PORT,
            "diagnostics": False,
            "channels": [
                {**CHANNEL, "peer": name, "hosts": [host], "port": 9, "as": f"/{name}", "inner": False, "rate": 0, "newest": False}
                for name, host in (("bad", BAD), ("friend", FRIEND))
            ],
        },
    ),
}  # fmt: skip
EVERYTHING = [False, *[""] * 10]
ORDINARY = {
    "discovery": ("masterInfoFiltered", EVERYTHING),
    "relay": ("rosfleetOffers", "friend", "", 0.0),
    "roscore": ("getSystemState", "/friend"),
}


class Node:
    """The process."""

    def __init__(self, name, folder, **environment):
        words, module = [], "roscore.__main__"
        if name == "roscore":
            words = ["--port", str(PORT), "--store", str(folder / "store"), "--no-rosout"]
        else:
            module, values = PROGRAMS[name]
            (folder / "parameters.json").write_text(json.dumps(values))
            words = ["--parameters", str(folder / "parameters.json")]
        self.log = folder / "log"
        with self.log.open("wb") as log:
            command = [sys.executable, str(HERE / "played_node.py"), module, *words]
            self.process = subprocess.Popen(command, env={**os.environ, **environment}, stdout=log, stderr=log)

    def spent(self):
        """The seconds of a processor that it took, with those of its threads that have ended. (schedstat is of one thread.)"""
        words = pathlib.Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")

    def end(self):
        ended = self.process.poll()
        self.process.kill()
        self.process.wait()
        assert ended is None, "the node lives"


def until(condition, what, seconds=WALL):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, what
        time.sleep(0.01)


class Server:
    """A node that is called."""

    def __init__(self, name, folder):
        self.name, self.roscore = name, Roscore()
        self.roscore.register("registerPublisher", "/talker", "/chatter", "std_msgs/String", "http://127.0.0.1:7/")
        self.at, self.bad, self.friend = OWN, BAD, FRIEND
        if name == "roscore":
            self.at, self.bad, self.friend = ROSCORE, ROSCORE_BAD, ROSCORE_FRIEND
        self.node = Node(name, folder, ROS_MASTER_URI=self.roscore.uri, ROS_IP=self.at)

    def start(self):
        until(self.answers, "it answers at the start")

    def draw(self, rng, cost):
        return hostile_inputs.costly(rng, self.name, [cost])

    @contextlib.contextmanager
    def attack(self, body):
        """Send a request, and wait for its answer when the friend has his."""
        with socket.create_connection((self.at, PORT), WALL, (self.bad, 0)) as connection:
            head = f"POST /RPC2 HTTP/1.0\r\nContent-Length: {len(body)}\r\n\r\n".encode()
            with contextlib.suppress(OSError):  # it has answered before it has read everything
                connection.sendall(head + body)
            yield
            answer = b""
            with contextlib.suppress(OSError):
                while part := connection.recv(65536):
                    answer += part
            self.told = answer[9:12].decode() or "nothing"

    def answers(self):
        """Return True if a friend has an answer."""
        connection = http.client.HTTPConnection(self.at, PORT, timeout=WALL, source_address=(self.friend, 0))
        method, *arguments = ORDINARY[self.name]
        try:
            connection.request("POST", "/RPC2", xmlrpc.client.dumps(tuple(arguments), method))
            xmlrpc.client.loads(connection.getresponse().read())
            return True
        except (OSError, http.client.HTTPException, xmlrpc.client.Error):
            return False
        finally:
            connection.close()


class Asking:
    """A sync, which is answered: by the discovery of a friend, and by one that draws its answers."""

    def __init__(self, _name, folder):
        self.roscore, self.topics, self.stamp, self.body, self.fetched = Roscore(), [], 1.0, b"", threading.Event()
        self.announced, self.told = {}, ""
        for address, answer in ((BAD, lambda: self.body), (FRIEND, self.tell)):
            self.serve(address, answer)
            self.announce(address)
        _server, uri = serve({"list": lambda: list(self.announced.values())})
        self.node = Node("sync", folder, ROS_MASTER_URI=self.roscore.uri, ROS_IP=OWN, DISCOVERY=uri)
        self.roscore.call("registerPublisher", "/master_discovery", "/master_discovery/changes", "x/MasterState", uri)
        self.roscore.call(
            "registerService", "/master_discovery", "/master_discovery/list_masters", "rosrpc://own:2", uri
        )

    def start(self):
        until(self.answers, "a topic of the friend comes at the start")

    def serve(self, address, answer):
        asking = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self):
                self.rfile.read(int(self.headers["Content-Length"]))
                body = answer()
                self.send_response(200)
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                with contextlib.suppress(OSError):
                    self.wfile.write(body)
                if address == BAD:
                    asking.fetched.set()

            def log_message(self, *_what):
                pass

        server = ThreadingHTTPServer((address, PORT), Handler)
        threading.Thread(target=server.serve_forever, daemon=True).start()

    def announce(self, address):
        self.stamp += 1
        name, uri = ("bad", f"http://{BAD}:11311/") if address == BAD else ("friend", f"http://{FRIEND}:11311/")
        fields = (name, uri, f"http://{address}:{PORT}", "/master_discovery", self.stamp, self.stamp, True)
        self.announced[address] = fields

    def tell(self):
        """The state of the friend."""
        uri, stamp = f"http://{FRIEND}:11311/", f"{self.stamp:.9f}"
        tables = [[[topic, ["/talker"]] for topic in self.topics], [], []]
        node = ["/talker", f"http://{FRIEND}:5000/", uri, None, "local"]
        types = [[topic, "std_msgs/String"] for topic in self.topics]
        state = [stamp, stamp, uri, "friend", *tables, types, [node], []]
        return xmlrpc.client.dumps((state,), methodresponse=True, allow_none=True).encode()

    def draw(self, rng, cost):
        return hostile_inputs.costly_answer(rng, f"http://{BAD}:11311/", [cost])

    @contextlib.contextmanager
    def attack(self, body):
        """Announce something, and answer the question for it."""
        self.body = body
        self.fetched.clear()
        self.announce(BAD)
        assert self.fetched.wait(WALL), "it asks"
        yield

    def answers(self):
        """Return True if a new topic of the friend comes."""
        self.topics.append(f"/topic_{len(self.topics)}")
        self.announce(FRIEND)
        deadline = time.monotonic() + WALL
        while time.monotonic() < deadline:
            if self.roscore.tables["Publisher"].get(self.topics[-1]):
                return True
            time.sleep(0.01)
        return False


def main():
    """Attack, one request after the other."""
    name, seed, count, folder = sys.argv[1:]
    addresses = [f"address add {address}/32 dev lo" for address in (ROSCORE, ROSCORE_BAD, ROSCORE_FRIEND)]
    subprocess.run(["ip", "-batch", "-"], input="\n".join(["link set lo up", *addresses]), text=True, check=True)
    victim = (Asking if name == "sync" else Server)(name, pathlib.Path(folder))
    try:
        victim.start()
        found = [attack(victim, f"{seed} {name}", number) for number in range(int(count))]
    finally:
        victim.node.end()
    print(json.dumps(found))


def attack(victim, seed, number):
    """Attack once."""
    cost = hostile_inputs.COSTS[number % len(hostile_inputs.COSTS)]
    body, before = victim.draw(random.Random(f"{seed} {number}"), cost), victim.node.spent()
    with victim.attack(body):
        meanwhile = victim.answers()
    answered = meanwhile and victim.answers()
    took = round(victim.node.spent() - before, 2)
    return [number, cost.__name__, len(body), answered, took, victim.told]


if __name__ == "__main__":
    main()
