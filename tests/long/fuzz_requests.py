# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Sends XML-RPC requests that nobody should send, and counts what is answered.

fuzz_requests.py VICTIM SEED COUNT : runs on a computer of the lab, beside hostile_inputs.py, and prints JSON.
"""

import collections
import json
import queue
import random
import socket
import sys
import threading
import time

from hostile_inputs import RPC, request

THREADS = 6


def answer(victim, data):
    with socket.create_connection((victim, RPC), 30) as connection:
        try:
            connection.sendall(data)
            connection.shutdown(socket.SHUT_WR)
        except OSError:  # it has answered before it has read everything
            pass
        found = b""
        try:
            while part := connection.recv(65536):
                found += part
        except OSError:
            pass
        return (
            "nothing"
            if not found
            else "fault"
            if b"<fault>" in found
            else found.split(b" ", 2)[1].decode(errors="replace")
        )


def main():
    victim, seed, count = sys.argv[1:]
    counts, slowest, todo = collections.Counter(), [0.0], queue.SimpleQueue()
    for number in range(int(count)):
        todo.put(number)

    def work():
        while True:
            try:
                data = request(random.Random(f"{seed} {todo.get_nowait()}"))
            except queue.Empty:
                return
            begun = time.monotonic()
            try:
                counts[answer(victim, data)] += 1
            except OSError as problem:
                counts[str(problem)] += 1
            slowest[0] = max(slowest[0], time.monotonic() - begun)

    started = time.monotonic()
    threads = [threading.Thread(target=work) for _number in range(THREADS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    took, longest = round(time.monotonic() - started, 1), round(slowest[0], 2)
    print(json.dumps({"sent": sum(counts.values()), "seconds": took, "slowest": longest, "answers": counts}))


if __name__ == "__main__":
    main()
