# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Inside a computer of the lab: start a roscore, register, kill it, and look what it still knows.

calls.py plain|nothing|journal|normal|full CALLS
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import xmlrpc.client
import xmlrpc.server

PORT = 11499
ROSCORE = xmlrpc.client.ServerProxy(f"http://127.0.0.1:{PORT}/")


def command(kind, folder):
    """The command, and what it has in its environment."""
    if kind == "plain":
        return ["rosmaster", "--core", "-p", str(PORT), "-w", "16", "-t", "3"], {}
    program = (
        [sys.executable, "with_sqlite.py"]
        if kind in ("normal", "full")
        else [sys.executable, "-m", "rosfleet_multimaster.roscore"]
    )
    store = [] if kind == "nothing" else ["--store", folder]
    return [*program, "-p", str(PORT), "--no-rosout", *store], {"SYNCHRONOUS": kind}


def started(kind, folder):
    """The process of a roscore that answers."""
    words, more = command(kind, folder)
    environment = {**os.environ, **more, "ROS_IP": "127.0.0.1", "ROS_HOSTNAME": "127.0.0.1", "ROS_LOG_DIR": folder}
    process = subprocess.Popen(words, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    for _try in range(3000):
        try:
            ROSCORE.getPid("/bench")
            return process
        except OSError:
            time.sleep(0.01)
    raise SystemExit(f"the roscore does not start: {words}")


def used(process):
    """The bytes that a process gave to write(), those that it caused to be written to a disk, its milliseconds of computing."""
    with open(f"/proc/{process.pid}/io", encoding="ascii") as file:
        found = dict(line.split(": ") for line in file.read().splitlines())
    with open(f"/proc/{process.pid}/schedstat", encoding="ascii") as file:
        computed = int(file.read().split()[0])
    for thread in os.listdir(f"/proc/{process.pid}/task"):
        if thread != str(process.pid):
            with open(f"/proc/{process.pid}/task/{thread}/schedstat", encoding="ascii") as file:
                computed += int(file.read().split()[0])
    return int(found["wchar"]), int(found["write_bytes"]), computed / 1e6


def known():
    """The number of registrations that it knows."""
    publishers = ROSCORE.getSystemState("/bench")[2][0]
    return sum(len(nodes) for topic, nodes in publishers if topic.startswith("/bench_"))


def node(topics):
    """The URI of nodes that live, and say that they have these topics."""
    server = xmlrpc.server.SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False)
    server.register_function(lambda _caller: [1, "", os.getpid()], "getPid")
    server.register_function(
        lambda _caller: [1, "", [[topic, "std_msgs/String"] for topic in topics]], "getPublications"
    )
    server.register_function(lambda _caller: [1, "", []], "getSubscriptions")
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return "http://127.0.0.1:%d/" % server.server_address[1]


def registered(topics, uri):
    """The milliseconds of each call."""
    times = []
    for number, topic in enumerate(topics):
        began = time.perf_counter()
        code = ROSCORE.registerPublisher(f"/node_{number % 50}", topic, "std_msgs/String", uri)[0]
        times.append(1000 * (time.perf_counter() - began))
        assert code == 1
    return times


def main():
    kind, calls = sys.argv[1], int(sys.argv[2])
    folder = tempfile.mkdtemp(prefix="bench-", dir="/var/tmp")
    topics = [f"/bench_{number}" for number in range(calls)]
    uri = node(topics)
    process = started(kind, folder)
    time.sleep(1.0)  # rosversion has ended
    before = used(process)
    times = sorted(registered(topics, uri))
    after = used(process)
    process.kill()
    process.wait()
    kept = 0
    if kind not in ("plain", "nothing"):
        process = started(kind, folder)
        time.sleep(1.0)  # the nodes have been asked
        kept = known()
        process.kill()
        process.wait()
    shutil.rmtree(folder)
    found = {
        "calls": calls,
        "median": times[calls // 2],
        "p99": times[calls * 99 // 100],
        "worst": times[-1],
        "kept": kept,
    }
    found["written"], found["disk"], found["computing"] = [(late - early) / calls for early, late in zip(before, after)]
    print(json.dumps({name: round(value, 3) for name, value in found.items()}))


if __name__ == "__main__":
    main()
