# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The messages between two robots in their order: from a new publisher to a message, and the calls of the protocol."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate
from typing import NamedTuple

from rosfleet_multimaster.discovery.core.announcements import REPEAT_CHANGES
from rosfleet_multimaster.protocol.differences import DIFFERENCES
from rosfleet_multimaster.protocol.heartbeat import SIZE

from .sheet import EDGE, LINE, WIDTH, Sheet, measure
from .shipped import find_master, read_plan

STEP = 40  # between two messages
TOP = 62  # of the lines below the names


class Message(NamedTuple):
    """An arrow from a line to another, by their numbers, with its text; `kind` as of a line of the sheet."""

    begin: int
    end: int
    text: str
    kind: str = "line"
    both: bool = False


def _draw(sheet: Sheet, robots: Sequence[Sequence[str]], messages: Sequence[Message]) -> int:
    """Draw a line of life for each program of two robots, and the messages; return the height."""
    names = [name for programs in robots for name in programs]
    spare = (WIDTH - 2 * EDGE - sum(map(measure, names))) / len(names)
    ends = list(accumulate((measure(name) + spare for name in names), initial=float(EDGE)))
    places = [(begin + end) / 2 for begin, end in zip(ends, ends[1:])]
    bottom = TOP + STEP * len(messages) + 12
    first = 0
    for letter, programs in zip("AB", robots):
        left, right = ends[first], ends[first + len(programs)]
        sheet.frame(left + 2, EDGE, right - left - 4, bottom - EDGE)
        sheet.text((left + right) / 2, 29, f"robot {letter}", "strong middle")
        first += len(programs)
    for x, name in zip(places, names):
        sheet.text(x, 50, name, "middle")
        sheet.line(complex(x, 56), complex(x, bottom - 6), "life")
    for number, message in enumerate(messages):
        y = TOP + STEP * number + 26
        begin, end = places[message.begin], places[message.end]
        sheet.arrow(complex(begin, y), complex(end, y), message.kind, message.both)
        _label(sheet, (begin + end) / 2, y - 7, message.text)
    return bottom + EDGE


def _label(sheet: Sheet, middle: float, y: float, words: str) -> None:
    """Write the text of a message above its arrow, as near to its middle as the sheet allows."""
    half = measure(words) / 2 + EDGE + 4
    sheet.text(min(max(middle, half), WIDTH - half), y, words, "middle onpale")


def _list_times() -> str:
    """Return the times after a change at which it is announced, in seconds."""
    *former, last = (f"{seconds:g}" for seconds in REPEAT_CHANGES)
    return f"{', '.join(former)} and {last} s"


def draw_exchange() -> str:
    """Draw the steps from a new publisher to its first message on the other robot."""
    fleet = read_plan("single_computer")
    rpc = find_master(fleet, next(iter(fleet.master_of))).discovery["rpc_port"]
    sheet = Sheet()
    node, roscore, discovery, listener, sync, other, subscriber = range(7)
    robots = (("node", "roscore", "discovery"), ("discovery", "sync", "roscore", "node"))
    height = _draw(
        sheet,
        robots,
        (
            Message(node, roscore, "1 registers"),
            Message(roscore, discovery, "2 change"),
            Message(discovery, listener, f"3 heartbeat, UDP {fleet.multicast_port}, after {_list_times()}"),
            Message(discovery, sync, f"4 the change, TCP {rpc}"),
            Message(sync, other, "5 registers"),
            Message(other, subscriber, "6 tells"),
            Message(node, subscriber, "7 messages, directly from node to node", "line data"),
        ),
    )
    return sheet.finish(
        height,
        "From a new publisher on robot A to a message on robot B",
        "The node registers at the roscore of A, and that tells discovery of A. Its heartbeat announces the change to discovery of "
        "B. Sync of B gets the change from discovery of A, and registers the publisher in the roscore of B. That tells the "
        "subscriber, which connects to the publisher directly.",
    )


def draw_protocol() -> str:
    """Draw the datagrams and calls between two robots, from the first heartbeat to the loss."""
    fleet = read_plan("single_computer")
    plan = find_master(fleet, next(iter(fleet.master_of)))
    rate, patience = plan.discovery["heartbeat_hz"], plan.discovery["offline_after"]
    sheet = Sheet()
    giver, taker, sync = range(3)
    height = _draw(
        sheet,
        (("discovery",), ("discovery", "sync")),
        (
            Message(giver, taker, f"state: {SIZE} bytes, {rate:g} each second"),
            Message(taker, giver, "masterContacts: who are you"),
            Message(sync, giver, f"{DIFFERENCES}: what do you have"),
            Message(giver, sync, "the whole state"),
            Message(sync, giver, f"{DIFFERENCES}, waits for a change"),
            Message(giver, taker, f"state: new stamp, at {_list_times()}"),
            Message(giver, sync, "the change alone"),
            Message(taker, giver, "silent: request, masterContacts"),
            Message(taker, sync, f"no answer for {patience:g} s: offline"),
        ),
    )
    sheet.text(EDGE + 8, height + LINE, f"state, request: UDP {fleet.multicast_port}", "soft")
    sheet.text(EDGE + 8, height + 2 * LINE, f"masterContacts, {DIFFERENCES}: TCP {plan.discovery['rpc_port']}", "soft")
    return sheet.finish(
        height + 2 * LINE + EDGE,
        "The datagrams and calls between two robots",
        "Discovery of A sends its state each second. Discovery of B asks who it is. Sync of B asks once for the whole state, and then "
        "waits for changes. If A is silent, discovery of B asks it, and without an answer sync of B withdraws its registrations.",
    )
