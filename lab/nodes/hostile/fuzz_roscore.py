# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Calls that any program may make to a roscore, out of a seed: any method, any value, any bytes; and kill -9 in between.

    fuzz_roscore.py CALLS [SEED]      (with hostile_inputs.py)

It starts the roscore itself. A third of the callers are strangers, who come by another address than the loopback, a third are local
users without rights, a third are of root. After each kill the roscore must answer within START seconds, the nodes that live must be
registered, and its file, its memory and its threads must be within the bounds of roles/nodes/DESIGN.md. It ends with one line of JSON.
"""

import collections
import contextlib
import json
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import xmlrpc.client
import xmlrpc.server

from hostile_inputs import MIB, break_bytes, laughs, request_of, some_bytes

PORT, START, ALIVE, HEARD = 11398, 5.0, 4, "/alive/heard"
URI = f"http://127.0.0.1:{PORT}/"
MEMORY, FILE = 1024 * MIB, 600 * MIB  # MemoryMax of the unit, and the limit of the file by roles/nodes/DESIGN.md
USER = 65534  # nobody
METHODS = """registerPublisher registerSubscriber registerService unregisterPublisher unregisterSubscriber unregisterService subscribeParam
unsubscribeParam setParam setParam setParam deleteParam getParam getParamNames hasParam searchParam lookupNode lookupService getSystemState
getTopicTypes getPublishedTopics getUri getPid rosfleetChanges rosfleetTogether list_processes get_pid get_node_names system.listMethods
system.methodHelp system.methodSignature system.multicall param_update_task _dispatch __init__ answer call done reg_manager.nodes unknown""".split()
REGISTER = {
    "registerPublisher": 4,
    "registerSubscriber": 4,
    "registerService": 4,
    "subscribeParam": 3,
    "setParam": 3,
    "deleteParam": 2,
}
NAMES = """/ // ~ ~x x /x /x/y /x/y/z /rosfleet_multimaster /rosfleet_multimaster/imports rosfleet_multimaster/imports /do_not_sync /use_sim_time
/run_id /fleet/a /fleet/b /topic /chatter /tf /rosout /master_sync /\u00fc /\U0001f916 a:b a\tb""".split(" ")
URIS = [
    "http://127.0.0.1:9/",
    "http://192.0.2.1:1234/",
    "http://[",
    "http://",
    "rosrpc://127.0.0.1:9",
    "http://x:y:z/",
    "http://%00:1/",
    "ftp://x",
]


# Values, as XML


def name(rng):
    kind = rng.random()
    if kind < 0.85:
        return rng.choice(NAMES)
    if kind < 0.95:
        return "/".join(rng.choice(NAMES) for _part in range(rng.randrange(1, 40)))
    return "/" + "n" * rng.choice([100, 511, 512, 513, 5000, 70000])


def escape(text):
    return (
        "".join(letter if letter >= " " or letter in "\t\n\r" else "?" for letter in text)
        .replace("&", "&amp;")
        .replace("<", "&lt;")
    )


def leaf(rng):
    kind = rng.randrange(16)
    text = [
        lambda: f"<int>{rng.choice([0, 1, -1, 2**31, -(2**31) - 1, 10**399, 10**401, rng.randrange(10**6)])}</int>",
        lambda: f"<i8>{rng.randrange(-(2**63), 2**63)}</i8>",
        lambda: f"<ex:i1>{rng.randrange(300)}</ex:i1>",
        lambda: f"<ex:biginteger>{10 ** rng.randrange(500)}</ex:biginteger>",
        lambda: f"<ex:bigdecimal>{rng.choice(['1.5', '1e999999', 'NaN', '-0', 'x'])}</ex:bigdecimal>",
        lambda: f"<double>{rng.choice(['1.5', 'nan', 'inf', '-inf', '1e400', '1_0', 'x', ''])}</double>",
        lambda: f"<boolean>{rng.choice(['0', '1', '2', 'true'])}</boolean>",
        lambda: "<nil/>",
        lambda: "<ex:nil/>",
        lambda: f"<base64>{rng.choice(['', 'AAECAw==', '====', 'x', 'AAAA' * rng.randrange(5000)])}</base64>",
        lambda: (
            f"<dateTime.iso8601>{rng.choice(['20260101T00:00:00', '', 'x', '&lt;/value&gt;', '20260101T00:00:00Z'])}</dateTime.iso8601>"
        ),
        lambda: f"<string>{escape(rng.choice(URIS + NAMES))}</string>",
        lambda: f"<string>{escape(chr(rng.randrange(32, 0xD7FF)) * rng.randrange(200))}</string>",
        lambda: escape(
            rng.choice(["", "[" * rng.randrange(100000), "&<>" * rng.randrange(3000), '{"imports": {}}', "a" * 300])
        ),
        lambda: (
            f"<{rng.choice(['strange', 'value', 'param', 'name', 'member', 'data'])}>x</{rng.choice(['strange', 'value', 'param'])}>"
        ),
        lambda: "<float>1</float>",
    ][kind]()
    return f"<value>{text}</value>"


def value(rng, depth=0):
    kind = rng.random()
    if depth > 6 or kind < 0.6:
        return leaf(rng)
    if kind < 0.75:
        return "<value><array><data>%s</data></array></value>" % "".join(
            value(rng, depth + 1) for _part in range(rng.randrange(5))
        )
    if kind < 0.92:
        return make_struct(rng, depth)
    return deep(rng)


def make_struct(rng, depth):
    members = "".join(
        f"<member><name>{escape(key(rng))}</name>{value(rng, depth + 1)}</member>" for _part in range(rng.randrange(6))
    )
    if rng.random() < 0.03:
        members += rng.choice(["<member>" + leaf(rng) + leaf(rng) + "</member>", "<member><name>x</name></member>"])
    return f"<value><struct>{members}</struct></value>"


def key(rng):
    return rng.choice(
        ["a", "b", "x", "", "/", "a/b", "~", "imports", "rosfleet_multimaster", "do_not_sync", "k" * 600, "\u00fc"]
    )


def deep(rng):
    levels = rng.choice([5, 20, 30, 33, 34, 70, 300, 990, 3000])
    inner = leaf(rng) if levels < 70 else "<value>1</value>"
    if rng.random() < 0.5:
        return "<value><array><data>" * levels + inner + "</data></array></value>" * levels
    return "<value><struct><member><name>a</name>" * levels + inner + "</member></struct></value>" * levels


def large(rng):
    """A value of many bytes: a text, or many small ones."""
    size = int(10 ** rng.uniform(4, 7.3))  # up to 20 MB
    kind = rng.randrange(7)
    if kind == 0:
        return "<value><array><data>%s</data></array></value>" % ("<value/>" * (size // 8))
    if kind == 1:
        return "<value><array><data>%s</data></array></value>" % ("<value><struct/></value>" * (size // 25))
    if kind == 2:
        members = "".join(
            f"<member><name>k{number}</name><value><int>{number}</int></value></member>" for number in range(size // 60)
        )
        return f"<value><struct>{members}</struct></value>"
    text = {3: "x", 4: "&lt;", 5: "\U0001f916", 6: '"'}[kind]
    return f"<value>{text * (size // len(text.encode()))}</value>"


def string(text):
    return f"<value><string>{escape(text)}</string></value>"


# Calls


def arguments(rng, method, own):
    """Arguments: often fitting ones, sometimes anything."""
    if rng.random() < 0.15:
        return "".join(value(rng) for _part in range(rng.randrange(6)))
    caller, thing = (
        string(rng.choice(["/a", "/b", "/rosfleet_multimaster", "x", "", "/a/b", name(rng)])),
        string(name(rng)),
    )
    uri, kind = string(rng.choice(URIS)), string(rng.choice(["std_msgs/String", "*", "x", "a/b/c", "t" * 600 + "/x"]))
    if method == "setParam":
        return caller + thing + (large(rng) if rng.random() < 0.15 else value(rng))
    if method == "rosfleetChanges":
        return (
            caller
            + string("x")
            + "<value><int>0</int></value><value><int>0</int></value>"
            + rng.choice(["", "<value><boolean>1</boolean></value>"])
        )
    if method == "rosfleetTogether":
        return caller + "<value><array><data>%s</data></array></value>" % string(together(rng))
    if method == "system.multicall":
        return multicall(rng, own)
    if method in ("subscribeParam", "unsubscribeParam"):
        return caller + uri + thing
    if method in ("registerPublisher", "registerSubscriber"):
        return caller + thing + kind + uri
    if method in ("registerService", "unregisterPublisher", "unregisterSubscriber", "unregisterService"):
        return caller + thing + uri + (uri if method == "registerService" else "")
    return caller + (thing if rng.random() < 0.7 else "")


def together(rng):
    special = {"\0special": [rng.choice(["Binary", "ServerProxy", "DateTime"]), "AAAA"]}
    things = [special, "\ud800", "\0", 1e308, 10**600, None, [[]], {"a": special}, "x", True, {"": {"": 1}}]
    calls = [
        [rng.choice(METHODS), "/a", name(rng), rng.choice(things), *rng.sample(URIS, rng.randrange(3))]
        for _call in range(rng.randrange(6))
    ]
    text = json.dumps(calls)
    return rng.choice(
        [text, text, text, text[: len(text) // 2], "[" * 50000, "{}", "[1]", "[[]]", "[[[]]]", "1" * 6000]
    )


def multicall(rng, own, depth=0):
    calls = []
    for _call in range(rng.choice([0, 1, 3, 3, 50])):
        method = rng.choice(METHODS)
        if method == "system.multicall":
            given = multicall(rng, own, depth + 1) if depth < 3 else ""
        else:
            given = arguments(rng, method, own) if rng.random() < 0.9 else ""
        params = f"<value><array><data>{given}</data></array></value>"
        calls.append(
            f"<value><struct><member><name>methodName</name>{string(method)}</member><member><name>params</name>{params}</member></struct></value>"
        )
    if rng.random() < 0.1:
        calls.append(value(rng))
    return "<value><array><data>%s</data></array></value>" % "".join(calls)


def document(rng, own):
    method = (
        rng.choice(METHODS)
        if rng.random() < 0.97
        else escape(rng.choice(["", "\n", "x" * 70000, "system.", "a.b.c", "\u00fc"]))
    )
    given = arguments(rng, method, own)
    params = given.replace("</value><value>", "</value></param><param><value>") if rng.random() < 0.1 else split(given)
    return f"<?xml version='1.0'?><methodCall><methodName>{method}</methodName><params>{params}</params></methodCall>".encode()


def split(given):
    """Each value of the first level in a parameter of its own: the reader takes them without, too."""
    return f"<param>{given}</param>"


def request(rng, own):
    """The bytes of one request; now and then bytes that are no request."""
    body = document(rng, own)
    kind = rng.random()
    if kind < 0.12:
        body = break_bytes(rng, body)
    elif kind < 0.14:
        body = rng.choice([laughs(rng), some_bytes(rng, 500), b"", b"<" * 200000, b"<a " + b"x" * 300000])
    elif kind < 0.145:
        body = b"x" * rng.choice([33 * MIB, 40 * MIB])
    return request_of(rng, body, packed=40)


def judge_answer(data):
    """The kind of the answer."""
    if not data:
        return "nothing"
    if b" 200 " not in data[:20]:
        return "http"
    if b"<fault>" in data[:2000]:
        return "fault"
    if b"gzip" in data[:400]:
        return "packed"
    return "refused" if b"more than the roscore takes" in data or b"alone</string>" in data else "answer"


class Node:
    """A node that lives: it names its topics, and notes its updates."""

    def __init__(self, number):
        self.name, self.topic, self.updates = f"/alive_{number}", f"/alive/topic_{number}", []
        self.server = xmlrpc.server.SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False, allow_none=True)
        self.uri = "http://127.0.0.1:%d/" % self.server.server_address[1]
        for method, function in (
            ("getPid", lambda _caller: [1, "", 1]),
            ("getPublications", lambda _caller: [1, "", [[self.topic, "x/Y"]]]),
            ("getSubscriptions", lambda _caller: [1, "", [[HEARD, "x/Y"]]]),
            ("publisherUpdate", lambda _caller, _topic, uris: self.updates.append(uris) or [1, "", 0]),
        ):
            self.server.register_function(function, method)
        threading.Thread(target=self.server.serve_forever, kwargs={"poll_interval": 0.2}, daemon=True).start()


class Test:
    """The roscore, those who call it, and the figures."""

    def __init__(self, calls, seed):
        self.calls, self.seed, self.folder = calls, seed, tempfile.mkdtemp(prefix="roscore-")
        self.random = random.Random(seed)
        self.counts, self.figures = collections.Counter(), collections.Counter()
        self.numbers = iter(range(calls))
        self.left, self.lock = calls, threading.Lock()
        self.stranger = stranger_address()
        self.nodes = [Node(number) for number in range(ALIVE)]
        self.process = None

    def start(self):
        """Start the roscore; it must answer in time, and know the nodes that live."""
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
        environment = {**os.environ, "PATH": "/nowhere", "ROS_HOSTNAME": "127.0.0.1", "ROS_IP": "127.0.0.1"}
        with open(self.folder + "/log", "ab") as log:
            self.process = subprocess.Popen(command, env=environment, stdout=log, stderr=log)
        began = time.monotonic()
        while True:
            try:
                ask().getPid("/test")
                break
            except OSError:
                if self.process.poll() is not None:
                    raise SystemExit(f"call {self.calls - self.left}: it has ended by itself: {self.log()}") from None
                if time.monotonic() - began > START * self.slack():
                    raise SystemExit(f"no answer {START} s after its start: {self.log()}") from None
                time.sleep(0.02)
        took = int(1000 * (time.monotonic() - began))
        self.figures["slowest start, ms"] = max(self.figures["slowest start, ms"], took)

    def slack(self):
        """The factor by which all may take longer, since others work on this machine."""
        return max(1.0, os.getloadavg()[0] / max(1, os.cpu_count() or 1))

    def register(self):
        for node in self.nodes:
            assert ask().registerPublisher(node.name, node.topic, "x/Y", node.uri)[0] == 1, self.log()
            assert ask().registerSubscriber(node.name, HEARD, "x/Y", node.uri)[0] == 1, self.log()

    def log(self, most=3000):
        with open(self.folder + "/log", encoding="utf-8", errors="replace") as log:
            return log.read()[-most:]

    def look(self, why):
        """Compare the present state with the stated one."""
        self.know(why)
        self.threads_work(why)
        status = dict(line.split(":", 1) for line in open(f"/proc/{self.process.pid}/status", encoding="ascii"))
        memory = int(status["VmHWM"].split()[0]) * 1024
        files = []
        for name in set(os.listdir(self.folder)) - {"log"}:
            with contextlib.suppress(FileNotFoundError):  # a draft that the roscore has renamed meanwhile
                files.append(os.path.getsize(f"{self.folder}/{name}"))
        self.figures["most memory, MB"] = max(self.figures["most memory, MB"], memory // 10**6)
        self.figures["largest file, MB"] = max(self.figures["largest file, MB"], max(files, default=0) // 10**6)
        assert memory < MEMORY, f"{memory} bytes of memory"
        assert max(files, default=0) < FILE, f"{files} bytes"
        assert self.process.poll() is None, self.log()

    def know(self, why):
        """The nodes that live are registered."""
        for node in self.nodes:
            found = ask().lookupNode("/test", node.name)
            assert found[:1] == [1] and found[2] == node.uri, f"{why}: {node.name} is lost: {found}: {self.log()}"

    def threads_work(self, why):
        """A registration of now is in the file soon, and its subscribers are notified: no thread has ended."""
        mark = f"/mark_{self.random.randrange(10**9)}"
        uri = f"http://127.0.0.1:9{mark}"
        assert ask().registerPublisher(mark, HEARD, "x/Y", uri)[0] == 1, self.log()
        until = time.monotonic() + 20 * self.slack()
        while mark.encode() not in tail(self.folder + "/registrations"):
            assert time.monotonic() < until, f"{why}: nothing is stored any more: {self.log()}"
            time.sleep(0.1)
        while not all(any(uri in uris for uris in node.updates) for node in self.nodes):
            assert time.monotonic() < until, f"{why}: subscribers are not notified: {self.log()}"
            time.sleep(0.1)
        ask().unregisterPublisher(mark, HEARD, uri)

    def work(self, who):
        """Make calls, as a stranger, a local user or root."""
        while True:
            with self.lock:
                number = next(self.numbers, None)
            if number is None:
                return
            rng = random.Random(f"{self.seed} {number}")
            answer = judge_answer(
                send(request(rng, who != "stranger"), self.stranger if who == "stranger" else "127.0.0.1", rng)
            )
            with self.lock:
                self.left -= 1
                self.counts[f"{who}: {answer}"] += 1

    def end(self, kill):
        """End the roscore: killed, or by a call that any program may make."""
        if kill % 2:
            self.process.kill()
        else:
            ask().shutdown("/stranger", "line\nbreak")
        self.process.wait(20)

    def run(self, kills):
        try:
            self.try_all(kills)
        finally:
            self.process.kill()
            self.process.wait()
        shutil.rmtree(self.folder)

    def try_all(self, kills):
        began = time.monotonic()
        self.start()
        self.register()
        callers = [threading.Thread(target=self.work, args=(who,)) for who in ("root", "stranger") * 2]
        for caller in callers:
            caller.start()
        words = [sys.executable, __file__, "user", str(self.calls // 4), str(self.seed)]
        users = [subprocess.Popen([*words, str(number)], stdout=subprocess.PIPE) for number in range(2)]
        for kill in range(1, kills + 1):
            while self.left > self.calls * (kills + 1 - kill) // (kills + 1):
                time.sleep(0.05)
                if self.process.poll() is not None:
                    raise SystemExit(f"it has ended by itself, {self.process.returncode}: {self.log()}")
            self.look(f"before end {kill}")
            self.end(kill)
            self.start()
            self.know(f"after end {kill}")
        for caller in callers:
            caller.join()
        for user in users:
            self.counts.update(json.loads(user.communicate()[0]))
        self.look("at the end")
        self.forget()
        self.figures["lines of the log"] = self.log(10**9).count("\n")
        for word in ("Traceback", "damaged"):
            assert word not in self.log(10**9), [line for line in self.log(10**9).splitlines() if word in line]
        refused = sum(count for kind, count in self.counts.items() if kind.endswith("refused"))
        found = {"calls": sum(self.counts.values()), "refused": refused, "ends": kills, **self.figures}
        print(json.dumps({**found, "seconds": int(time.monotonic() - began), **self.counts}))

    def forget(self):
        """SIGUSR1 heals, whatever it knew."""
        self.process.send_signal(signal.SIGUSR1)
        self.process.wait(20)
        self.start()
        assert all(ask().lookupNode("/test", node.name)[0] == -1 for node in self.nodes), "it has not forgotten"


def ask():
    return xmlrpc.client.ServerProxy(URI, allow_none=True)


def tail(path):
    with open(path, "rb") as file:
        file.seek(max(0, os.path.getsize(path) - 4 * MIB))
        return file.read()


def stranger_address():
    """An address by which a caller of this computer counts as a stranger: it is neither the loopback's nor the roscore's."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.connect(("192.168.1.250", 9))
        return probe.getsockname()[0]


def send(data, address, rng):
    """Send a request; return the answer. Some callers go before they have read it."""
    try:
        with connect(address) as connection:
            try:
                connection.sendall(data)
                if rng.random() < 0.05:
                    return b""
                connection.shutdown(socket.SHUT_WR)
            except OSError:  # it has answered before it has read everything
                pass
            found = b""
            while len(found) < 4096 and (part := connection.recv(65536)):
                found += part
            if rng.random() < 0.9:
                while connection.recv(1 << 20):
                    pass
            return found
    except OSError:
        return b""


def connect(address):
    """A connection, as soon as there is a roscore."""
    while True:
        try:
            return socket.create_connection(("127.0.0.1", PORT), 60, (address, 0))
        except ConnectionRefusedError:
            time.sleep(0.05)


def user(calls, seed, at):
    """A local user without rights, with calls of other numbers."""
    "localhost".encode("idna")  # that user may not be able to read the library any more
    os.setgroups([])
    os.setgid(USER)
    os.setuid(USER)
    counts = collections.Counter()
    for number in range(calls):
        rng = random.Random(f"{seed} user {at} {number}")
        counts["user: " + judge_answer(send(request(rng, True), "127.0.0.1", rng))] += 1
    print(json.dumps(counts))


if __name__ == "__main__":
    if sys.argv[1] == "user":
        user(int(sys.argv[2]), sys.argv[3], sys.argv[4])
    else:
        CALLS = int(sys.argv[1])
        Test(CALLS * 2 // 3, sys.argv[2] if len(sys.argv) > 2 else "1").run(max(4, CALLS // 500))
