# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""docs/operate/security.md and the tests: what the page promises has a test beside it, and each test that a page names is there.

On the page, `[✓][name]` stands beside a promise; `name` is defined at the end of the page, with a file and its tests. A sentence
without a mark explains, and is in EXPLAINS. What stays open is in the sections OPEN, and the attacks have a table of their own.
"""

import ast
import re
import sys
from pathlib import Path

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._client import documents, node, xml_rpc
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import ros
from ansible_collections.rosfleet.multimaster.plugins.module_utils._module import trust
from ansible_collections.rosfleet.multimaster.plugins.module_utils._process import commands, foreign
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._answers import answer
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._changes import robot_action

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "roles/nodes/files/python"))

from rosfleet_multimaster import end_connections  # noqa: E402
from rosfleet_multimaster.discovery.core import report as report_of_discovery  # noqa: E402
from rosfleet_multimaster.edge import rpc_client, rpc_server  # noqa: E402
from rosfleet_multimaster.sync.core import limits  # noqa: E402
from rosfleet_multimaster.sync.core import report as report_of_sync  # noqa: E402

PAGE = (ROOT / "docs/operate/security.md").read_text(encoding="utf-8")
PAGES = sorted(
    page for page in [*ROOT.glob("docs/**/*.md"), ROOT / "README.md"] if page.name != "adding.md"
)  # it has examples
NAMED = re.compile(r"tests/[\w/.]*test_\w+\.py")

ATTACKS = "Attacks, and the test of each"
OPEN = ("What is not defended", ATTACKS, "How to report a flaw")
MARK = re.compile(r"\s*\[✓\]\[([\w-]+)\]")
DEFINITION = re.compile(r'^\[([\w-]+)\]: \.\./\.\./(tests/\S+)(?: "([^"]+)")?$', re.MULTILINE)
END = re.compile(r"(?<=[.?!])\s+(?=[A-Z`*])")  # of a sentence, where another one begins
ITEM = re.compile(r"^(?:[*-]|\d\.) ", re.MULTILINE)

#: the columns of tables in which promises stand; the others say what a row is about
PROMISING = {
    *("may not", "who gets its variables", "guard", "what the controller does", "what it lets in", "bound"),
    *("where it is made plain", "rating", "on each computer", "what the collection does"),
    "through gateways and the Linux router, to the robots' networks",
}

#: What only explains.
EXPLAINS = set(
    """
For the person who must answer for the robots.
A ✓ beside a promise leads to the test that shows it.
What has none only explains.
Three things to know first:
**ROS 1 has no authentication**: who reaches the roscore (TCP 11311) or a node (a port from 1024 up) can read every topic, send commands and end
  nodes.
No software beside ROS can change that.
A robot may be in foreign hands, and its Python with it.
So what it answers is data, and no order to Ansible ([architecture](../develop/architecture.md#an-answer)).
**Heartbeats** can have any sender.
For guests there are two variables, both for the whole fleet:
The answer to a question may be anything.
So each answer has bounds, and all of them together have bounds too:
It listens at all addresses, since the planned one may come late.
Not made plain by us: what Ansible's own search for a Python shows of a robot, where Python says that it hangs (`faulthandler`: names of our files
  and functions), and what other services of a robot write to its journal.
The rating is that of `systemd-analyze security`, from 10 (no sandbox) to 0.
A roscore that something else starts (`multimaster_roscore: existing`) has none of it.
What is not there, and why:
`IPAddressDeny=` for ROS: a laptop with rviz that is in no inventory must reach the roscore while `multimaster_firewall` is `none`.
`PrivateUsers=`: the services have no right that it could take.
Kernels and containers without user namespaces would not start them.
`MemoryDenyWriteExecute=`: ctypes of Python 3.8 maps such memory, and rospy uses it.
`ProcSubset=`: psutil and roslaunch read `/proc`.
A watchdog of the roscore of upstream's nodes: it does not know `sd_notify`, and a second process that asked it would be judged, not the roscore.
ROS listens there: the roscore, discovery, and every node on a port of its own.
Without ufw and firewalld, a computer needs `nft`, a kernel with nftables, and the right to make a network namespace (`unshare --net`), in which the
  rules are tried first.
What it does not do:
A host on the same network can send a datagram with the address of another robot.
See [hostile networks](hostile_networks.md).
Beside ufw and firewalld, the kernel alone drops a packet from a wire with the computer's own address of IPv4: where `net.ipv4.conf.*.accept_local`
  is 1, which is not the default, such a packet passes as one of a member does.
It does not filter what a computer sends, and no ports below 1024.
A stranger who talks to a port when the filter comes goes on until the connection ends; by UDP, until half a minute (after a longer exchange, two
  minutes) has passed in silence.
Ports that containers publish are passed on to the container, not to the computer: they stay as docker opens them.
Containers with a network of their own (docker's bridge) come with their own address, which is no member's: their nodes do not reach the roscore of
  their own computer.
Where you have rules of your own in nftables or iptables, without ufw and firewalld, a packet must pass both.
What they drop stays dropped, for members too.
`nft flush ruleset`, or nftables.service that somebody starts for the first time, removes the table.
Names by mDNS (`robot.local`, UDP 5353) are answered to members only.
Reach the robots by address or by a name of your own.
""".strip()
    .replace("\n  ", " ")
    .splitlines()
)

KIB, MIB = 1 << 10, 1 << 20
#: words of the page -> the same in code
FIGURES = {
    "(`multimaster: strangers`)": report_of_discovery.outsiders([]).name == "multimaster: strangers",
    "(`multimaster: places`)": "multimaster: places" in {entry.name for entry in report_of_sync.diagnoses([])},
    "at most 64 KiB of variables": ros._LARGEST / KIB == 64,
    "one line of JSON of at most 256 KiB": foreign._LONGEST / KIB == 256,
    "64 KiB a question, 900 connections, 10 s": (node._BYTES / KIB, node._CONNECTIONS, node.REQUEST) == (64, 900, 10),
    "root's files stay as they are [✓][verified]; 4 MiB": commands.MOST / MIB == 4,
    "10,000 parts of paths and 5 s": (trust.MOST, trust.LIMIT) == (10_000, 5),
    "more than 16 Mi characters, a million values, 24 of them in each other, a number of more than 20 digits": (
        (answer.MOST_TEXT / MIB, answer.MOST_VALUES, answer.DEEPEST, answer.DIGITS) == (16, 1_000_000, 24, 20)
    ),
    "more than 96 MiB while it comes, or for more than half an hour": (robot_action.MEMORY / MIB, robot_action.LONGEST)
    == (96, 1800),
    "| an answer of another computer | 64 KiB": documents.ANSWER / KIB == 64,
    "| of a node of this robot | 2 MiB": documents.NODE / MIB == 2,
    "| the state of a master, and what the own roscore says | 16 MiB": documents.STATE / MIB == 16,
    "and 1 MiB, but 25 MiB at most": (documents._SPARE / MIB, (documents._SPARE + documents._DEAR) / MIB) == (1, 25),
    "| 100 elements, 400 digits, 4 MiB, 128 KiB": (
        (documents._NESTING, documents._NUMBER, documents._TEXT / MIB, documents._TOKEN / KIB) == (100, 400, 4, 128)
    ),
    "| 32 KiB together": rpc_client._HEAD / KIB == 32,
    "one above 512 KiB": rpc_client.SMALL / KIB == 512,
    "5,000 of its own": limits.MOST == 5000,
    "has 64 connections, 8 for one address, 15 s each": (
        (rpc_server._MAX_CONNECTIONS, rpc_server._MAX_PER_ADDRESS, rpc_server._MAX_SECONDS) == (64, 8, 15)
    ),
    "with 5 s for a call": xml_rpc.CALL == 5,
    "256 connections a second at most": end_connections.PER_SECOND == 256,
}


def section(title):
    return PAGE.partition(f"\n## {title}\n")[2].partition("\n## ")[0]


def sections():
    """The text of each section that promises; the beginning of the page is one."""
    begin, *parts = DEFINITION.sub("", PAGE.partition("-->")[2]).split("\n## ")
    assert set(OPEN) <= {part.partition("\n")[0] for part in parts}
    return [begin.partition("# Security\n")[2]] + [
        part.partition("\n")[2] for part in parts if part.partition("\n")[0] not in OPEN
    ]


def cells_of(table):
    """The texts in the promising columns of a table."""
    header, _line, *rows = [[cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]] for line in table]
    columns = [at for at, name in enumerate(header) if name in PROMISING]
    assert columns, header
    for row in rows:
        assert len(row) == len(header), row
        yield from (row[at] for at in columns if row[at])


def texts():
    """Each paragraph, item of a list and cell."""
    for part in sections():
        for block in re.split(r"\n\s*\n", part):
            lines = block.strip().splitlines()
            if lines and lines[0].startswith("|"):
                yield from cells_of(lines)
            else:
                yield from filter(None, map(str.strip, ITEM.split(block)))


def sentences():
    """(the names of its tests, its words) of each sentence."""
    for text in texts():
        for sentence in END.split(" ".join(text.split())):
            yield MARK.findall(sentence), MARK.sub("", sentence)


def test_a_sentence_has_a_test_or_only_explains():
    found = list(sentences())
    promises = [words for names, words in found if names]
    explains = {words for names, words in found if not names}
    assert sorted(explains - EXPLAINS) == [], "these promise something: name their tests, or put them into EXPLAINS"
    assert sorted(EXPLAINS - explains) == [], "these are no longer on the page, or have a test"
    assert len(promises) > 150 > 2 * len(explains)


def test_each_mark_is_defined_and_each_definition_is_used():
    names = [name for name, _path, _tests in DEFINITION.findall(PAGE)]
    used = set(MARK.findall(PAGE))
    assert len(names) == len(set(names)) > 100
    assert used == set(names)
    assert len(re.findall(r"^\[[^\]]+\]:", PAGE, re.MULTILINE)) == len(names), "each line at the end is a definition"
    assert PAGE.count("[✓]") == sum(1 for _mark in MARK.finditer(PAGE)), "each mark has a name"


@pytest.mark.parametrize(
    ("path", "tests"), [(path, tests) for _name, path, tests in DEFINITION.findall(PAGE)], ids=lambda text: text
)
def test_each_test_beside_a_promise_is_there(path, tests):
    assert NAMED.fullmatch(path), path
    body = ast.parse((ROOT / path).read_text(encoding="utf-8")).body
    there = {entry.name for entry in body if isinstance(entry, ast.FunctionDef) and entry.name.startswith("test_")}
    assert there
    assert set(filter(None, tests.split(", "))) <= there


@pytest.mark.parametrize("words", FIGURES)
def test_a_figure_of_the_page_is_that_of_the_code(words):
    assert words in " ".join(PAGE.split())
    assert FIGURES[words]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_test_that_a_page_names_is_there(page):
    assert [name for name in NAMED.findall(page.read_text()) if not (ROOT / name).is_file()] == []


def test_every_attack_has_a_test():
    rows = [line for line in section(ATTACKS).splitlines() if line.startswith("| ")][1:]
    assert len(rows) > 30
    for row in rows:
        tests = row.rsplit("|", 2)[1]
        assert NAMED.search(tests), row
        assert set(re.findall(r"[\w/]*test_\w+\.py", tests)) == set(NAMED.findall(tests)), row
