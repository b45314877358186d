# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Counters of the kernel for packets that it gives up, and rules of the packet filter that count.

A counter says neither which packet nor whose. A counter that has grown during the packet trace is a hint, in addition to the place that
the packets themselves show.
"""

import re
import typing

from ..._base.commands import run, text
from ..._machine.filters import list_written_rules

# Tables of proc(5) with a line of names and a line of numbers, and the names that mean packets given up. The kernel's
# meaning of each is in Documentation/networking/snmp_counter.rst.
TABLES = {
    "/proc/net/snmp": {
        "Ip": ("InHdrErrors", "InAddrErrors", "InUnknownProtos", "InDiscards", "OutDiscards", "OutNoRoutes", "ReasmFails", "FragFails"),
        "Icmp": ("OutTimeExcds", "InCsumErrors"),
        "Tcp": ("InErrs", "OutRsts", "InCsumErrors"),
        "Udp": ("InErrors", "RcvbufErrors", "SndbufErrors", "InCsumErrors"),
    },
    "/proc/net/netstat": {
        "IpExt": ("InNoRoutes", "InTruncatedPkts", "InCsumErrors"),
        "TcpExt": ("ListenOverflows", "ListenDrops", "TCPReqQFullDrop", "IPReversePathFilter", "ArpFilter", "TCPMemoryPressures"),
    },
}  # fmt: skip
TRACKED = "/proc/net/stat/nf_conntrack"  # a line of names, then one of hexadecimal numbers for each processor
LOST_TRACKS = ("drop", "early_drop", "insert_failed", "invalid")
DEVICES = "/proc/net/dev"
# Columns of that table: bytes, packets, errs, drop, ... of incoming packets, and the same of outgoing ones
DEVICE_COLUMNS = {2: "errors in", 3: "drops in", 10: "errors out", 11: "drops out"}
MOST_RULES = 500  # that are read
LEGACY = (
    "/proc/net/ip_tables_names"  # tables of the iptables before nftables; a line each, if the kernel has such tables
)
SAVED = re.compile(r"\[(\d+):\d+\] -A (\S+) (.*-j (?:DROP|REJECT)\b.*)")
POLICY = re.compile(r":(\S+) DROP \[(\d+):\d+\]")
COUNTED = re.compile(r"counter packets (\d+) bytes \d+")
REFUSES = re.compile(r"\b(drop|reject)\b")

Counters = typing.Dict[str, int]


def read_counters() -> Counters:
    """Read all counters that mean packets given up, by a name for people."""
    found: Counters = {}
    for path, tables in TABLES.items():
        found.update(read_table(text(path), tables))
    found.update(read_tracks(text(TRACKED)))
    found.update(read_devices(text(DEVICES)))
    found.update(read_rules())
    return found


def read_table(lines: str, tables: typing.Dict[str, typing.Tuple[str, ...]]) -> Counters:
    """Read a table of proc(5) of two lines for each group: names, then numbers."""
    rows = [line.split() for line in lines.splitlines()]
    found = {}
    for names, numbers in zip(rows[::2], rows[1::2]):
        group = names[0].rstrip(":")
        values = dict(zip(names[1:], numbers[1:]))
        found.update({f"{group}{name}": int(values[name]) for name in tables.get(group, ()) if name in values})
    return found


def read_tracks(lines: str) -> Counters:
    """Count the packets that the table of connections has given up; nothing if the kernel has no such table."""
    rows = [line.split() for line in lines.splitlines()]
    if not rows:
        return {}
    values = [dict(zip(rows[0], row)) for row in rows[1:]]
    return {f"conntrack {name}": sum(int(row.get(name, "0"), 16) for row in values) for name in LOST_TRACKS}


def read_devices(lines: str) -> Counters:
    """Read the losses of each interface."""
    found = {}
    for line in lines.splitlines()[2:]:
        name, _colon, rest = line.partition(":")
        numbers = rest.split()
        if len(numbers) > max(DEVICE_COLUMNS) and name.strip() != "lo":
            found.update({f"{name.strip()} {words}": int(numbers[column]) for column, words in DEVICE_COLUMNS.items()})
    return found


def read_rules() -> Counters:
    """Read the rules that drop or reject, and count: of nftables, and of the iptables before it. Those of iptables count always."""
    found = read_ruleset(_list("nft", "list", "ruleset"))
    if text(LEGACY).strip():  # its program would make the tables that it lists
        found.update(read_saved(_list("iptables-legacy-save", "-c")))
    return found


def _list(*command: str) -> str:
    answer = run(command, limit=5)
    return answer.text if answer.status == 0 else ""


def read_ruleset(lines: str) -> Counters:
    """Read the counting rules out of the output of `nft list ruleset`, each with its table and chain."""
    found: Counters = {}
    for table, chain, written in list_written_rules(lines.splitlines()):
        counted = COUNTED.search(written)
        if counted and REFUSES.search(written) and len(found) < MOST_RULES:
            rule = " ".join(COUNTED.sub("", written).split())
            name = f"rule of {table.partition(' ')[2]} {chain}: {rule}"
            found[name] = found.get(name, 0) + int(counted.group(1))
    return found


def read_saved(lines: str) -> Counters:
    """Read the rules and policies out of the output of `iptables-save -c`, which begins those of a table with *table."""
    found: Counters = {}
    table = ""
    for line in lines.splitlines()[:MOST_RULES]:
        saved, policy = SAVED.match(line), POLICY.match(line)
        if line.startswith("*"):
            table = line[1:].strip()
        elif policy:
            found[f"rule of {table} {policy.group(1)}: policy drop"] = int(policy.group(2))
        elif saved:
            name = f"rule of {table} {saved.group(2)}: {saved.group(3)}"
            found[name] = found.get(name, 0) + int(saved.group(1))
    return found


def find_growth(before: Counters, after: Counters) -> Counters:
    """Return the counters that have grown, and by how much. A counter that was not read before may have grown in its whole life."""
    return {name: value - before[name] for name, value in after.items() if value > before.get(name, value)}
