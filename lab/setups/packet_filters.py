# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A lab with packet filters: robots, and a computer on their network that is no robot."""

import contextlib
import json
import re
from pathlib import Path
from typing import NamedTuple

from machines import containers
from machines.layout import Extra, hosts_of, read_inventory
from machines.podman import ROOT
from subject import Lab

PLAYBOOK = "tests/systems/firewall.yml"
STRANGER = "stranger"
EXTRAS = {STRANGER: Extra(("192.168.20.99/24",))}
NARROW = {"first": 11300, "last": 12000}  # the ports of roscore and discovery, and the one that answers everybody


class Filter(NamedTuple):
    """A program that filters packets, as commands for a shell."""

    before: str  # the set-up by the owner before ours, with a port that is open to everybody
    shows: str  # shows our rules
    removes: str  # removes a rule of ours


FILTERS = {
    "nftables": Filter(
        "true",
        "nft list table inet rosfleet_multimaster",
        "nft flush chain inet rosfleet_multimaster input",
    ),
    "ufw": Filter(
        "ufw allow 22/tcp && ufw allow 8080/tcp && ufw --force enable",
        "ufw status",
        "ufw --force delete deny proto tcp from 0.0.0.0/0 to any port 1024:65535",
    ),
    "firewalld": Filter(
        "systemctl unmask firewalld && systemctl enable --now firewalld && "
        "firewall-cmd --permanent --add-port=8080/tcp && firewall-cmd --reload",
        "firewall-cmd --policy=rosfleet-input --list-rich-rules",
        "firewall-cmd --policy=rosfleet-input --remove-rich-rule="
        "'rule priority=-1 port port=1024-65535 protocol=tcp drop'",
    ),
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
# A port, and groups, at which a robot waits for forged packets.
HEARS, GROUP, GROUP6 = 5000, "226.0.0.0", "ff02::77"
# Settings by which a kernel takes own addresses and those of the loopback interface from a wire, and any sender by any way.
CARELESS = " ".join(
    f"net.ipv4.conf.{name}.{setting}"
    for name in ("all", "eth0")
    for setting in ("accept_local=1", "route_localnet=1", "rp_filter=0")
)
FILES = (
    "/etc/rosfleet-multimaster/firewall.nft /etc/systemd/system/multimaster-firewall.service "
    "/etc/firewalld/policies/rosfleet-*.xml /var/lib/rosfleet-multimaster/files-firewall.json"
)


class FilterLab(Lab):
    """The lab, and the findings of a stranger in it."""

    def __init__(self, name, inventory, filters, mounts=()):
        """`filters`: the packet filter of each computer, a key of FILTERS."""
        extras = {**EXTRAS, **{host: Extra((), mounts) for host in filters}}
        super().__init__(name, inventory, extras)
        self.everybody = [host.name for host in hosts_of(read_inventory(inventory), extras)]
        self.filters = {host: FILTERS[program] for host, program in filters.items()}
        variables = read_inventory(inventory)["_meta"]["hostvars"]
        self.addresses = {host: variables[host]["multimaster_address"] for host in filters}
        for host, own in self.filters.items():
            self.run(host, own.before)
            self.echo(host)

    def look(self, host, *addresses, first=1024, last=65535):
        """The findings of a computer on others: address -> {"tcp": ports, "udp": ports}."""
        text = (ROOT / "lab/nodes/hostile/stranger.py").read_text()
        return json.loads(self.run(host, f"python3 - {first} {last} {' '.join(addresses)}", stdin=text))

    def echo(self, host):
        """Let something on a robot answer everybody."""
        unit = "systemd-run --quiet --collect --unit echo python3 /run/echo.py"
        # systemd-run returns before the program has its ports: the one of TCP is the last.
        there = f"timeout 30 bash -c 'until ss -Hltn sport = :{ECHO} | grep -q .; do sleep 0.1; done'"
        self.run(host, f"cat >/run/echo.py; systemctl stop echo 2>/dev/null; {unit} && {there}", stdin=ECHOES)

    def cold_boot(self, *hosts):
        """Boot computers; they come back with other hardware addresses, which everybody learns at once."""
        for host in hosts:
            self.reboot(host)
        for host in hosts:
            self.wait_until_up(host)
            self.echo(host)
        for host in self.everybody:
            self.run(host, "ip neighbour flush all")

    def shows(self, host):
        """Our rules on a robot, by the program that has them; empty if the robot has no rules of ours."""
        return self.run(host, self.filters[host].shows, check=False)

    def play_filter(self, *options, **variables):
        """Run the part of site.yml that is about the packet filter; returns how much it changed: host -> number."""
        status, output = self.play(PLAYBOOK, *options, variables=variables)
        assert status == 0, output
        return {host: int(changed) for host, changed in re.findall(r"([\w-]+) : ok=\d+ changed=(\d+)", output)}

    # The common expectations of the tests of packet filters

    def keeps_strangers_out(self, **ports):
        """A stranger finds no port and no answer."""
        addresses = self.addresses.values()
        assert self.look(STRANGER, *addresses, **ports) == {address: {"tcp": [], "udp": []} for address in addresses}

    def forges(self, host, *packets, protocol="udp"):
        """The stranger sends a robot packets with any source: pairs of source and destination. Returns the packets that the robot hears."""
        mac = self.run(host, "cat /sys/class/net/eth0/address").strip()
        self.start(host, "hearer", f"python3 {{script}} eth0 {HEARS} {GROUP} {GROUP6}", "observers/hearer.py")
        try:
            self.run(host, "until grep -q listens /run/hearer.out; do sleep 0.1; done")
            for name, to in (("hostile/forger.py", STRANGER), ("programs/self_talker.py", host)):
                self.run(to, f"cat >/run/{Path(name).name}", stdin=(ROOT / "lab/nodes" / name).read_text())
            words = json.dumps([[protocol, *packet] for packet in packets])
            self.run(STRANGER, f"python3 /run/forger.py eth0 {mac} {HEARS}", stdin=words)
            own = [place for place in self.list_own_places(host) if place != "::1"]
            self.run(host, f"python3 /run/self_talker.py eth0 {HEARS} {' '.join(own)}; sleep 0.5")  # they come in
        finally:
            self.stop(host, "hearer")  # it first prints all that came
        return self.run(host, "cat /run/hearer.out").splitlines()[1:]

    def list_own_places(self, host):
        """The addresses of a robot, and the groups at which it waits."""
        local = self.run(host, "ip -6 -o address show dev eth0 scope link").split()[3].partition("/")[0]
        return [self.addresses[host], "127.0.0.1", GROUP, local, "::1", GROUP6]

    def takes_nothing_in_its_own_name(self):
        """No robot takes a packet from a wire that has the robot's own address, or one of the loopback interface, as its source."""
        for host, address in self.addresses.items():
            member = next(other for other in self.addresses.values() if other != address)
            four, six = (self.list_own_places(host)[start : start + 3] for start in (0, 3))
            own = [(source, place) for places in (four, six) for source in places[:2] for place in places]
            packets = [
                *own,
                ("127.9.9.9", address),
                ("192.168.20.99", address),
                ("fe80::99", six[0]),
                (member, address),
            ]
            self.run(host, f"sysctl -qw {CARELESS if self.checks_ipv4(host) else ''} net.ipv4.conf.all.rp_filter=0")
            heard = self.forges(host, *packets)
            assert [line for line in heard if not line.startswith("itself")] == [f"{member} > {address}"], (host, heard)
            assert {f"itself > {place}" for place in (address, "127.0.0.1", six[0])} <= set(heard), (host, heard)
            if self.checks_ipv4(host):
                assert {f"itself > {place}" for place in (GROUP, GROUP6)} <= set(heard), (host, heard)

    def checks_ipv4(self, host):
        """True if the packet filter knows an own address from a member's; ufw and firewalld leave that to the kernel."""
        return self.filters[host] is FILTERS["nftables"]

    def lets_members_in(self):
        """Each robot reaches the roscore and discovery of the others, and the ports that answer everybody."""
        for host in self.addresses:
            others = [address for other, address in self.addresses.items() if other != host]
            for found in self.look(host, *others, **NARROW).values():
                assert {11311, 11611, ECHO} <= set(found["tcp"]) and ECHO in found["udp"], (host, found)

    def leaves_ssh_and_pings(self):
        """A stranger reaches ssh, and has answers to pings."""
        for address in self.addresses.values():
            assert "1 received" in self.run(STRANGER, f"ping -c 1 -W 2 {address}")
            greeting = f"timeout 5 bash -c 'exec 3<>/dev/tcp/{address}/22; head -c 7 <&3'"
            assert self.run(STRANGER, greeting) == "SSH-2.0"

    def brings_rules_back(self):
        """A person removes a rule of ours on each computer: one run brings all back."""
        good = {host: self.shows(host) for host in self.filters}
        for host, own in self.filters.items():
            self.run(host, own.removes)
            assert self.shows(host) != good[host]
        assert self.play_filter() == dict.fromkeys(self.filters, 1)
        assert {host: sorted(self.shows(host)) for host in good} == {host: sorted(text) for host, text in good.items()}

    def has_nothing_of_ours(self):
        """No rule, no file and no record of the packet filter is left."""
        for host in self.filters:
            assert self.run(host, f"ls {FILES} 2>/dev/null", check=False) == ""
            assert not re.search(r"rosfleet.multimaster|1024", self.shows(host))


@contextlib.contextmanager
def make_filter_lab(name, inventory, filters, mounts=()):
    """The lab with the owners' own packet filters, until the end of the block."""
    with containers.remove_at_end(name):
        yield FilterLab(name, inventory, filters, mounts)
