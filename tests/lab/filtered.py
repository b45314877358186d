# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A lab with packet filters: three robots with a back end each, and a computer on their network that is no robot."""

import contextlib
import json

import containers
from layout import Extra
from podman import ROOT
from subject import Lab

INVENTORY = ROOT / "tests" / "systems" / "firewall"
STRANGER = "stranger"
EXTRAS = {STRANGER: Extra(("192.168.20.99/24",))}
ROBOTS = {"ana-pc": "192.168.20.21", "bob-pc": "192.168.20.22", "cid-pc": "192.168.20.23"}

# What an owner has set up before us, with a port that is open to everybody.
BEFORE = {
    "bob-pc": "ufw allow 22/tcp && ufw allow 8080/tcp && ufw --force enable",
    "cid-pc": "systemctl unmask firewalld && systemctl enable --now firewalld && "
    "firewall-cmd --permanent --add-port=8080/tcp && firewall-cmd --reload",
}
# A port of TCP and of UDP that answers everybody.
ECHO = 11999
ECHOES = f"""
import socket
udp, tcp = socket.socket(type=socket.SOCK_DGRAM), socket.socket()
udp.bind(("", {ECHO}))
tcp.bind(("", {ECHO}))
tcp.listen(100)
while True:
    data, sender = udp.recvfrom(100)
    try:
        udp.sendto(data, sender)
    except OSError as problem:
        print(problem, flush=True)
"""
# Our rules, as the program itself shows them.
SHOWN = {
    "ana-pc": "nft list table inet rosfleet_multimaster",
    "bob-pc": "ufw status",
    "cid-pc": "firewall-cmd --policy=rosfleet-input --list-rich-rules",
}


class Filtered(Lab):
    """The lab, and what a stranger finds in it."""

    def look(self, host, *addresses, first=1024, last=65535):
        """What a computer finds on others: address -> {"tcp": ports, "udp": ports}."""
        text = (ROOT / "tests/lab/nodes/stranger.py").read_text()
        return json.loads(self.run(host, f"python3 - {first} {last} {' '.join(addresses)}", stdin=text))

    def echo(self, host):
        """Let something on a robot answer everybody."""
        unit = "systemd-run --quiet --collect --unit echo python3 /run/echo.py"
        self.run(host, f"cat >/run/echo.py; systemctl stop echo 2>/dev/null; {unit}", stdin=ECHOES)

    def shows(self, host):
        """Our rules on a robot, by the program that has them; empty where there are none."""
        return self.run(host, SHOWN[host], check=False)


@contextlib.contextmanager
def filtered_lab(name):
    """The lab with the owners' own packet filters, until the end of the block."""
    containers.down(name)
    try:
        lab = Filtered(name, INVENTORY, EXTRAS)
        for host, command in BEFORE.items():
            lab.run(host, command)
        for host in ROBOTS:
            lab.echo(host)
        yield lab
    finally:
        containers.down(name)
