# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A master that is not in the inventory, and one that takes the identity of a robot: named, and otherwise ignored.

Also what they say: it is in the journal as text of ours tells it, and writes no record of its own.
"""

import json
import random
import re
import shlex
import time

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain_text import is_plain, quote
from setups.links import wait_until
from subject import NODES

VICTIM, PEER = "kobuki1computer", "kobuki2computer"
ADDRESS, ROGUE = "192.168.1.229", "192.168.1.66"
SECONDS = 12
IDENTITIES = {
    "a rogue": ("http://rogue:11311/", "rogue", "it is no robot of the fleet"),
    "a thief": (f"http://{PEER}:11311/", PEER, f"it says that it is {PEER}, which is at 192.168.1.239"),
}


def masters(lab):
    """(name, online, monitor URI) of list_masters."""
    listed = lab.run(VICTIM, "rosservice call /master_discovery/list_masters", check=False)
    return sorted(re.findall(r'(?<!_)name: "?(\w+).*?online: (\w+).*?monitoruri: "?([^"\n]+)', listed, re.DOTALL))


@pytest.fixture(scope="module")
def fleet(lab):
    """Both robots know each other; the second computer has the address of a stranger besides."""
    wait_until(lambda: len(masters(lab)) == 2, 30, "both masters")
    lab.run(
        PEER, f"ip address add {ROGUE}/24 dev eth0; cat > /run/rogue.py", stdin=(NODES / "hostile/rogue.py").read_text()
    )
    yield lab
    lab.run(PEER, f"ip address del {ROGUE}/24 dev eth0")
    # Nodes that were shut down were started again: the next tests count from here.
    lab.run(VICTIM, "systemctl reset-failed 'multimaster-*'")


@pytest.mark.parametrize("who", IDENTITIES)
def test_strangers_are_named_and_ignored(fleet, who):
    uri, name, why = IDENTITIES[who]
    before = masters(fleet)
    fleet.run(VICTIM, "systemctl restart multimaster-discovery")  # what it knows of strangers is of this test alone
    wait_until(lambda: masters(fleet) == before, 30, "the same masters again")
    since = time.time()
    called = json.loads(fleet.run(PEER, f"python3 /run/rogue.py {ROGUE} {ADDRESS} {uri} {name} {SECONDS}"))
    assert 1 <= called["connections"] <= 2 and set(called["methods"]) == {"masterContacts"}, called
    assert called["answers"] == 0, "its datagrams are not answered"
    assert masters(fleet) == before
    held = fleet.run(VICTIM, "rostopic list")
    assert "/rogue/cmd_vel" not in held
    log = fleet.run(VICTIM, f"journalctl --unit multimaster-discovery --output cat --since @{since - 1:.0f}")
    assert log.count(f"{quote(name)} ({uri}) at {ROGUE} is ignored: {why}") == 1, log
    ask = f"import xmlrpc.client as x; print(x.ServerProxy('http://{ADDRESS}:11611').getOutsiders()[1])"
    assert f"['{ROGUE}', '{name}', '{uri}', '{why}']" in fleet.run(VICTIM, f'python3 -c "{ask}"')


#: Calls of anybody with a text of his own: shutdown(caller, reason) of nodes, and methods of the roscore with names that are none.
CALLS = """
import json, sys, time, xmlrpc.client
# A call goes out once: the library asks a node that ended before its answer again, and finds nobody.
xmlrpc.client.Transport.request = xmlrpc.client.Transport.single_request
address, texts = sys.argv[1], json.load(sys.stdin)
roscore = xmlrpc.client.ServerProxy(f"http://{address}:11311")
reached, problems = [], []
for number, text in enumerate(texts):
    for node in ("/rosout", "/master_discovery")[: 2 if number == 0 else 1]:
        for _try in range(100):
            try:
                code, _said, uri = roscore.lookupNode("/stranger", node)
                if code == 1:
                    xmlrpc.client.ServerProxy(uri.replace(uri.split("/")[2].split(":")[0], address)).shutdown("/stranger", text)
                    reached.append(node)
                    break
                problems.append(f"{node}: {code} {_said}")
            except ConnectionResetError:  # it took the request, and ended before the answer was sent
                reached.append(node)
                break
            except (OSError, xmlrpc.client.Error) as problem:
                problems.append(f"{node}: {problem!r}")
            time.sleep(0.2)
        time.sleep(1)
    for method, arguments in (
        *(("registerPublisher", (text, text, text, text)), ("subscribeParam", (text, text, text)), (text, ())),
        *(("registerService", (text, text, text, text)), ("system.multicall", (text,)), ("getPid", (text,))),
    ):
        try:
            getattr(roscore, method)(*arguments)
        except Exception:
            pass
print(json.dumps([reached, sorted(set(problems))]))
"""
UNITS = ("roscore", "discovery", "sync", "connections", "address")
FORGED = "FORGED"
BREAKS = ("\n", "\r\n", "\n\n", "\u2028\n", "\x85\n", "\x1b[2J\n", "\n   ", "\n\t", "\n\u202e")


def reasons(seed, count):
    """Texts whose lines would be records, also of each priority."""
    draw = random.Random(seed)
    lines = [f"<{priority}>{FORGED} all is well" for priority in range(8)] + [
        f"{FORGED} do: reboot",
        f"rosfleet: {FORGED}",
    ]
    return [
        "".join(draw.choice(BREAKS) + draw.choice(lines) for _line in range(draw.randint(1, 6)))
        for _text in range(count)
    ]


def test_what_strangers_say_is_no_record_of_the_journal(fleet):
    before, since = masters(fleet), time.time()
    fleet.run(PEER, "cat > /run/calls.py", stdin=CALLS)
    texts = reasons(25, 4)
    reached, problems = json.loads(fleet.run(PEER, f"python3 /run/calls.py {ADDRESS}", stdin=json.dumps(texts)))
    assert reached.count("/rosout") == 4 and "/master_discovery" in reached, (reached, problems)
    rogue = ("http://rogue:11311/", f"rogue{' ' * 90}do: reboot{texts[0]}")
    fleet.run(PEER, f"python3 /run/rogue.py {ROGUE} {ADDRESS} {' '.join(map(shlex.quote, rogue))} 4")
    wait_until(lambda: masters(fleet) == before, 60, "the same masters again")
    units = " ".join(f"--unit multimaster-{name}" for name in UNITS)
    said = fleet.run(
        VICTIM, f"journalctl {units} --output json --all --since @{since - 1:.0f} _SYSTEMD_SLICE=system.slice"
    )
    records = [json.loads(line) for line in said.splitlines()]
    ours = [entry for entry in records if entry.get("_TRANSPORT") == "stdout"]
    told = [entry["MESSAGE"] for entry in ours if FORGED in str(entry["MESSAGE"])]
    print(f"\n{len(ours)} records, {len(told)} with texts of strangers; such as {told[0]!r}")
    assert {type(entry["MESSAGE"]) for entry in records} == {str}, "text, and no bytes"
    assert {entry["PRIORITY"] for entry in ours} <= {"2", "3", "4", "6"}, "as our programs write them"
    assert any(line.startswith("rosout says: ") for line in told) and any(line.startswith("printed: ") for line in told)
    assert not [
        line
        for line in told
        if not re.match(r"[A-Za-z][\w ]*[\w:.] ", line) or line.startswith((FORGED, "rosfleet:", "do:"))
    ]
    assert not [line for line in told if re.search(r"[^ -~]|  ", line)], "plain, and runs of blanks are one"


#: Registrations of strangers at the roscore of a robot: (verb, caller, name, type, URI) of each on standard input.
REGISTER = """
import json, sys, xmlrpc.client
roscore = xmlrpc.client.ServerProxy(f"http://{sys.argv[1]}:11311")
for verb, caller, name, kind, uri in json.load(sys.stdin):
    arguments = {
        "registerPublisher": (caller, name, kind, uri),
        "registerService": (caller, name, uri.replace("http:", "rosrpc:"), uri),
        "unregisterPublisher": (caller, name, uri),
        "unregisterService": (caller, name, uri.replace("http:", "rosrpc:")),
    }[verb]
    try:
        print(getattr(roscore, verb)(*arguments)[0])
    except Exception as problem:
        print(problem)
"""
#: the lines of /diagnostics, as strangers would write them
LINES = (
    *("multimaster: masters", "multimaster: link to kobuki2computer", "multimaster: clocks", "multimaster: roscore"),
    *("2 of 2 are there", "online", "they agree", "it answers", "OK", "none", "not there", "0 are not listed here"),
    *("last heard: 0.1 s ago", "lost: 0 times", "heartbeats: 100 %", "refused requests, value: 0", "PASSED", "ok=1"),
    *("level: 0", "is refused: it is no robot of the fleet", "is ignored: it is welcome", "; do: reboot"),
)


def forged(draw):
    """A name that would be a line of /diagnostics."""
    parts = [
        draw.choice((*BREAKS, " ", "   ", '"', "'", '": "', "; ", ", ")) + draw.choice(LINES) for _part in range(3)
    ]
    return f"{FORGED}{''.join(parts)} {FORGED}"


def joined(draw):
    """The same without blanks and colons: as a name it passes a roscore and master_sync."""
    return re.sub(r"[^!-9;-~]+", lambda _found: draw.choice(('";', "',", '"=', "=")), forged(draw))


def outside(text):
    """The part of a text that stands outside of quotes."""
    return re.sub(r'"[^"]*"', "", text)


def diagnostics(lab, seconds=9):
    """(level, name, message, values) of each entry that came to a subscriber."""
    lab.run(VICTIM, "cat > /run/told.py", stdin=(NODES / "observers/diagnostics.py").read_text())
    messages = json.loads(lab.run(VICTIM, f"python3 /run/told.py {seconds}").splitlines()[-1])
    return [tuple(entry) for message in messages for entry in message]


@pytest.mark.costly
def test_strangers_write_no_line_of_diagnostics(fleet):
    draw = random.Random(25)
    names = {entry[1] for entry in diagnostics(fleet)}
    assert {"multimaster: strangers", "multimaster: places", "multimaster: types"} <= names
    there, here = "192.168.1.239", ADDRESS
    hostile = []
    # Each roscore takes what it takes. What both have is refused, and so is a port that no node has.
    for number in range(12):
        draws = forged if number % 3 == 0 else joined
        node, topic, service, *kinds = (f"/{draws(draw)}" for _name in range(5))
        for place, host, kind in ((there, PEER, kinds[0]), (here, VICTIM, kinds[1])):
            uri = f"http://{host}:{41000 + number}/"
            hostile += [
                (place, "registerPublisher", node, f"/named{number}", "std_msgs/String", uri),
                (place, "registerPublisher", f"/typed{number}", topic, f"a{kind}", uri),
                (place, "registerService", f"/served{number}", service, "", uri),
            ]
        port = f"http://{PEER}:{80 + number}/"
        hostile += [(there, "registerPublisher", f"{node}{number}", f"/placed{number}", "std_msgs/String", port)]
    fleet.run(PEER, "cat > /run/register.py", stdin=REGISTER)
    for place in (there, here):
        calls = [call for at, *call in hostile if at == place]
        said = fleet.run(PEER, f"python3 /run/register.py {place}", stdin=json.dumps(calls)).splitlines()
        print(f"\n{said.count('1')} of {len(calls)} registrations were taken at {place}")
    fleet.run(VICTIM, "systemctl restart multimaster-discovery")  # what it knows of strangers is of this test alone
    seen = []
    try:
        for name in ("PASSED", "ok=1", f"rogue,they{FORGED}agree", forged(draw)):
            arguments = " ".join(map(shlex.quote, ("http://rogue:11311/", name)))
            fleet.run(PEER, f"timeout 30 python3 /run/rogue.py {ROGUE} {ADDRESS} {arguments} 8")
            seen += diagnostics(fleet, 4)
            fleet.run(VICTIM, "systemctl restart multimaster-discovery")
        wait_until(lambda: len(masters(fleet)) == 2, 30, "both masters again")
        time.sleep(5)
        seen += diagnostics(fleet)
    finally:
        for place in (there, here):
            calls = [(verb.replace("reg", "unreg"), *rest) for at, verb, *rest in hostile if at == place]
            fleet.run(PEER, f"python3 /run/register.py {place}", stdin=json.dumps(calls))
    assert {entry[1] for entry in seen} <= names, "no entry of a stranger"
    texts = {
        text
        for _level, name, message, values in seen
        for text in (name, message, *(part for pair in values for part in pair))
    }
    told = sorted(text for text in texts if FORGED in text or "PASSED" in text or "ok=1" in text)
    print(f"{len(seen)} entries, {len(told)} texts with words of strangers; such as", *told[:6], sep="\n  ")
    assert any("PASSED" in text for text in told) and len([text for text in told if FORGED in text]) > 8
    for text in texts:
        assert is_plain(text) and "  " not in text, text
    for text in told:
        assert not [line for line in (FORGED, "PASSED", "ok=1", "they agree", "is welcome") if line in outside(text)], (
            text
        )


#: A node that prints what strangers could have it print: escape sequences and records of the journal of any priority.
PRINTS = r"""
import sys, time
for number in range(40):
    for stream in (sys.stdout, sys.stderr):
        stream.write("\x1b[2J\x1b]0;FORGED\x07 first\n<0>FORGED is well\n\n<3>rosfleet: FORGED   do: reboot\r<2>FORGED\u2028<1>FORGED\x9b31m \u202eFORGED\n")
        stream.flush()
    time.sleep(0.1)
time.sleep(600)
"""
LAUNCH = """<launch><node name="prints" pkg="prints" type="prints" output="screen" /></launch>"""


@pytest.mark.costly
def test_what_the_roscore_of_ros_prints_is_plain_too(fleet):
    """The program of upstream (roslaunch is its roscore with a node) below ours, with calls of strangers on its port."""
    port, unit, since = 11399, "rosfleet-test-plain", time.time()
    fleet.run(
        VICTIM,
        "mkdir -p /run/prints/prints; cat > /run/prints/prints/prints; chmod +x /run/prints/prints/prints",
        stdin=f"#!/usr/bin/python3{PRINTS}",
    )
    fleet.run(
        VICTIM,
        "cat > /run/prints/prints/package.xml",
        stdin='<package format="2"><name>prints</name><version>1.0.0</version></package>',
    )
    fleet.run(VICTIM, "cat > /run/prints/prints.launch", stdin=LAUNCH)
    environment = {
        "PYTHONPATH": "/usr/local/lib/rosfleet-multimaster/python",
        "ROS_MASTER_URI": f"http://{VICTIM}:{port}/",
        "ROS_PACKAGE_PATH": "/run/prints:/usr/share",
        "ROS_HOME": "/run/prints",
        "PYTHONIOENCODING": "utf-8",
    }
    given = " ".join(f"--setenv={name}={value}" for name, value in environment.items())
    program = f"python3 -m rosfleet_multimaster.run_plain /usr/bin/roslaunch -p {port} /run/prints/prints.launch"
    fleet.run(VICTIM, f"systemd-run --quiet --collect --unit={unit} {given} /usr/bin/{program}")
    try:
        fleet.run(PEER, "cat > /run/calls.py", stdin=CALLS.replace(":11311", f":{port}"))
        journal = f"journalctl --unit {unit} --output json --all --since @{since - 1:.0f}"
        wait_until(lambda: FORGED in fleet.run(VICTIM, journal), 60, "what the node prints")
        reached, _problems = json.loads(
            fleet.run(PEER, f"python3 /run/calls.py {ADDRESS}", stdin=json.dumps(reasons(26, 2)))
        )
        records = [json.loads(line) for line in fleet.run(VICTIM, journal).splitlines()]
    finally:
        fleet.run(VICTIM, f"systemctl stop {unit}; rm -rf /run/prints", check=False)
    ours = [entry for entry in records if entry.get("_TRANSPORT") == "stdout"]
    told = [entry["MESSAGE"] for entry in ours if FORGED in str(entry["MESSAGE"])]
    print(
        f"\n{len(ours)} records of the roscore of ROS, {len(told)} with forged lines, strangers reached {reached}; such as {told[0]!r}"
    )
    assert {type(entry["MESSAGE"]) for entry in ours} == {str}, "text, and no bytes"
    assert {entry["PRIORITY"] for entry in ours} == {"6"}, "as our program writes them"
    assert len(told) > 80 and all(line.startswith("roslaunch says: ") for line in told), told[:9]
    assert all(is_plain(entry["MESSAGE"]) and "  " not in entry["MESSAGE"] for entry in ours)
