# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Foreign addresses, routes and rules in the kernel, as other programs make them, and a watch over them with `ip monitor`."""

from __future__ import annotations

import time

# A second address; routes as people, configuration and bird make them; two uplinks; the rules of wg-quick, Tailscale and a policy.
SET = """
ip address replace {first}.99/24 dev eth0
ip route replace 10.50.0.0/24 via {first}.1 dev eth0
ip route replace 10.51.0.0/24 via {first}.1 dev eth0 proto static
ip route replace 10.52.0.0/24 via {first}.1 dev eth0 proto bird
ip route replace default via {first}.1 dev eth0 table 100
ip route replace throw 10.60.0.0/16 table 52
ip rule add from 10.9.0.0/24 table 100 pref 1000
ip rule add table main suppress_prefixlength 0 pref 32763
ip rule add not fwmark 51820 table 51820 pref 32764
ip rule add fwmark 0x80000/0xff0000 table main pref 5210
ip rule add table 52 pref 5270
ip -6 rule add table 52 pref 5270
"""
# Addresses without what runs out, rules, routes of all tables but those that the kernel makes of addresses.
SEEN = r"""
ip -oneline address show scope global | sed 's/ *\\.*//; s/^[0-9]*: //; s/ secondary//'
ip -4 rule; ip -6 rule
for version in 4 6; do ip -$version route show table all | grep -v -e 'proto kernel' -e 'table local' -e '^anycast' -e '^multicast'; done
true
"""
WATCH = "ip -rcvbuf 4194304 -ts monitor route rule address"


class Watch:
    """The deletions that the kernel tells within the block, and what is there before and after it."""

    def __init__(self, run, host):
        """`run(host, command)` returns what a shell command printed."""
        self._run = lambda command: run(host, command)
        self.deleted: list[str] = []

    def __enter__(self):
        self.before = self._run(SEEN).splitlines()
        self._run(
            "systemctl stop watch 2>/dev/null; rm -f /run/watch; systemd-run --quiet --collect --unit watch -p StandardOutput=file:/run/watch "
            f"-p StandardError=file:/run/watch {WATCH}; sleep 2; ip route replace 10.99.99.0/24 dev lo; ip route delete 10.99.99.0/24"
        )
        return self

    def __exit__(self, *_about):
        time.sleep(3)  # networkd works on after the command that told it
        self._run("systemctl stop watch")
        self.events = self._run("cat /run/watch").splitlines()
        deleted = [line for line in self.events if "Deleted" in line]
        assert "10.99.99.0/24" in deleted[0], f"the watch was not there from the beginning: {self.events}"
        self.deleted = deleted[1:]
        self.after = self._run(SEEN).splitlines()

    @property
    def lost(self) -> list[str]:
        """The lines that were there before and are gone."""
        return [line for line in self.before if line not in self.after]

    @property
    def new(self) -> list[str]:
        """The lines that were not there before."""
        return [line for line in self.after if line not in self.before]
