# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Inputs that no program should send, by protocol, each out of a `random.Random`: heartbeats, filters, values, states, requests.

Tests of the nodes draw here, and so do the programs that attack a lab (tests/long/fuzz_*.py, fuzz_roscore.py).
"""

import gzip
import struct
import time
import xmlrpc.client

PORT, RPC = 11511, 11611
MIB = 1 << 20

# Heartbeats


def heartbeat(version=2, rate=10, secs=0, nsecs=0, rpc=RPC, local_secs=0, local_nsecs=0):
    return struct.pack("<cBBxiiHxxii", b"R", version, rate, secs, nsecs, rpc, local_secs, local_nsecs)


LEAVE = heartbeat(rate=0, secs=-1, nsecs=-1, local_secs=-1, local_nsecs=-1)


def some_port(rng):
    return rng.choice([RPC, RPC, 0, 22, 65535, rng.randrange(65536)])


def some_heartbeat(rng):
    """A valid one, with any content: a state, a request or a LEAVE."""
    kind, now = rng.randrange(4), int(time.time())
    if kind == 0:
        return heartbeat(version=3, rate=0, rpc=some_port(rng))
    if kind == 1:
        return heartbeat(secs=-1, nsecs=-1, local_secs=-1, local_nsecs=-1, rpc=some_port(rng))
    secs = rng.choice([0, 1, 5, 2000, now, now + rng.randrange(100), 2**31 - 1])
    rate = rng.choice([0, 1, 10, 255, rng.randrange(256)])
    return heartbeat(rng.choice([2, 3]), rate, secs, rng.randrange(2**31), some_port(rng), secs, rng.randrange(2**31))


def mutated_heartbeat(rng):
    data = bytearray(some_heartbeat(rng))
    for _change in range(rng.randint(1, 4)):
        data[rng.randrange(len(data))] = rng.randrange(256)
    cut = data[: rng.choice([24, 24, 24, 21, 2, 1, 0])]
    return bytes(cut) + some_bytes(rng, rng.choice([0, 0, 0, 1, 40]))


def some_bytes(rng, number):
    return rng.getrandbits(8 * number).to_bytes(number, "little") if number else b""


def datagram(rng):
    """Mostly a valid heartbeat, sometimes a broken one, sometimes anything."""
    kind = rng.randrange(6)
    if kind == 0:
        return some_bytes(rng, rng.choice([1, 2, 24, 24, rng.randrange(60)]))
    return mutated_heartbeat(rng) if kind == 1 else some_heartbeat(rng)


# Filters

FILTERS = [
    r"\A/tf\Z", ".*" * 6 + "x", "(a+)+b", "(a|aa)*b", "(a*)*b", ".*.*.*x|" * 500 + "y", "(?:a|" * 400 + "b" + ")" * 400, "(" * 5000, "[",
    "(?P<a>a)(?P=a)", "(?i)a", "a{1000}{1000}", "a{1000}{1000}{1000}b", "[[a]-b&&c]", "x" * 70000, "|".join(f"/t{n}" for n in range(6000)),
    "[\\0-\\U0010ffff]" * 3000, "\\", "*", "", "(?:(?:){65000}){65000}x", r"\A(?:(?:){65000}){65000}x\Z", r"\A(a+)+b\Z", "(?:a?){6}" * 2 + "x",
    "|".join(r"\A/a.*b\Z" for _n in range(1500)), r"\A" + ".*" * 6 + r"x\Z", r"\A" + ".*" * 4 + r"x\Z", r"\A" + "[ab]*" * 3 + r"[^a]\Z",
    "|".join([r"\A.*.*.*x\Z"] * 4000), "|".join([r"\A/a.*b\Z"] * 4000),
]  # fmt: skip
ATOMS = ["a", ".", "[ab]", r"\w", ".*", "a*", "/", "[^a]", r"\Z", ""]
REPEATED = ["*", "+", "?", "{2,9}", "*?", "{0,255}", "{3}"]


def expression(rng, depth=0):
    """A regular expression of parts of parts, or letters of one in any order."""
    if depth == 0 and rng.random() < 0.4:
        letters = "ab/*.+?{}()[]|\\AZ^$0123,:=!<>P'\u00fc\n"
        return "".join(rng.choice(letters) for _letter in range(rng.randrange(60)))
    if depth > 4 or rng.random() < 0.3:
        return rng.choice(ATOMS)
    inner = [expression(rng, depth + 1) for _part in range(rng.randint(1, 4))]
    return rng.choice(
        [
            "".join(inner),
            "(?:%s)" % "|".join(inner),
            "(?:%s)%s" % (inner[0], rng.choice(REPEATED)),
            "(?=%s)" % inner[0],
            r"(%s)\1" % inner[0],
        ]
    )


def filters(rng):
    size = rng.choice([11, 11, 11, 8, 9, 7, 12, 0])
    return [False] + [rng.choice([*FILTERS, unique(rng)]) if rng.random() < 0.3 else "" for _number in range(size - 1)]


def unique(rng):
    """Return a long filter, another one at each call."""
    word = rng.randrange(10**9)
    return "|".join(rf"\A/{word}_{number}\Z" for number in range(1000))


# Values and states

NAMES = [
    "",
    "/",
    "relative",
    "/with space",
    "/with\nnewline",
    "/\0",
    "//",
    "/" + "x" * 1000,
    "/~",
    "/\u00fc\u2028",
    "7",
]
LEAVES = [None, True, False, 0, -1, 2**31 - 1, -(2**31), 0.5, -1e9, float("nan"), float("inf"), "", "x", "/x", "\n"]


def value(rng, depth=0):
    """Anything that XML-RPC can say."""
    kind = rng.randrange(9 if depth < 4 else 7)
    if kind == 7:
        return [value(rng, depth + 1) for _count in range(rng.randrange(6))]
    if kind == 8:
        return {f"k{number}": value(rng, depth + 1) for number in range(rng.randrange(4))}
    return rng.choice(
        [rng.choice(LEAVES), rng.randrange(-(2**31), 2**31), rng.uniform(-1e9, 1e9), rng.choice(FILTERS), some_bytes(rng, 20), rng.choice(NAMES)]
    )  # fmt: skip


def state(rng, uris, names=(), own=()):
    """A state document of a master at one of the `uris`, with rows of strange names and of `names`, and sometimes of a wrong shape.

    `own`: URIs of nodes of the one that is attacked.
    """
    names = [*names, "/n"]
    nodes = ["http://peer:50001/", "http://peer:50002/", "http://", "", "rosrpc://peer:1", None, 7, *own]

    def name():
        return rng.choice(names if rng.random() < 0.7 else NAMES)

    def rows(*columns):
        made = [[column() for column in columns] for _row in range(rng.randrange(6))]
        return made if rng.random() < 0.99 else value(rng)

    def users():
        return [name() for _user in range(rng.randrange(4))]

    def row():
        origins = [*uris * 3, "http://third:11311/", "", "x"]
        return rows(
            name, lambda: rng.choice(nodes), lambda: rng.choice(origins), lambda: rng.choice([None, "", value(rng)]),
            lambda: rng.choice(["local", "remote", "", "LOCAL"]),
        )  # fmt: skip

    kinds = ["std_msgs/String", "*", "", "None", "no type\n"]
    stamps = ["1000.0", "2.0", "1000.0", "nan", "inf", "-1", "-inf", "", "x", 10**400]
    head = [rng.choice(stamps[:3] if rng.random() < 0.9 else stamps) for _stamp in range(2)]
    tables = [rows(name, users) for _table in range(3)]
    types = rows(name, lambda: rng.choice(kinds))
    return [*head, rng.choice(uris), rng.choice(["peer", "robot2", "", "a\nb"]), *tables, types, row(), row()]


# Requests


def valid(rng):
    """A call of a method: some are those of a discovery, some are unknown to it."""
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
    return xmlrpc.client.dumps(tuple(arguments), method, allow_none=True).encode("utf-8", "replace")


METHODS = """masterContacts masterInfo masterInfoFiltered masterErrors getCurrentTime setTime getTopicsMd5sum getUser system.listMethods
system.methodHelp system.methodSignature system.multicall shutdown __init__ getPid publisherUpdate""".split()
PIECES = [b"", b"<value>", b"]]>", b"&x;", b"\xff\xfe", b"&#0;", b"<!--", b"<![CDATA["]
LAUGHS = '<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;">]><methodCall><methodName>&b;</methodName></methodCall>'


def break_bytes(rng, data):
    """The same with some bytes replaced, left out or doubled."""
    data = bytearray(data[:200000])
    for _change in range(rng.randint(1, 5)):
        at = rng.randrange(len(data))
        new = rng.choice([some_bytes(rng, 5), bytes(data[at : at + 60]), rng.choice(PIECES)])
        data[at : at + rng.choice([0, 1, 1, 30])] = new
    return bytes(data)


def laughs(rng):
    return LAUGHS.encode(rng.choice(["utf-8", "utf-16", "utf-16-be"]))


def request_of(rng, body, packed=4):
    """A whole request with this body; now and then its head is wrong too. `packed`: MiB of blanks that may be its packed body."""
    length, more = len(body), rng.choice(["", "", "Accept-Encoding: gzip\r\n"])
    if rng.random() < 0.04:
        body = gzip.compress(rng.choice([body, b" " * (packed * MIB)]), 1)
        length, more = len(body), "Content-Encoding: gzip\r\n"
    if rng.random() < 0.04:
        length = rng.choice([-1, 0, "", "x", 1 << 40, "9" * 30, length // 2, f"{length}\r\nTransfer-Encoding: chunked"])
        more += rng.choice(
            ["", "Content-Encoding: br\r\n", "Expect: 100-continue\r\n", "X: " + "y" * 20000 + "\r\n", "Z: 1\r\n" * 300]
        )
    verb = rng.choice(["POST"] * 60 + ["GET", "PUT", "\0"])
    path = rng.choice(["/RPC2"] * 30 + ["/", "/x" * 500, "/pydoc.css"])
    return f"{verb} {path} HTTP/1.{rng.randrange(2)}\r\nContent-Length: {length}\r\n{more}\r\n".encode() + body


def request(rng):
    """A whole request to a discovery."""
    kinds = [costly, lambda rng: some_bytes(rng, rng.randrange(1, 3000)), *[valid] * 3, *[broken] * 3, deep, laughs]
    return request_of(rng, rng.choice(kinds)(rng))


def broken(rng):
    return break_bytes(rng, valid(rng))


def deep(rng):
    return call_of("masterInfoFiltered", [deep_value(rng)])


# Inputs that are dear for their size, as XML. A node takes at most 1 MB.

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
#: Of each node: its methods with an argument of any form, the arguments before it, and behind it.
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
