# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Links that lose frames, and their effects on a roscore and a subscriber."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

#: Faults that are silent and change nothing: no error for who sends, no interface that is down. (A frame that is dropped on its way
#: out would be reported to TCP, which then tries again at once, as no radio link makes it do.)
SILENT = """
table netdev lost {
  chain in { type filter hook ingress device "eth0" priority 0; policy drop; }
  chain out { type filter hook egress device "eth0" priority 0; fwd to "lo"; }
}
"""
LOSSY = """
table netdev lost {
  chain in { type filter hook ingress device "eth0" priority 0; %s numgen random mod 100 < %d drop; }
}
"""


def cut(lab, host: str) -> float:
    """Nothing goes to or from a computer any more; returns when."""
    lab.run(host, "nft -f -", stdin=SILENT)
    return time.monotonic()


def repair(lab, host: str) -> float:
    """The end of `cut`; returns when."""
    started = time.monotonic()
    lab.run(host, "nft delete table netdev lost")
    return started


@contextlib.contextmanager
def lossy(lab, hosts: Iterable[str], percent: int, kind: str = "") -> Iterator[None]:
    """Every computer loses this part of incoming packets: of every kind, or those that match words of nftables."""
    for host in hosts:
        lab.run(host, "nft -f -", stdin=LOSSY % (kind, percent))
    try:
        yield
    finally:
        for host in hosts:
            repair(lab, host)


def wait_until(look: Callable[[], object], seconds: float, what: str) -> object:
    """The result of `look`, as soon as there is one; fails with `what` after so many seconds."""
    deadline = time.monotonic() + seconds
    while not (seen := look()):
        assert time.monotonic() < deadline, f"not within {seconds:g} s: {what}"
        time.sleep(0.1)
    return seen


class Watch:
    """The registrations of the roscore of a computer, from now on; by another script, the objects of that one."""

    def __init__(
        self, lab, host: str, looks: int = 20, script: str = "observers/watch.py", patience: float = 60
    ) -> None:
        self.lab, self.host, self.unit = lab, host, f"{Path(script).stem}-{looks}"
        lab.start(host, self.unit, f"python3 {{script}} {looks}", script)
        wait_until(self.events, patience, f"the first look of {script} on {host}")

    def events(self, since: float = 0.0) -> list[tuple[float, str]]:
        """(time, event)."""
        return [(at, text) for at, text in self.lab.output(self.host, self.unit) if at >= since]

    def registrations(self) -> set[str]:
        """The registrations of the roscore now."""
        held: set[str] = set()
        for _at, text in self.events():
            sign, _space, item = text.partition(" ")
            if sign == "dead":
                held.clear()
            (held.add if sign == "+" else held.discard)(item)
        return held

    def removals(self, since: float) -> list[tuple[float, str]]:
        """(time, registration) of those that went."""
        return [(at, text[2:]) for at, text in self.events(since) if text.startswith("- ")]


def chat(lab, here: str, there: str) -> None:
    """A robot publishes /HERE/talk and hears another one's, by rospy and by roscpp (topic_tools relay, which it hears)."""
    computer, relayed = f"{here}-pc", f"/{here}/relayed"
    lab.start(computer, "relay", f"rosrun topic_tools relay /{there}/talk {relayed} __name:={here}_relay")
    words = f"{here}_chatter +/{here}/talk /{there}/talk {relayed}"
    lab.start(computer, "chatter", f"python3 {{script}} {words}", "programs/chatter.py")


def message_times(lab, here: str, since: float = 0.0) -> dict[str, list[float]]:
    """The times at which messages came, by the client library: "roscpp", "rospy"."""
    found: dict[str, list[float]] = {"roscpp": [], "rospy": []}
    for at, text in lab.output(f"{here}-pc", "chatter"):
        if at >= since:
            found["roscpp" if "/relayed" in text else "rospy"].append(at)
    return found


def measure_recovery(times: list[float], since: float, to: float, gap: float = 1.0) -> float:
    """Seconds from `since` to the first message after which no message is missing for longer than `gap` seconds."""
    times = [since, *(at for at in times if since < at < to), to]
    after = [later for earlier, later in zip(times, times[1:]) if later - earlier > gap]
    return (after[-1] if after else times[1]) - since
