# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Packets in a foreign name, each 5 ms, while something happens to the computer that they are for."""

from __future__ import annotations

import collections
import json
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

PORT, GROUP, GROUP6 = 5000, "226.0.0.0", "ff02::77"
HEARER, FORGER, TICKER = "hearer", "forger", "ticker"
SECONDS = 120  # at most


class Attack(NamedTuple):
    """A computer on the network below that sends in a foreign name, and one of the fleet that sends in its own."""

    stranger: str
    at: str  # the computer whose hardware address the packets have: the target, or the gateway to it; empty for that of all
    target: str
    packets: Sequence[tuple[str, str]]  # source and destination
    honest: tuple[str, str]  # a computer of the fleet, and the address at which it sends to the target


def hear(lab, host: str) -> None:
    """Start to write down the packets that come to a computer."""
    lab.start(host, HEARER, f"python3 {{script}} eth0 {PORT} {GROUP} {GROUP6}", "observers/hearer.py")
    lab.run(host, f"timeout 20 sh -c 'until grep -q listens /run/{HEARER}.out; do sleep 0.1; done'")


def send(lab, attack: Attack) -> None:
    """Start both senders, for two minutes at most."""
    mac = lab.run(attack.at, "cat /sys/class/net/eth0/address").strip() if attack.at else "ff:ff:ff:ff:ff:ff"
    words = json.dumps([["udp", *packet] for packet in attack.packets])
    lab.run(attack.stranger, "cat > /run/forged.json", stdin=words)
    command = f"python3 {{script}} eth0 {mac} {PORT} {SECONDS} < /run/forged.json"
    lab.start(attack.stranger, FORGER, command, "hostile/forger.py")
    sender, address = attack.honest
    lab.start(sender, TICKER, f"python3 {{script}} {address} {PORT} {SECONDS}", "observers/ticker.py")


def stop(lab, attack: Attack) -> int:
    """End both senders. Returns the number of times that the stranger has sent all. It never ends by itself."""
    lab.run(attack.stranger, f"systemctl is-active {FORGER}")
    lab.stop(attack.stranger, FORGER)
    lab.run(attack.honest[0], f"systemctl stop {TICKER}", check=False)
    return int(lab.run(attack.stranger, f"cat /run/{FORGER}.out"))


def count(lab, attack: Attack, actions: Iterable[Callable[[], object]]) -> collections.Counter:
    """Let things happen to the target during the attack. Returns how many came by their text, and how often all were sent as "rounds"."""
    hear(lab, attack.target)
    try:
        send(lab, attack)
        lab.run(attack.target, "sleep 1")
        for action in actions:
            action()
        lab.run(attack.target, "sleep 0.5")
        rounds = stop(lab, attack)
    finally:
        lab.stop(attack.target, HEARER)  # it first prints all that came
    found = collections.Counter(lab.run(attack.target, f"cat /run/{HEARER}.out").splitlines()[1:])
    found["rounds"] = rounds
    return found
