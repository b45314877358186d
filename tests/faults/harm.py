# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The lab's own look at a fleet, without `verify`: which pairs of computers do not talk, by whatever kind of packets.

Every computer tries all others at once: names, pings small and large, and the ports of roscore and discovery with a question in them.
The computers of discovery hear each other in its group: an empty datagram, which its nodes pass over.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

ROSCORE = 11311
LOOK = r"""
import concurrent.futures, json, socket, subprocess, sys
own, fleet, beats, group, port = json.load(sys.stdin)
def heard():
    # Each sends for as long as the others may need to begin.
    import time
    member = socket.inet_aton(group) + socket.inet_aton("0.0.0.0")
    found, end = set(), time.monotonic() + 3
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        link.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 8)
        link.bind((group, port))
        link.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
        link.settimeout(0.2)
        while time.monotonic() < end:
            try:
                link.sendto(b"", (group, port))
                found.add(link.recvfrom(2000)[1][0])
                time.sleep(0.05)
            except OSError:
                time.sleep(0.05)
    return found
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
    came = heard() if own in beats else set()
    groups = {name + " group": address in came for name, address in beats.items() if own in beats and name != own}
    print(json.dumps(dict(groups, **{key: job.result() for key, job in jobs.items()})))
"""


@dataclass(frozen=True)
class Fleet:
    """The pairs that are to talk with each other."""

    asked: Mapping[str, tuple[str, list[int]]]  # a computer -> its address and its ports
    robots: Mapping[str, str]  # a computer -> its robot; no other robot needs the port of a roscore
    beats: Mapping[str, str]  # a computer of discovery -> the address that its datagrams come from
    group: str
    port: int


def find_harm(lab, fleet: Fleet) -> dict[str, list[str]]:
    """Return for each computer what it cannot do; nothing where all talk."""

    def look(host: str) -> list[str]:
        needed = {
            name: (address, [port for port in ports if port != ROSCORE or fleet.robots[name] == fleet.robots[host]])
            for name, (address, ports) in fleet.asked.items()
        }
        told = json.dumps([host, needed, fleet.beats, fleet.group, fleet.port])
        output = lab.run(host, f"python3 -c '{LOOK_WORDS}'", check=False, stdin=told)
        lines = output.splitlines()
        try:
            results = json.loads(lines[-1]) if lines else {}
        except ValueError:
            results = {}
        return sorted(key for key, good in results.items() if not good) if results else ["it cannot look"]

    with ThreadPoolExecutor(len(fleet.asked)) as pool:
        found = dict(zip(fleet.asked, pool.map(look, fleet.asked), strict=True))
    return {host: lacks for host, lacks in found.items() if lacks}


LOOK_WORDS = LOOK.replace("'", "'\\''")
