# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Changes of a fault in the lab itself, between the computers: a word each. All of it is of the lab's own networks."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Mapping
from pathlib import Path

from machines import containers
from machines.podman import podman

COMMON = "192.168.1.0/24"
STRANGER, STRANGERS_ADDRESS = "stranger", "192.168.1.66"
FLAPPING = "kobuki-pc"
TWIN = "192.168.1.229"  # of kobuki-pc
DOWN, UP = 1.0, 2.0  # seconds
LONGEST = 300.0  # seconds that a link flaps at most
CLASS = Path("/sys/class/net")

# A general query of IGMPv3 (RFC 3376, 4.1), once, from a computer that has no part in the fleet. All members answer it for
# themselves; to one of IGMPv2 those are silent who hear the answer of another one, and the switch keeps what it knew of them.
QUERY = """
import socket
query = bytes([0x11, 10, 0xEC, 0x78, 0, 0, 0, 0, 2, 125, 0, 0])
with socket.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_IGMP) as sender:
    sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("%s"))
    sender.sendto(query, ("224.0.0.1", 0))
"""


class Words:
    """The words, and what they need to take it back."""

    def __init__(self, lab) -> None:
        self.lab = lab
        self._steady = threading.Event()
        self._flapping: threading.Thread | None = None

    def say(self, word: str) -> None:
        """Do what a word means."""
        WORDS[word](self)

    def _bridge(self) -> Path:
        name = f"{containers.CHECKOUT}-{self.lab.name}-{COMMON.replace('/', '-')}"
        return CLASS / json.loads(podman("network", "inspect", name))[0]["network_interface"] / "bridge"

    def snooping(self, membership: float = 5.0) -> None:
        """The switch snoops, and has heard a querier that is gone: what nobody reports for some seconds is pruned."""
        bridge = self._bridge()
        # The querier is missed after an hour (hundredths of seconds).
        settings = (("membership_interval", round(100 * membership)), ("querier_interval", 360000), ("snooping", 1))
        for name, value in settings:
            (bridge / f"multicast_{name}").write_text(str(value))
        self.lab.run(STRANGER, "python3 -", stdin=QUERY % STRANGERS_ADDRESS)

    def flooding(self) -> None:
        """The switch sends everything everywhere."""
        (self._bridge() / "multicast_snooping").write_text("0")

    def flapping(self) -> None:
        """The other end of a computer's cable goes and comes."""
        number = self.lab.run(FLAPPING, "cat /sys/class/net/eth0/iflink").strip()
        cable = next(path.name for path in CLASS.iterdir() if (path / "ifindex").read_text().strip() == number)
        self._steady.clear()
        self._flapping = threading.Thread(target=self._flap, args=(cable,), daemon=True)
        self._flapping.start()
        threading.Event().wait(3 * (DOWN + UP))

    def _flap(self, cable: str) -> None:
        for _time in range(int(LONGEST / (DOWN + UP))):
            _set(cable, "down")
            stopped = self._steady.wait(DOWN)
            _set(cable, "up")
            if stopped or self._steady.wait(UP):
                return

    def steady(self) -> None:
        """The end of `flapping`."""
        self._steady.set()
        if self._flapping:
            self._flapping.join()

    def rogue(self) -> None:
        """A master that is in no inventory."""
        words = f"{STRANGERS_ADDRESS} 226.0.0.0 http://rogue:11311/ rogue {LONGEST:.0f}"
        self.lab.start(STRANGER, "rogue", f"python3 {{script}} {words}", "hostile/rogue.py")

    def no_rogue(self) -> None:
        """The end of `rogue`. The discovery nodes forget it by and by; so they begin anew."""
        self.lab.stop(STRANGER, "rogue")
        for host in ("kobuki-pc", "tibi-gate", "dabo-gate"):
            self.lab.run(host, "systemctl restart multimaster-discovery")

    def twin_address(self) -> None:
        """A computer that has no part in the fleet takes the address of one that has."""
        self.lab.run(STRANGER, f"ip address add {TWIN}/24 dev eth0")

    def own_address(self) -> None:
        """The end of `twin_address`."""
        self.lab.run(STRANGER, f"ip address del {TWIN}/24 dev eth0")
        for host in ("tibi-gate", "dabo-gate"):
            self.lab.run(host, f"ip neighbour flush to {TWIN}")


def _set(cable: str, state: str) -> None:
    # IFF_UP is the lowest bit; the kernel takes it by the file as by `ip link set`.
    path = CLASS / cable / "flags"
    flags = int(path.read_text(), 16)
    path.write_text(hex(flags | 1 if state == "up" else flags & ~1))


WORDS: Mapping[str, Callable[[Words], None]] = {
    "snooping": Words.snooping,
    "flooding": Words.flooding,
    "flapping": Words.flapping,
    "steady": Words.steady,
    "rogue": Words.rogue,
    "no-rogue": Words.no_rogue,
    "twin-address": Words.twin_address,
    "own-address": Words.own_address,
}
