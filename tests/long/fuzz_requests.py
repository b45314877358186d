# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Sends XML-RPC requests that nobody should send, and counts what is answered.

fuzz_requests.py VICTIM SEED COUNT : runs on a computer of the lab and prints JSON.

tests/unit/nodes/running_attacks.py draws from here, too: requests to each of the nodes, and answers, that are dear for their size.
"""

import collections
import gzip
import json
import queue
import random
import socket
import sys
import threading
import time
import xmlrpc.client

PORT, THREADS = 11611, 6
METHODS = """masterContacts masterInfo masterInfoFiltered masterErrors getCurrentTime setTime getTopicsMd5sum getUser system.listMethods
system.methodHelp system.methodSignature system.multicall shutdown __init__ getPid publisherUpdate""".split()
FILTERS = [
    r"\A/tf\Z", ".*" * 6 + "x", "(a+)+b", "(a|aa)*b", ".*.*.*x|" * 500 + "y", "(?:a|" * 400 + "b" + ")" * 400, "(" * 3000, "[", "(?P<a>a)(?P=a)",
    "(?i)a", "a{1000}{1000}", "[[a]-b&&c]", "x" * 70000, "|".join(f"/t{n}" for n in range(6000)), "[\\0-\\U0010ffff]" * 500, "\\", "*", "",
    "(?:(?:){65000}){65000}x", r"\A(?:(?:){65000}){65000}x\Z", r"\A(a+)+b\Z", "|".join(r"\A/a.*b\Z" for _n in range(1500)),
]  # fmt: skip


def value(rng, depth=0):
    """Anything that XML-RPC can say."""
    kind = rng.randrange(9 if depth < 4 else 7)
    if kind == 7:
        return [value(rng, depth + 1) for _count in range(rng.randrange(6))]
    if kind == 8:
        return {f"k{number}": value(rng, depth + 1) for number in range(rng.randrange(4))}
    return [
        None,
        rng.random() < 0.5,
        rng.randrange(-(2**31), 2**31),
        rng.uniform(-1e9, 1e9),
        rng.choice(FILTERS),
        rng.randbytes(20),
        "/x",
    ][kind]


def filters(rng):
    size = rng.choice([11, 11, 11, 8, 9, 7, 12, 0])
    return [False] + [rng.choice([*FILTERS, unique(rng)]) if rng.random() < 0.3 else "" for _number in range(size - 1)]


def unique(rng):
    """A long filter that nobody has sent before."""
    word = rng.randrange(10**9)
    return "|".join(rf"\A/{word}_{number}\Z" for number in range(1000))


def valid(rng):
    method = rng.choice(METHODS)
    arguments = (
        [filters(rng)]
        if method == "masterInfoFiltered"
        else [value(rng) for _count in range(rng.choice([0, 0, 1, 1, 3]))]
    )
    if method == "getTopicsMd5sum":
        arguments = [
            ["std_msgs/String", "os/path", "antigravity/x", "../x", "rosgraph_msgs/Log"] * rng.choice([1, 1000])
        ]
    return xmlrpc.client.dumps(tuple(arguments), method, allow_none=True).encode()


def mutated(rng):
    data = bytearray(valid(rng))
    for _change in range(rng.randint(1, 5)):
        at = rng.randrange(len(data))
        data[at : at + rng.choice([0, 1, 1, 20])] = rng.choice(
            [rng.randbytes(3), b"", data[at : at + 40], b"<value>", b"]]>", b"&x;"]
        )
    return bytes(data)


def deep(rng):
    return call_of("masterInfoFiltered", [deep_value(rng)])


def laughs(rng):
    text = '<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;">]><methodCall><methodName>&b;</methodName></methodCall>'
    return text.encode(rng.choice(["utf-8", "utf-16", "utf-16-be"]))


# What is dear for its size, as XML. A node takes at most 1 MB.

SIZE = 900_000


def patterns(rng):
    """A filter with a regular expression that takes long: repetitions of repetitions, mostly of what has no length."""
    text, times = (
        rng.choice(["", "", "", "^", "(?=/)", "a|aa"]),
        rng.choice(["{65000}", "{65000}", "{60000,65000}", "*"]),
    )
    for _level in range(rng.randint(2, 4)):
        text = f"(?:{text}){times}"
    found = [False, *[""] * 10]
    found[rng.randrange(1, 11)] = rng.choice(["{}x", r"\A{}x\Z", r"\A{}/\Z|x", "{}|y"]).format(text)
    return xml(found)


def many_names(rng):
    """Names with '*': as filters on their way, or as a list."""
    word = "a" * rng.choice([1, 10, 100])
    names = [f"/{word}*{word}{number}*{word}" for number in range(SIZE // 12 // (3 * len(word) + 30))]
    text = "|".join(rf"\A{name.replace('*', '.*')}\Z" for name in names)
    return xml(rng.choice([[False, *[text] * 10], names, dict.fromkeys(names, "*")]))


def small_values(rng):
    """Many small values: a request of 1 MB that takes as long to read as any."""
    part = rng.choice(
        [b"<value/>", b"<value><nil/></value>", b"<value><struct/></value>", b"<value><array><data/></array></value>"]
    )
    return b"<value><array><data>" + part * rng.randrange(1000, SIZE // len(part)) + b"</data></array></value>"


def deep_value(rng):
    """A value in very many lists."""
    levels = rng.randrange(20000)
    return b"<value><array><data>" * levels + b"</data></array></value>" * levels


def long_number(rng):
    """A number with very many digits: int() takes the square of them."""
    kind, digits = rng.choice([b"int", b"i8", b"double"]), rng.choice([b"1", b"9"]) * rng.randrange(1000, SIZE)
    return b"<value><" + kind + b">" + digits + b"</" + kind + b"></value>"


COSTS = (patterns, many_names, patterns, small_values, patterns, deep_value, patterns, long_number)
#: Of each node: its methods with an argument of any form, what stands before it, and behind it.
TAKE_ANYTHING = {
    "discovery": [("masterInfoFiltered", (), ()), ("getTopicsMd5sum", (), ()), ("rosfleetDifferences", (), ("", 0, 0.0))],
    "relay": [("rosfleetOffers", (), ("", 0.0)), ("rosfleetOffers", ("bad",), (0.0,)), ("rosfleetOffers", ("bad", ""), ())],
    "roscore": [
        ("setParam", ("/bad", "/do_not_sync"), ()),
        ("setParam", ("/bad", "/bad"), ()),
        ("getParam", ("/bad",), ()),
        ("registerPublisher", ("/bad",), ("x/Y", "http://127.0.0.2:1/")),
        ("rosfleetChanges", ("/bad",), (0, 0.0, True)),
        ("system.multicall", (), ()),
    ],
}  # fmt: skip


def xml(value):
    """A value as XML-RPC has it."""
    return xmlrpc.client.dumps((value,), allow_none=True).encode().split(b"<param>")[1].split(b"</param>")[0]


def call_of(method, values):
    """A request with these values, which are XML."""
    params = b"".join(b"<param>" + value + b"</param>" for value in values)
    return b"<methodCall><methodName>" + method.encode() + b"</methodName><params>" + params + b"</params></methodCall>"


def costly(rng, node="discovery", costs=COSTS):
    """A request to a node with something dear in it."""
    method, before, after = rng.choice(TAKE_ANYTHING[node])
    return call_of(method, [*map(xml, before), rng.choice(costs)(rng), *map(xml, after)])


def costly_answer(rng, uri, costs=COSTS):
    """The answer of a discovery with something dear in it, for a sync."""
    parts = [xml(part) for part in ("2.0", "2.0", uri, "bad", [], [], [], [], [], [])]
    parts[rng.randrange(len(parts))] = rng.choice(costs)(rng)
    whole = b"<value><array><data>" + b"".join(parts) + b"</data></array></value>"
    return b"<methodResponse><params><param>" + whole + b"</param></params></methodResponse>"


BODIES = [
    costly,
    lambda rng: rng.randbytes(rng.randrange(1, 3000)),
    valid,
    valid,
    valid,
    mutated,
    mutated,
    mutated,
    deep,
    laughs,
]


def request(rng):
    """A whole request; now and then one whose head is wrong too."""
    body = rng.choice(BODIES)(rng)
    length, more = len(body), ""
    if rng.random() < 0.05:
        body, more = gzip.compress(rng.choice([body, b"\0" * (4 << 20)])), "Content-Encoding: gzip\r\n"
        length = len(body)
    if rng.random() < 0.05:
        length = rng.choice([-1, 0, "", "x", 1 << 40, length // 2, f"{length}\r\nTransfer-Encoding: chunked"])
    method, path = rng.choice(["POST"] * 20 + ["GET", "PUT", "\0"]), rng.choice(["/RPC2"] * 9 + ["/", "/x" * 500])
    return f"{method} {path} HTTP/1.{rng.randrange(2)}\r\nContent-Length: {length}\r\n{more}\r\n".encode() + body


def answer(victim, data):
    with socket.create_connection((victim, PORT), 30) as connection:
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
