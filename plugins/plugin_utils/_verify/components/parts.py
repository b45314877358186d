# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The parts of a fleet that a person can mend, and the ways in which each may be broken. One table, FAULTS.

A part has a `kind`, a `place`, and the `mode` in which it is broken. `what` narrows it where a place has several: the network
of a link or a route, the name that is looked up, the port of a packet filter.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from ..._base import advice
from ..._base.features import load_hooks
from ..._base.plain_text import quote
from .fault import ALWAYS, READ, ROUTES, SITE, ComponentHooks, Fault


class Part(NamedTuple):
    """A part that may be broken in one way."""

    kind: str
    place: str  # a computer, a robot or a network
    mode: str
    what: str = ""
    other: str = ""  # the second place of a fault between two

    @classmethod
    def from_pair(cls, kind: str, mode: str, *places: str, what: str = "") -> Part:
        """Make the part between two places, in whatever order they come."""
        place, other = sorted(places)
        return cls(kind, place, mode, what, other)

    @property
    def places(self) -> tuple[str, ...]:
        """The place, or both."""
        return (self.place, self.other) if self.other else (self.place,)

    @property
    def place_text(self) -> str:
        """The places as a report has them."""
        return " and ".join(self.places)

    @property
    def fault(self) -> Fault:
        """The row of the table."""
        return FAULTS[self.kind, self.mode]

    def sentence(self) -> str:
        """Say what is wrong."""
        return self.fault.sentence.format(place=self.place_text, what=self.what or self.fault.what)

    def remedy(self) -> str:
        """Say what to do, with the command to paste."""
        return self._advice(self.fault.remedy)

    def decide(self) -> str:
        """Return the command that shows whether it is this."""
        return self._advice(self.fault.decide or self.fault.remedy)

    def _advice(self, words: str) -> str:
        """Fill in the names of the part; without a command where `what` may be anything."""
        if self.what and "{what}" in words and not advice.format_value("what", self.what):
            return f"look at it there: {quote(self.what)} fits into no command"
        return words.format(place=self.place_text, what=self.what or self.fault.example)


START_AGAIN = (
    "in the shell, launch file, unit or container that has started it: unset ROS_IP ROS_HOSTNAME; . /etc/profile.d/rosfleet-multimaster.sh; "
    "then start it again"
)
NODE_HOSTS = "on {place}: echo $ROS_IP $ROS_HOSTNAME; rosnode list | xargs -n 1 rosnode info"
RULES = "on {place}: nft list ruleset; iptables -S"
FORWARDED = "on {place}: nft list ruleset; iptables -S FORWARD"
ADDRESSES = "on {place}: ip -br address; ip -s link"
DISCOVERY = "on {place}: systemctl status multimaster-discovery; journalctl -b -u multimaster-discovery"
SYNC = "on {place}: systemctl status multimaster-sync; journalctl -b -u multimaster-sync"
ROSCORE = "on {place}: systemctl status multimaster-roscore (or the unit of your own roscore)"
# The nodes are registered at the roscore, and end with it.
RESTART = "on {place}: systemctl restart multimaster-roscore multimaster-discovery multimaster-sync"
RESTART_DISCOVERY = "on {place}: systemctl restart multimaster-discovery"
RESTART_SYNC = "on {place}: systemctl restart multimaster-sync"
RESTART_UNIT = "on {place}: systemctl restart {what}; see on {place}: journalctl -b -u {what}"
HOSTS = "on {place}: getent ahostsv4 {what}; cat /etc/hosts"

# What a packet filter may drop: mode -> what it is, and what to allow.
DROPPED = {
    "icmp": ("ICMP", "ICMP echo requests and replies"),
    "udp": ("packets for UDP port {what}", "UDP port {what}"),
    "group": ("packets for the multicast group", "the multicast group, and IGMP"),
    "rpc": ("connections to TCP port {what} of the discovery node", "TCP port {what}"),
    "roscore": ("connections to TCP port {what} of the roscore", "TCP port {what}"),
    "nodes": ("connections to the TCP ports of nodes", "all TCP ports above 1024"),
    "all": (
        "packets that no rule of it lets pass",
        "what the fleet sends: ICMP, UDP port 11511, all TCP ports above 1024",
    ),
}
RARER = {"group": 0.2, "all": 0.3}  # their additional cost
# The direction in the mode -> its word in a sentence, and its additional cost.
DIRECTIONS = {"in": ("incoming", 0.2), "out": ("outgoing", 0.8), "": ("incoming and outgoing", 0.4)}

FILTERS: Mapping[tuple[str, str], Fault] = {
    ("filter", f"{mode} {direction}".strip()): Fault(
        f"a packet filter on {{place}} drops {word} {dropped}",
        f"allow {allowed} between the computers of the fleet; see",
        RULES,
        cost=2.5 + RARER.get(mode, 0.0) + more,
        what={"udp": "11511", "rpc": "11611", "roscore": "11311"}.get(mode, ""),
    )
    for mode, (dropped, allowed) in DROPPED.items()
    for direction, (word, more) in DIRECTIONS.items()
}

#: The packet filters that a rule shows, where rules can be read.
RULED = frozenset({*FILTERS, ("filter", "forward")})

FAULTS: Mapping[tuple[str, str], Fault] = {
    # A computer
    ("computer", "off"): Fault(
        "{place} is switched off, or not on its network",
        "switch it on; if it is on, see",
        ADDRESSES,
        cost=1.0,
    ),
    ("computer", "login"): Fault(
        "{place} is there, but the controller cannot log in",
        "see on the controller: ansible {place} -m ansible.builtin.ping -vvv",
        cost=2.0,
    ),
    ("computer", "sealed"): Fault(
        "{place} is sealed: nobody logs in there, so its settings, clock, routes back, packet filter and own view were not looked at",
        "its nodes are judged by what the others see of them; for the rest ask its maker, see docs/operate/sealed.md",
        read=ALWAYS,
    ),
    ("computer", "unmeasured"): Fault(
        "{place} could not be looked at: {what}",
        "see on the controller: ansible-playbook rosfleet.multimaster.verify -vv --limit {place}",
        read=READ,
        what="a measurement gave no result",
    ),
    ("computer", "overloaded"): Fault(
        "{place} is overloaded",
        "with many computers raise verify_patience; see",
        "on {place}: top -b -n1",
        cost=5.0,
        hard=False,
    ),
    ("computer", "ports"): Fault(
        "{place} has no free local port for a new connection",
        "end the program that holds thousands of connections, or give the kernel more ports; see",
        "on {place}: ss -s; sysctl net.ipv4.ip_local_port_range net.ipv4.ip_local_reserved_ports",
        read=ALWAYS,
    ),
    ("computer", "limit"): Fault(
        "{place} cannot open a connection: {what}",
        "end the program that holds so many files or sockets, or raise the limit; see",
        "on {place}: sysctl fs.file-nr net.ipv4.tcp_mem; ulimit -n; ss -s; free",
        what="it has reached a limit",
        read=ALWAYS,
    ),
    ("limit", "unit"): Fault(
        "{what} on {place} may open millions of files, for which each node of C++ takes gigabytes, and those of Python 2 minutes",
        "set LimitNOFILE=1024:524288 in the unit, and restart it; see on {place}: systemctl cat {what}",
        "on {place}: systemctl show --property LimitNOFILESoft {what}",
        what="a unit",
        read=ALWAYS,
    ),
    ("limit", "shell"): Fault(
        "nodes on {place} may open millions of files, for which each node of C++ takes gigabytes, and those of Python 2 minutes: {what}",
        "say ulimit -Sn 1024 in the shell that starts them, or --ulimit nofile=1024:524288 to docker run, and start them again",
        "on {place}: grep 'open files' /proc/[0-9]*/limits",
        what="see ulimit -n",
        read=ALWAYS,
    ),
    ("container", "names"): Fault(
        "a container on {place} was started before the names of the fleet came, and does not know them: {what}",
        "start it again, such as docker compose restart; see docs/start/containers.md",
        "on {place}: grep -c rosfleet /etc/hosts /proc/[0-9]*/root/etc/hosts",
        what="see its /etc/hosts",
        read=ALWAYS,
    ),
    ("computer", "disk"): Fault(
        "{place} has no room on {what}",
        "make room there; see on {place}: df -h; du -xsh /var/log",
        "on {place}: df -h",
        what="a disk",
    ),
    # Names
    **{
        ("names", mode): Fault(sentence, remedy, HOSTS, cost=2.0, read=READ, what="a name")
        for mode, sentence, remedy in (
            ("unknown", "{place} does not know {what}", f"{SITE}, which writes /etc/hosts"),
            (
                "loopback",
                "/etc/hosts on {place} binds {what} to the loopback interface",
                f"{SITE}, which also keeps cloud-init from writing the line again at boot",
            ),
            (
                "own",
                "/etc/hosts on {place} binds its own name to another address, too, or to the loopback interface",
                f"{SITE}, which also keeps cloud-init from writing the line again at boot",
            ),
            (
                "old",
                "on {place} {what} means another address: an older line of /etc/hosts, or a name server",
                f"{SITE}, which names the line that stands against it",
            ),
            (
                "several",
                "on {place} {what} has a second address: another line of /etc/hosts, or a name server",
                "correct the other line of /etc/hosts, or the name server",
            ),
        )
    },
    ("names", "rights"): Fault(
        "on {place} root alone can look up {what}: the rights of /etc/hosts or /etc/nsswitch.conf",
        "on {place}: chmod 644 /etc/hosts /etc/nsswitch.conf",
        "on {place}: ls -l /etc/hosts /etc/nsswitch.conf; runuser -u nobody -- getent ahostsv4 {what}",
        what="names",
        read=READ,
    ),
    ("names", "order"): Fault(
        "{place} asks a name server before /etc/hosts, or not /etc/hosts at all",
        r"on {place}: sed -i -E -e '/^hosts:/s/[[:space:]]+files\b//' -e 's/^hosts:/hosts: files/' /etc/nsswitch.conf; see the line "
        "hosts there: files stands first, so that /etc/hosts counts, which site.yml has written",
        "on {place}: grep ^hosts /etc/nsswitch.conf",
        read=READ,
    ),
    # Interfaces and links
    ("interface", "address"): Fault(
        "{place} has not the address of the plan, or packets leave from another one",
        "correct the interface, or multimaster_address; see",
        ADDRESSES,
        cost=2.0,
    ),
    ("interface", "prefix"): Fault(
        "the network of an interface of {place} is larger or smaller than planned",
        "correct the prefix length; see",
        ADDRESSES,
    ),
    ("interface", "port"): Fault(
        "the address of {place} is on a port of a bridge or a bond, and nothing comes in for it there",
        "give the address, with the routes, to the interface above the port; see",
        ADDRESSES,
        cost=1.5,
    ),
    ("interface", "mtu"): Fault(
        "{place} takes or sends only small packets on {what}",
        "give its interface the MTU of the others; see",
        "on {place}: ip link",
        what="its network",
        cost=4.0,
    ),
    ("interface", "duplicate"): Fault(
        "another computer has the address of {place}, too",
        "give one of the two another address; see",
        "on another computer there: arping -D -I <interface> <its address>",
        cost=4.5,
    ),
    ("interface", "overlap"): Fault(
        "an interface of {place} leads into the network of another robot: {what}; if its routes get another order, as at a boot, {place} does "
        "not reach that robot",
        "give that interface a network of its own (docker: bip in /etc/docker/daemon.json; libvirt: virsh net-edit; VPN, hotspot: their "
        "configuration), or that robot another one in the inventory; see",
        "on {place}: ip -4 -br address; ip route show table all",
        what="see ip address",
        read=ALWAYS,
    ),
    ("neighbour", "mute"): Fault(
        "{place} answers nobody who asks for its hardware address: a packet filter for ARP, or arp_ignore",
        "let it answer; see",
        "on {place}: nft list tables; sysctl -a --pattern arp_ignore",
        cost=3.5,
    ),
    ("neighbour", "filter"): Fault(
        "a packet filter on {place} drops ARP, by which computers find each other: {what}",
        "let it pass; see",
        "on {place}: nft list ruleset arp",
        what="arp filter",
        read=ALWAYS,
    ),
    ("neighbour", "fixed"): Fault(
        "on {place} somebody has set the hardware address of {what} by hand, and it is not that of {what}",
        "on {place}: ip neighbour flush nud permanent; see",
        "on {place}: ip neighbour show nud permanent",
        what="a computer",
        read=ALWAYS,
    ),
    ("interface", "multicast"): Fault(
        "multicast of {place} leaves, or comes in, by another interface than planned",
        f"{SITE}; set multimaster_common_address or multimaster_address to the address of the right one",
        "on {place}: ip route get {what}; ip maddress",
        what="<group>",
    ),
    ("link", "down"): Fault(
        "the link of {place} to {what} is down, or its interface has no address there",
        "switch its interface on, or look at the cable; see",
        ADDRESSES,
        what="its network",
        cost=1.9,
    ),
    ("link", "loss"): Fault(
        "{place} loses packets on {what}",
        "look at the signal, or at the cable; see on {place}: ip -s link",
        what="its link",
        cost=3.5,
        hard=False,
    ),
    ("link", "power_save"): Fault(
        "{place} saves power on its wireless interface on {what}, which loses and delays packets",
        "switch it off, by iw dev <interface> set power_save off, and for the next boot in the network manager; see on {place}: iw dev",
        "on {place}: iw dev; iw dev <interface> get power_save",
        what="its network",
        cost=3.2,
        hard=False,
    ),
    **{  # they cost little: a single stream that is slower than expected is worth a sentence
        ("link", mode): Fault(
            sentence,
            "look at the signal, or at the cable; see on {place}: ip -s link; iw dev",
            what="its link",
            cost=cost,
            hard=False,
        )
        for mode, sentence, cost in (
            ("slow", "{place} is slow on {what}", 0.7),
            ("slow out", "{place} sends slowly on {what}", 0.8),
            ("slow in", "{place} receives slowly on {what}", 0.9),
        )
    },
    ("link", "flapping"): Fault(
        "the link of {place} comes and goes",
        "look at the cable, or at the signal; see on {place}: dmesg",
        cost=4.0,
        hard=False,
    ),
    # Ways of packets: where they were seen to end, and no other part explains it
    ("way", "between"): Fault(
        "packets end between {place}: {what}",
        "look at the network between them; see on both: ip -s link; ip neighbour; nft list ruleset",
        cost=4.0,
        what="they leave one and do not come in at the other",
        hard=False,
    ),
    ("way", "ends"): Fault(
        "packets end at {place}: {what}",
        "see on {place}: ip -s link; ip neighbour; ip rule; ip route; nft list ruleset; nstat -az",
        cost=4.0,
        what="they come in and do not go on",
        hard=False,
    ),
    # Networks
    ("network", "dead"): Fault(
        "{place} carries nothing between its computers, as an access point that keeps its clients apart",
        "switch client isolation off on the access point, and look at the switch",
        "on a computer there, for another one there: ping -c 3 <its address>",
        cost=2.0,
    ),
    ("network", "loss"): Fault(
        "{place} loses packets", "look at the signal, or at the load of the network", cost=4.0, hard=False
    ),
    ("network", "slow"): Fault(
        "{place} is slow",
        "look at the signal, or at the load of the network; verify_throughput_least says what is expected",
        cost=1.2,
        hard=False,
    ),
    ("network", "multicast"): Fault(
        "{place} does not carry the multicast group: IGMP snooping without a querier, or an access point that drops multicast",
        "switch IGMP snooping off or a querier on; with multimaster_transport: both the robots find each other meanwhile",
        "on a computer there, for the heartbeats of the others: tcpdump -n -i any -c 10 udp port 11511",
        cost=2.5,
        hard=False,  # a switch prunes port by port: a computer that has just joined hears the others for some minutes
    ),
    ("network", "large"): Fault(
        "{place} loses large packets",
        "give all its interfaces one MTU, and look at the switch",
        "on a computer there, for another one there: ping -M do -s 1472 -c 3 <its address>",
        cost=4.0,
    ),
    # Between networks
    ("route", "missing"): Fault(
        "{place} has no way out of its network to {what}",
        f"{SITE}, which sets its routes; see",
        ROUTES,
        cost=2.0,
        what="the others",
    ),
    ("route", "other"): Fault(
        "another route of {place} to {what} comes first: a second default route, as DHCP brings it, that of a VPN or of "
        "Docker, or one set by hand",
        f"{SITE}, which names it; see",
        ROUTES,
        cost=2.0,
        what="the others",
        read=READ,
    ),
    ("route", "closed"): Fault(
        "a route of {place} leads nowhere: {what}",
        f"look for the program or the file that makes it; see {ROUTES}",
        f"{ROUTES} show table all",
        what="of the type blackhole, unreachable or prohibit",
        read=ALWAYS,
    ),
    ("route", "rule"): Fault(
        "a rule for routing on {place} sends packets another way than planned: {what}",
        "look for the program or the file that makes it; see",
        ROUTES,
        what="see ip rule",
        read=ALWAYS,
    ),
    ("route", "defaults"): Fault(
        "{place} has two default routes",
        "keep the one that leads to the other networks, or set multimaster_routes to networks for this robot, so that only "
        "the robots' networks go by the gateway; see",
        ROUTES,
        cost=2.5,
        hard=False,
        read=READ,
    ),
    ("route", "circle"): Fault(
        "{place} sends packets for {what} back to where they came from",
        f"{SITE} on it; see there: ip route",
        "on {place}: ip route",
        what="the others",
        read=READ,
    ),
    ("forwarding", "off"): Fault(
        "{place} drops what is meant for another network, so nobody gets through it",
        f"{SITE}; if the value comes back, see on {{place}}: grep -r ip_forward /etc/sysctl.* /usr/lib/sysctl.d",
        "on {place}: sysctl net.ipv4.ip_forward",
        cost=2.0,
    ),
    ("forwarding", "large"): Fault(
        "{place} passes small packets on and loses large ones",
        "give both of its interfaces the MTU of their networks, and let ICMP 'fragmentation needed' pass; see on {place}: ip link",
        "from a computer behind it: ping -M do -s 1472 -c3 <another network>",
        cost=3.5,
    ),
    ("filter", "forward"): Fault(
        "a packet filter on {place} drops {what} meant for another network, as Docker sets it up",
        "let packets between the robots' networks pass there; see",
        FORWARDED,
        cost=2.5,
        what="what is",
    ),
    ("filter", "changed"): Fault(
        "the packet filter of {place} is not as planned",
        f"{SITE}; if it changes again, see on {{place}} what else changes the packet filter",
        RULES,
        hard=False,
        read=ALWAYS,
    ),
    ("filter", "pair"): Fault(
        "something drops packets between {place}, and between nobody else: a packet filter or a route with the other's address",
        "see on both, and on the gateways between them: nft list ruleset; ip route",
        cost=6.0,
    ),
    ("reverse_path", "strict"): Fault(
        "{place} drops packets that come in on another interface than the one that leads back to their source",
        f"{SITE}, which sets net.ipv4.conf.all.rp_filter to 2; the larger value of all and the interface counts",
        "on {place}: sysctl -a --pattern rp_filter",
        cost=3.5,
        hard=False,
        read=ALWAYS,
    ),
    ("redirects", "sent"): Fault(
        "{place} sends ICMP redirects, because packets turn round on the common network",
        f"{SITE}, which sets net.ipv4.conf.*.send_redirects to 0; it is sent where all or the interface has 1",
        "on {place}: sysctl -a --pattern send_redirects",
    ),
    ("translation", "on"): Fault(
        "{place} translates addresses (masquerading, NAT)",
        "translate nothing between the robots' networks; a container or virtual machine: connect it by a bridge; see",
        "on {place}: nft list ruleset; iptables -t nat -S",
        cost=2.0,
    ),
    # ROS on a computer
    ("clock", "off"): Fault(
        "the clock of {place} is {what}",
        "run chrony on all computers with one of them, or a server, as the source",
        "on {place}: chronyc tracking; date --utc +%T.%N",
        what="wrong",
    ),
    ("environment", "service"): Fault(
        "services of {place} run with another environment than planned: {what}",
        f"{SITE}, which restarts them",
        "on {place}: systemctl show --property Environment multimaster-discovery",
        cost=2.0,
        what="the variables of ROS",
        read=READ,
    ),
    ("environment", "shell"): Fault(
        "nodes started on {place} have another environment than planned: {what}",
        f"{SITE} on it; remove ROS_HOSTNAME, ROS_IP and ROS_MASTER_URI from the files of its shells",
        "on {place}: bash -lc env | grep ^ROS; grep -n ROS_ ~/.bashrc ~/.profile",
        cost=2.0,
        what="ROS_HOSTNAME or ROS_IP",
        read=READ,
    ),
    ("roscore", "dead"): Fault("no roscore answers on {place}", f"{RESTART}; see", ROSCORE, cost=1.5),
    ("roscore", "sealed"): Fault(
        "the roscore on the sealed computer {place} {what}",
        "switch {place} on, see that its system starts the roscore, and that multimaster_sealed has its address and all its names",
        "from its companion: ping -c 2 {place}; rosnode list",
        cost=1.5,
        what="does not answer",
    ),
    ("roscore", "hung"): Fault("the roscore on {place} runs and does not answer", f"{RESTART}; see", ROSCORE, cost=2.4),
    ("roscore", "name"): Fault(
        "the roscore on {place} calls itself {what}",
        f"{SITE}; a roscore of your own needs the variables of /etc/rosfleet-multimaster/environment",
        "on {place}: rosparam get /rosdistro; env | grep ^ROS",
        cost=2.0,
        what="otherwise than planned",
        read=READ,
    ),
    ("discovery", "dead"): Fault(
        "the discovery node of {place} does not run", f"{RESTART_DISCOVERY}; see", DISCOVERY, cost=1.5
    ),
    ("discovery", "hung"): Fault(
        "the discovery node of {place} runs and does not answer", f"{RESTART_DISCOVERY}; see", DISCOVERY
    ),
    ("discovery", "group"): Fault(
        "the discovery node of {place} uses another group or port than the others",
        f"{SITE}, so that all use one group and port; see {DISCOVERY}",
        "on {place}: ss -lunp | grep python; rosparam get /master_discovery",
        cost=2.8,
    ),
    ("discovery", "port"): Fault(
        "the discovery node of {place} does not listen on TCP port {what}",
        f"{SITE}, so that it has the planned port; see {DISCOVERY}",
        "on {place}: ss -ltnp",
        cost=2.5,
        what="11611",
    ),
    ("discovery", "configuration"): Fault(
        "the discovery node of {place} does not serve what is planned",
        f"{SITE} on it; see",
        DISCOVERY,
        cost=3.4,
    ),
    ("discovery", "stale"): Fault(
        "the discovery node of {place} has not followed its roscore: {what} is registered there, and not in its state",
        f"{RESTART_DISCOVERY}; see",
        DISCOVERY,
        what="a topic",
        read=ALWAYS,
    ),
    ("sync", "dead"): Fault("the sync node of {place} does not run", f"{RESTART_SYNC}; see", SYNC, cost=1.5),
    ("sync", "hung"): Fault(
        "the sync node of {place} runs and registers nothing of the others",
        f"{RESTART_SYNC}; see {SYNC}; rosservice call /master_sync/get_sync_info",
        SYNC,
        cost=2.6,
    ),
    ("sync", "configuration"): Fault(
        "the sync node of {place} takes other topics and services than planned: {what}",
        f"{SITE} on it; docs/operate/providers.md says what upstream's nodes cannot leave out",
        "on {place}: rosparam get /master_sync; rosservice call /master_sync/get_sync_info",
        cost=3.2,
        what="other parameters",
    ),
    ("sync", "limit"): Fault(
        "{what} offers more than the 5000 registrations that the sync node of {place} takes of one master",
        "leave out what nobody needs, by multimaster_filters or multimaster_exports",
        SYNC,
        what="a master",
    ),
    ("sync", "untold"): Fault(
        "the sync node of {place} does not tell what it has registered",
        f"{RESTART_SYNC}; see",
        "on {place}: rosservice call /master_sync/get_sync_info",
    ),
    ("sync", "stale"): Fault(
        "the sync node of {place} has not followed the changes of {what}, which are given to it and are not registered",
        f"{RESTART_SYNC}; see",
        SYNC,
        cost=2.5,
        what="another master",
        read=ALWAYS,
    ),
    ("sync", "refuses"): Fault(
        "the sync node of {place} refuses {what}, since the name is taken, or the type or the place is another one",
        f"see {SYNC}, whose log says why",
        SYNC,
        what="a registration",
        read=ALWAYS,
    ),
    ("sync", "objects"): Fault(
        "the sync node of {place} refuses {what}",
        "mend what it names: give one of the two another name, install the same version of the message package on both, or start the node "
        "where its robot has a computer (a laptop belongs into multimaster_allow)",
        "on {place}: systemctl status multimaster-sync",
        what="a registration",
        read=ALWAYS,
    ),
    ("service", "down"): Fault(
        "{what} does not run on {place}",
        RESTART_UNIT,
        "on {place}: journalctl -b -u {what}",
        cost=2.0,
        what="multimaster-*",
    ),
    ("ros", "broken"): Fault(
        "nodes of the ROS on {place} cannot start any more; those that run were started before",
        "install what is missing again; see",
        "on {place}: python3 -c 'import rospy'",
        cost=2.0,
        read=ALWAYS,
    ),
    ("service", "stopped"): Fault(
        "the process of {what} on {place} is stopped, by a signal or a debugger, so it runs and does nothing",
        "on {place}: systemctl kill --signal=CONT {what}",
        "on {place}: systemctl status {what}; ps -eo pid,stat,args",
        cost=2.0,
        what="multimaster-*",
        read=ALWAYS,
    ),
    ("service", "full"): Fault(
        "{what} on {place} has as many files open as it may, so it takes no new connection",
        f"{RESTART_UNIT}; ss -tnp; LimitNOFILE in systemctl cat {{what}}",
        "on {place}: systemctl show --property MainPID,LimitNOFILESoft {what}; ss -tnp",
        cost=2.0,
        what="multimaster-*",
        read=ALWAYS,
    ),
    ("service", "restarting"): Fault(
        "on {place} {what} ended and was started again",
        "see on {place}: journalctl -b -u {what}",
        hard=False,
        what="multimaster-*",
    ),
    ("service", "looping"): Fault(
        "on {place} systemd starts {what} again and again, and in vain",
        "see on {place}: journalctl -b -u {what}; systemctl cat {what}",
        cost=2.0,
        what="multimaster-*",
        read=READ,
    ),
    ("service", "missing"): Fault(
        "{what} was not set up on {place}",
        f"{SITE} on it",
        "on {place}: systemctl cat {what}",
        cost=1.0,
        what="multimaster-*",
        read=READ,
    ),
    # Nodes of people
    ("node", "loopback"): Fault(
        "on {place} {what}, where no other computer reaches it",
        START_AGAIN,
        NODE_HOSTS,
        what="a node announces 127.0.0.1",
        read=ALWAYS,
    ),
    ("node", "address"): Fault(
        "on {place} {what}, which is no address of its robot: an old one, or that of another computer; so other robots do not take it",
        f"{START_AGAIN}; the address of a laptop belongs into multimaster_allow",
        NODE_HOSTS,
        what="a node announces another address",
        read=ALWAYS,
    ),
    ("node", "interface"): Fault(
        "on {place} {what}, where other robots do not reach it, so they do not take it",
        START_AGAIN,
        NODE_HOSTS,
        what="a node announces the address of another interface",
        read=ALWAYS,
    ),
    ("node", "name"): Fault(
        "on {place} {what}, which is no planned name of its robot, so other robots do not take it",
        START_AGAIN,
        NODE_HOSTS,
        what="a node announces another name",
        read=ALWAYS,
    ),
    ("node", "services"): Fault(
        "on {place} {what}, so its services are looked for on another computer",
        START_AGAIN,
        NODE_HOSTS,
        what="a node announces two computers",
        read=ALWAYS,
    ),
    ("node", "robot"): Fault(
        "on {place} {what}, so the nodes of its own robot do not know it",
        START_AGAIN,
        "on {place}: echo $ROS_MASTER_URI",
        what="a node uses the roscore of another robot",
        read=ALWAYS,
    ),
    ("node", "master"): Fault(
        "on {place} {what}, which is not the roscore of its robot, so its robot does not know it",
        START_AGAIN,
        "on {place}: echo $ROS_MASTER_URI",
        what="a node uses another roscore",
        read=ALWAYS,
    ),
    ("node", "hung"): Fault(
        "on {place} {what} takes connections and does not answer: it hangs, or a signal or a debugger has stopped it",
        "see on {place}: ps -eo pid,stat,args; kill -CONT <pid> lets a stopped process go on",
        what="a node",
        read=ALWAYS,
    ),
    # Registrations and their exchange
    ("registration", "ghost"): Fault(
        "the roscore of {place} holds nodes that do not answer: {what}; they ended without saying so, as by kill -9",
        "end a node that hangs first; on {place}: yes | rosnode cleanup",
        "on {place}: rosnode ping --all",
        what="see rosnode ping --all",
    ),
    ("registration", "twin"): Fault(
        "one name, two nodes on {place}: {what}; a roscore holds one of them",
        "give one of them another name or a namespace of its robot, or leave it out by multimaster_exports or multimaster_filters",
        "on the masters of {place}: rosnode list",
        what="see rosnode list",
    ),
    ("registration", "talker"): Fault(
        "the talker of the verification on {place} does not run, or has not registered: {what}",
        "with many computers raise verify_lifetime; see",
        "on {place}: journalctl -u multimaster-verify-talker",
        cost=3.5,
        what="rostopic pub fails there",
    ),
    ("registration", "listener"): Fault(
        "the subscriber of the verification on {place} gave no result: {what}",
        "with many computers raise verify_patience; see",
        "on {place}: rostopic echo /rosout",
        cost=3.5,
        what="rospy fails there",
    ),
    ("registration", "untold"): Fault(
        "nodes on {place} are not told of new publishers: its roscore has them, and does not reach the nodes there",
        f"see on the computer of its roscore if it knows the name and reaches the ports of nodes on {{place}}; {RULES}",
        RULES,
        read=ALWAYS,
    ),
    ("registration", "closed"): Fault(
        "a node on {place} says where its topic is to be had, and no connection to that port opens",
        "let all TCP ports above 1024 pass, not some of them; see",
        RULES,
        read=ALWAYS,
    ),
    ("registration", "mute"): Fault(
        "a node on {place} takes connections and says nothing: {what}; it hangs, or a signal or a debugger has stopped it",
        "see on {place}: ps -eo pid,stat,args; kill -CONT <pid> lets a stopped process go on",
        what="a node",
        read=ALWAYS,
    ),
    ("registration", "link"): Fault(
        "nodes on {place} are connected though nothing is exchanged between them: {what}",
        "start these nodes again; if it comes back, run site.yml on all robots",
        "on the masters of {place}: rosnode info <node>",
        what="see rosnode info",
    ),
    ("topic", "shared"): Fault(
        "nodes of {place} publish the same topics, and who hears the one hears the other, too: {what}",
        "give one of the two nodes a namespace of its robot, or leave the topic out by multimaster_exports or multimaster_filters; if it is "
        "meant, write its whole name into the multimaster_exports of both",
        "on the masters of {place}: rostopic info <topic>",
        what="see rostopic info",
    ),
    ("topic", "circle"): Fault(
        "ros1_bridge runs on {place}, and messages go round in a circle by both bridges: {what}",
        "run one bridge for both robots, give the bridged topics a namespace of each robot, or leave them out by multimaster_exports or "
        "multimaster_filters",
        "on the masters of {place}: rosnode info <bridge>",
        what="see rosnode info",
    ),
    ("parameter", "copy"): Fault(
        "parameters that cross are not the same on {place}: {what}",
        "if the robot that gets it has a value of its own, remove it there (rosparam delete) or take the name out of "
        "multimaster_exports; see on its master: journalctl -b -u multimaster-sync",
        "on the master of the robot that gets it: journalctl -b -u multimaster-sync",
        what="see multimaster_exports",
        read=ALWAYS,
    ),
    ("time", "simulated"): Fault(
        "the nodes of {place} have simulated time, and those of other robots do not: {what}; so each takes the messages and tf of the other for "
        "very old or from the future",
        "rosparam set /use_sim_time on all robots to the same value, before their nodes start, or leave /clock and what the simulation publishes "
        "out by multimaster_exports or multimaster_filters; see",
        "on {place}: rosparam get /use_sim_time; rostopic info /clock",
        what="see /use_sim_time",
        read=ALWAYS,
    ),
    ("time", "stopped"): Fault(
        "the nodes of {place} wait for a simulated time that does not come: /use_sim_time is true, and nobody publishes /clock",
        "start the simulation, or rosbag play --clock; without one, on {place}: rosparam set /use_sim_time false; then start the nodes again",
        "on {place}: rosparam get /use_sim_time; rostopic info /clock",
        read=ALWAYS,
    ),
    ("relay", "lacking"): Fault(
        "the relay does not take across between {place}: {what}",
        "see the log of both relays: it names a robot that does not answer, and a topic that cannot be had",
        "on both masters: journalctl -b -u multimaster-relay; rosnode info /master_relay",
        what="see multimaster_exports",
        read=ALWAYS,
    ),
    ("declaration", "narrow"): Fault(
        "{place} leaves out what the others need: {what}",
        "correct multimaster_exports or multimaster_filters of the robot, and run site.yml",
        "on the master of {place}: rosparam get /master_discovery; rosparam get /master_sync",
        what="see multimaster_exports",
        read=READ,
    ),
    ("messages", "differ"): Fault(
        "message definitions differ on {place}: {what}",
        "install the same version of the message package on both, or give one of the topics another name",
        "on the master of {place}: rosmsg md5 <type>",
        what="see rosmsg md5",
    ),
    ("messages", "unknown"): Fault(
        "the Python of ROS on {place} does not tell the classes of its message types: {what}",
        "see on {place}: rosmsg md5 std_msgs/String",
        what="rospy fails there",
    ),
    ("set_up", "never"): Fault(
        "site.yml has not run on {place}, or teardown.yml has run since", SITE, read=ALWAYS, cost=1.0
    ),
    # The set-up by others
    ("set_up", "by_hand"): Fault(
        "{place} was set up by hand, or by something else",
        f"nothing, if that is wanted: the other checks say if the fleet talks; else {SITE}",
        "on {place}: rosnode list; ls /var/lib/rosfleet-multimaster",
    ),
    ("set_up", "others"): Fault(
        "the nodes on {place} were started by hand, or by something else; they are judged as they are",
        f"nothing, if that is wanted; else stop them on {{place}}, and {SITE}",
        "on {place}: ps -eo pid,user,args",
    ),
    ("set_up", "refused"): Fault(
        "site.yml would refuse {place}, before it changes anything",
        "do what the sentences say",
    ),
    # Others
    ("setting", "icmp_group"): Fault(
        "{place} does not answer pings of a group; discovery does not depend on it",
        f"if you want the answers: {SITE} on it, which sets net.ipv4.icmp_echo_ignore_broadcasts",
        "on {place}: sysctl net.ipv4.icmp_echo_ignore_broadcasts",
        cost=2.0,
    ),
    ("setting", "icmp_all"): Fault(
        "{place} answers no pings, by a setting of its kernel",
        "on {place}: sysctl -w net.ipv4.icmp_echo_ignore_all=0; see on {place} who sets it: grep -r icmp_echo_ignore_all /etc/sysctl.*",
        "on {place}: sysctl net.ipv4.icmp_echo_ignore_all",
        read=ALWAYS,
    ),
    ("setting", "ttl"): Fault(
        "packets of {place} begin with a time to live that is too small for the way",
        "on {place}: sysctl -w net.ipv4.ip_default_ttl=64; see on {place} who sets it: grep -r ip_default_ttl /etc/sysctl.*; nft list ruleset",
        "on {place}: sysctl net.ipv4.ip_default_ttl; nft list ruleset",
        cost=3.0,
        hard=False,
    ),
    ("setting", "unread"): Fault(
        "on {place} {what} cannot be looked at, as in some containers", "nothing", what="a value"
    ),
    ("stranger", "present"): Fault(
        "{what} at {place} is no computer of the inventory, and uses the group and port of this fleet",
        "add it to the inventory, put {place} into multimaster_allow, or give this fleet another "
        "multimaster_multicast_group or port",
        "on a computer of the fleet: ip neighbour",
        what="somebody",
    ),
    # The next boot
    ("boot", "unit"): Fault(
        "{what} works on {place} now, and does not start at the next boot",
        f"{SITE} on it",
        "on {place}: systemctl is-enabled {what}",
        what="multimaster-*",
    ),
    ("boot", "sysctl"): Fault(
        "{what} is right on {place} now, and not after the next boot",
        f"{SITE} on it, which names the file",
        "on {place}: grep -r {what} /etc/sysctl.conf /etc/sysctl.d /usr/lib/sysctl.d",
        what="a kernel setting",
    ),
    ("boot", "route"): Fault("{place} has its routes now, and not after the next boot", f"{SITE} on it", ROUTES),
    ("boot", "names"): Fault(
        "/etc/hosts of {place} is right now, and is written anew at the next boot",
        f"{SITE} on it, which keeps cloud-init from writing it",
        "on {place}: grep -rn manage_etc_hosts /etc/cloud",
    ),
    **FILTERS,
    **{
        key: fault for hooks in load_hooks("components", ComponentHooks).values() for key, fault in hooks.faults.items()
    },
}

#: What a router says of others, which need not be so: packets are followed all the same.
HEARSAY = {("route", "circle")}

ANY = "any computer of this run"  # the place of a fault that all of them have

#: What site.yml makes: where it has not run, no fault of these is worth a finding of its own.
MADE = (
    *(("names", mode) for mode in ("unknown", "loopback", "own", "old", "several")),
    *(("route", mode) for mode in ("missing", "other")),
    ("forwarding", "off"),
    ("reverse_path", "strict"),
    ("redirects", "sent"),
    *(("environment", mode) for mode in ("service", "shell")),
    *(("roscore", mode) for mode in ("dead", "name")),
    *((node, mode) for node in ("discovery", "sync") for mode in ("dead", "configuration")),
    *(("service", mode) for mode in ("down", "missing")),
    *(("registration", mode) for mode in ("talker", "listener")),
    ("filter", "changed"),
    ("setting", "icmp_group"),
    *(("boot", mode) for mode in ("unit", "sysctl", "route", "names")),
)
PORTS, LIMIT = ("computer", "ports"), ("computer", "limit")
#: What needs a new connection of a computer.
CALLS = (
    *((node, mode) for node in ("roscore", "discovery", "sync") for mode in ("dead", "hung")),
    *((node, "stale") for node in ("discovery", "sync")),
    *(("registration", mode) for mode in ("talker", "listener")),
    *(("filter", f"{mode} out") for mode in ("rpc", "roscore", "nodes", "all")),
)
STOPPED, LOOPING = ("service", "stopped"), ("service", "looping")
STANDSTILL = (STOPPED, ("service", "full"), LOOPING)  # in one of these a node answers nobody
SEALED = ("roscore", "sealed")
_CAUSES: Mapping[tuple[str, str], tuple[tuple[str, str], ...]] = {
    **{(node, "hung"): STANDSTILL for node in ("roscore", "discovery", "sync")},
    **{
        (node, "stale"): (
            *STANDSTILL,
            *((name, mode) for name in (node, "roscore") for mode in ("dead", "hung")),
            SEALED,
        )
        for node in ("discovery", "sync")
    },
    **dict.fromkeys((("registration", "talker"), ("registration", "listener")), STANDSTILL),
    **{
        ("filter", f"{mode} {way}"): tuple(
            ("filter", more) for more in (mode, f"all {way}", "all") if more != f"{mode} {way}"
        )
        for mode in DROPPED
        for way in ("in", "out")
    },
    ("sync", "untold"): (*STANDSTILL, ("sync", "dead")),
    ("computer", "unmeasured"): (("link", "down"), ("interface", "address"), PORTS),
    ("set_up", "by_hand"): (("set_up", "others"),),
    ("set_up", "refused"): (("ros", "broken"),),
    ("neighbour", "mute"): (("neighbour", "filter"),),
    ("roscore", "dead"): (("interface", "duplicate"),),  # the other computer refuses
    ("discovery", "dead"): (("roscore", "dead"), SEALED, LOOPING),
    # A node whose datagrams its own kernel refuses leaves the group, and tries again.
    ("discovery", "group"): (("filter", "group out"), ("filter", "group"), ("filter", "udp out"), ("filter", "udp")),
    ("sync", "dead"): (("roscore", "dead"), SEALED, LOOPING),
    # systemd ends a stopped process and starts it again, and its neighbours with it: they know little at first.
    ("service", "restarting"): (
        *STANDSTILL,
        ("roscore", "dead"),
        ("roscore", "hung"),
        SEALED,
        ("set_up", "others"),
    ),
    **dict.fromkeys((("discovery", "configuration"), ("sync", "configuration")), (STOPPED, LOOPING)),
    **{("names", mode): (("names", "order"),) for mode in ("unknown", "old", "several")},
    ("roscore", "name"): (("environment", "service"),),
    # What comes in elsewhere, as at a port that was taken out of a bridge, is of no use while the planned interface has no link.
    ("interface", "multicast"): (("interface", "address"), ("interface", "port"), ("link", "down")),
    ("interface", "overlap"): (("interface", "address"),),
    ("route", "missing"): (
        ("route", "closed"),
        ("route", "rule"),
        ("interface", "overlap"),
        ("link", "down"),
        ("interface", "address"),
        ("interface", "prefix"),
    ),
    ("route", "other"): (
        ("route", "rule"),
        ("route", "defaults"),
        ("interface", "overlap"),
        ("interface", "address"),
        ("interface", "prefix"),
    ),
}

_FEATURES = tuple(load_hooks("components", ComponentHooks).values())

#: A fault that follows from another fault of the same place: fault -> its possible causes.
FOLLOWS = {
    fault: (
        *_CAUSES.get(fault, ()),
        *(cause for hooks in _FEATURES for cause in hooks.causes.get(fault, ())),
        *([("set_up", "never")] if fault in MADE else []),
        *([PORTS, LIMIT] if fault in CALLS else []),
    )
    for fault in dict.fromkeys((*_CAUSES, *MADE, *CALLS, *(fault for hooks in _FEATURES for fault in hooks.causes)))
}
