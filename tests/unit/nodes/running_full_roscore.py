# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""A roscore as a process, an address that fills it, and a friend: `running_full_roscore.py FOLDER`.

It is called in a new network namespace. It prints, before and after a kill of the roscore: what the filler is answered in the end,
the seconds that a friend and a program of this computer wait for a registration and a parameter, and the most memory that the
process had.
"""

import http.client
import json
import pathlib
import subprocess
import sys
import time
import xmlrpc.client

from running_attacks import PORT, ROSCORE, ROSCORE_BAD, ROSCORE_FRIEND, Server

LONG = "x" * 300
STEP = 200  # calls in one request


def call(source, method, *arguments):
    connection = http.client.HTTPConnection(ROSCORE, PORT, timeout=60, source_address=(source, 0))
    try:
        connection.request("POST", "/RPC2", xmlrpc.client.dumps(arguments, method))
        return xmlrpc.client.loads(connection.getresponse().read())[0][0]
    finally:
        connection.close()


def fill(first=0):
    """Register and set until nothing is taken any more; the last two answers."""
    for start in range(first, 1_000_000, STEP):
        calls = []
        for number in range(start, start + STEP):
            node, uri = f"/bad/{number}/{LONG}", f"http://bad:1/{number}/{LONG}"
            calls.append(("registerPublisher", [node, f"/topic/{number}/{LONG}", f"x/{LONG}", uri]))
            calls.append(("setParam", [node, f"/parameter{number}", LONG * 10]))
        answers = call(
            ROSCORE_BAD, "system.multicall", [{"methodName": name, "params": words} for name, words in calls]
        )
        if all(answer[0][0] == -1 for answer in answers[-2:]):
            return [answer[0][1] for answer in answers[-2:]], start
    raise AssertionError("all of it is taken")


def ask(source, number):
    """Return the seconds for a registration and a parameter."""
    began = time.monotonic()
    name = f"/friend{number}/{source.replace('.', '_')}"
    assert call(source, "registerPublisher", name, f"/topic{name}", "x/Y", "http://friend:1/")[0] == 1
    assert call(source, "setParam", name, f"/parameter{name}", 1)[0] == 1
    return time.monotonic() - began


def read_peak(server):
    status = pathlib.Path(f"/proc/{server.node.process.pid}/status").read_text()
    return next(int(line.split()[1]) << 10 for line in status.splitlines() if line.startswith("VmHWM:"))


def look(server, number, first):
    before = read_peak(server)
    answers, last = fill(first)
    waits = [ask(source, number) for source in (ROSCORE_FRIEND, ROSCORE)]
    return {"answers": answers, "waits": waits, "start": before, "peak": read_peak(server)}, last


def main():
    addresses = [f"address add {address}/32 dev lo" for address in (ROSCORE, ROSCORE_BAD, ROSCORE_FRIEND)]
    subprocess.run(["ip", "-batch", "-"], input="\n".join(["link set lo up", *addresses]), text=True, check=True)
    folder = pathlib.Path(sys.argv[1])
    found, first = [], 0
    for number in range(2):
        server = Server("roscore", folder)
        server.start()
        row, first = look(server, number, first)
        found.append(row)
        server.node.end()
    print(json.dumps(found))


main()
