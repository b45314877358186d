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
from links import until
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
    until(lambda: len(masters(lab)) == 2, 30, "both masters")
    lab.run(PEER, f"ip address add {ROGUE}/24 dev eth0; cat > /run/rogue.py", stdin=(NODES / "rogue.py").read_text())
    yield lab
    lab.run(PEER, f"ip address del {ROGUE}/24 dev eth0")
    # Nodes that were shut down were started again: the next tests count from here.
    lab.run(VICTIM, "systemctl reset-failed 'multimaster-*'")


@pytest.mark.parametrize("who", IDENTITIES)
def test_whoever_does_not_belong_to_the_fleet_is_named_and_ignored(fleet, who):
    uri, name, why = IDENTITIES[who]
    before = masters(fleet)
    fleet.run(VICTIM, "systemctl restart multimaster-discovery")  # what it knows of strangers is of this test alone
    until(lambda: masters(fleet) == before, 30, "the same masters again")
    since = time.time()
    called = json.loads(fleet.run(PEER, f"python3 /run/rogue.py {ROGUE} {ADDRESS} {uri} {name} {SECONDS}"))
    assert 1 <= called["connections"] <= 2 and set(called["methods"]) == {"masterContacts"}, called
    assert called["answers"] == 0, "its datagrams are not answered"
    assert masters(fleet) == before
    held = fleet.run(VICTIM, "rostopic list")
    assert "/rogue/cmd_vel" not in held
    log = fleet.run(VICTIM, f"journalctl --unit multimaster-discovery --output cat --since @{since - 1:.0f}")
    assert log.count(f"{name} ({uri}) at {ROGUE} is ignored: {why}") == 1, log
    ask = f"import xmlrpc.client as x; print(x.ServerProxy('http://{ADDRESS}:11611').getOutsiders()[1])"
    assert f"['{ROGUE}', '{name}', '{uri}', '{why}']" in fleet.run(VICTIM, f'python3 -c "{ask}"')


#: Calls of anybody with a text of his own: shutdown(caller, reason) of nodes, and methods of the roscore with names that are none.
CALLS = """
import json, sys, time, xmlrpc.client
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
    until(lambda: masters(fleet) == before, 60, "the same masters again")
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
