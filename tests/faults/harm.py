# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The lab's own look at a fleet, without `verify`: which pairs of computers do not talk, by whatever kind of packets.

Every computer tries all others at once: names, pings small and large, and the ports of roscore and discovery with a question in them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor

ROSCORE = 11311
LOOK = r"""
import concurrent.futures, json, socket, subprocess, sys
own, fleet = json.load(sys.stdin)
def asked(address, port):
    try:
        with socket.create_connection((address, port), timeout=2) as link:
            link.settimeout(3)
            body = "<?xml version='1.0'?><methodCall><methodName>system.listMethods</methodName><params></params></methodCall>"
            link.sendall(("POST / HTTP/1.0\r\nContent-Length: %d\r\n\r\n%s" % (len(body), body)).encode())
            return bool(link.recv(1))
    except OSError:
        return False
def pinged(address, size):
    return any(echo(address, size) for turn in range(2))
def echo(address, size):
    import os, struct, time
    head = struct.pack("!BBHHH", 8, 0, 0, os.getpid() & 0xFFFF, size) + bytes(size)
    total = sum(struct.unpack("!%dH" % (len(head) // 2), head))
    while total >> 16: total = (total & 0xFFFF) + (total >> 16)
    head = head[:2] + struct.pack("!H", ~total & 0xFFFF) + head[4:]
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_ICMP) as link:
            link.settimeout(1)
            link.connect((address, 0))
            link.send(head)
            end = time.monotonic() + 1
            while time.monotonic() < end:
                got = link.recv(2000)
                if got[20:22] == b"\0\0" and got[24:28] == head[4:8]:
                    return True
    except OSError:
        pass
    return False
def named(name, address):
    words = ["runuser", "-u", "nobody", "--", "getent", "ahostsv4", name]
    found = subprocess.run(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, timeout=20).stdout.decode()
    return address in found
jobs = {}
with concurrent.futures.ThreadPoolExecutor(40) as pool:
    for name, (address, ports) in fleet.items():
        jobs[name + " name"] = pool.submit(named, name, address)
        if name != own:
            jobs[name + " ping"] = pool.submit(pinged, address, 56)
            jobs[name + " large"] = pool.submit(pinged, address, 1440)
        for port in ports:
            jobs["%s %d" % (name, port)] = pool.submit(asked, address, port)
    print(json.dumps({key: job.result() for key, job in jobs.items()}))
"""


def find_harm(lab, fleet: Mapping[str, tuple[str, list[int]]], robots: Mapping[str, str]) -> dict[str, list[str]]:
    """Return for each computer what it cannot do; nothing where all talk.

    `fleet`: the address and the ports of each, `robots`: its robot. No other robot needs the port of a roscore.
    """

    def look(host: str) -> list[str]:
        needed = {
            name: (address, [port for port in ports if port != ROSCORE or robots[name] == robots[host]])
            for name, (address, ports) in fleet.items()
        }
        output = lab.run(host, f"python3 -c '{LOOK_WORDS}'", check=False, stdin=json.dumps([host, needed]))
        lines = output.splitlines()
        try:
            results = json.loads(lines[-1]) if lines else {}
        except ValueError:
            results = {}
        return sorted(key for key, good in results.items() if not good) if results else ["it cannot look"]

    with ThreadPoolExecutor(len(fleet)) as pool:
        found = dict(zip(fleet, pool.map(look, fleet), strict=True))
    return {host: lacks for host, lacks in found.items() if lacks}


LOOK_WORDS = LOOK.replace("'", "'\\''")
