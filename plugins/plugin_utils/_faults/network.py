# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Faults of names, interfaces, links and networks. Ids RF-20x to RF-25x."""

from __future__ import annotations

from collections.abc import Mapping

from .computer import ADDRESSES
from .fault import (
    ALWAYS,
    COMPUTERS,
    NETWORK,
    READ,
    Advice,
    Advices,
    Fault,
    Key,
    change,
    hand,
    keep_settings,
    on,
    site,
    site_of_all,
    verify_again,
)

CLOUD = "writes /etc/hosts, and keeps cloud-init from writing the line again at boot"
THERE = "{there}"  # any computer of a network
SIGNAL = on("ip -s link; cat /proc/net/wireless")  # iw dev shows no signal
SIGNAL_DO = hand("plug the cable in anew, or bring {place} nearer to the access point")


def _name(number: int, sentence: str, *do: Advice, more: Advices = ()) -> Fault:
    return Fault(
        f"RF-20{number}",
        sentence,
        do=do,
        look=(on("getent ahostsv4 {what}; grep -n {what} /etc/hosts"), *more),
        cost=2.0,
        why="lines of /etc/hosts are left over from each change of an address",
        read=READ,
        what="a name",
    )


NAMES: Mapping[Key, Fault] = {
    ("names", "unknown"): _name(1, "{place} does not know {what}", site("writes /etc/hosts")),
    ("names", "loopback"): _name(2, "/etc/hosts on {place} binds {what} to the loopback interface", site(CLOUD)),
    ("names", "own"): _name(
        3, "/etc/hosts on {place} binds its own name to another address, too, or to the loopback interface", site(CLOUD)
    ),
    ("names", "old"): _name(
        4,
        "on {place} {what} means another address: an older line of /etc/hosts, or a name server",
        site("writes its line; if it names another line, make that a comment, and run it again"),
        more=(on("grep ^hosts /etc/nsswitch.conf"),),
    ),
    ("names", "several"): _name(
        5,
        "on {place} {what} has a second address: another line of /etc/hosts, or a name server",
        hand("make the other line of /etc/hosts on {place} a comment, or correct the name server"),
        more=(on("grep ^hosts /etc/nsswitch.conf"),),
    ),
    ("names", "rights"): Fault(
        "RF-206",
        "on {place} only root can look up {what}: the rights of /etc/hosts or /etc/nsswitch.conf",
        do=(on("chmod 644 /etc/hosts /etc/nsswitch.conf"),),
        look=(on("ls -l /etc/hosts /etc/nsswitch.conf; runuser -u nobody -- getent ahostsv4 $(hostname)"),),
        what="names",
        read=READ,
        why="a user without rights gets another answer than root",
    ),
    ("names", "order"): Fault(
        "RF-207",
        "{place} asks a name server before /etc/hosts, or not /etc/hosts at all",
        do=(
            on(
                r"sed -i -E -e '/^hosts:/s/[[:space:]]+files\b//' -e 's/^hosts:/hosts: files/' /etc/nsswitch.conf",
                "files comes first, so that /etc/hosts counts",
            ),
        ),
        look=(on("grep ^hosts /etc/nsswitch.conf"),),
        read=READ,
        why="the line was read",
    ),
}

INTERFACES: Mapping[Key, Fault] = {
    ("interface", "address"): Fault(
        "RF-211",
        "{place} has not the address of the plan, or packets leave from another one",
        do=(
            change("set multimaster_address of {place} to the address that the look shows"),
            site_of_all(),
            hand(
                "or give the interface of {place} the planned address in its network manager, or a reservation in DHCP"
            ),
        ),
        look=(ADDRESSES,),
        cost=2.0,
        why="DHCP gives another address after a while",
    ),
    ("interface", "prefix"): Fault(
        "RF-212",
        "the network of an interface of {place} is larger or smaller than planned",
        do=(hand("correct the prefix length of {place} in its network manager"), site("sets its routes")),
        look=(ADDRESSES,),
        why="it is written once",
    ),
    ("interface", "port"): Fault(
        "RF-213",
        "the address of {place} is on a port of a bridge or a bond, and nothing comes in for it there",
        do=(
            hand(
                "give the address and its routes to the bridge or the bond above the port, in the network manager of {place}"
            ),
        ),
        look=(on("ip -d -br link; bridge link; ip -br address"),),
        cost=1.5,
        why="nothing else looks so: the port has a master",
    ),
    ("interface", "mtu"): Fault(
        "RF-214",
        "{place} takes or sends only small packets on {what}",
        do=(
            hand(
                "give the interface of {place} the MTU of the others on {what}, such as: ip link set dev eth0 mtu 1500"
            ),
        ),
        look=(on("ip -br link; ip link | grep -o 'mtu [0-9]*'"),),
        what="its network",
        cost=4.0,
        why="few people change an MTU",
    ),
    ("interface", "duplicate"): Fault(
        "RF-215",
        "another computer has the address of {place}, too",
        do=(hand("find the other computer by the hardware address that the look shows, and give it another address"),),
        look=(Advice("{neighbour}", "arping -b -c 3 -I {device} {address}", "each line has a hardware address"),),
        cost=4.5,
        why="addresses are planned, and DHCP gives each once",
    ),
    ("interface", "overlap"): Fault(
        "RF-217",
        "an interface of {place} leads into the network of another robot: {what}; if its routes get another order, as at a boot, {place} does "
        "not reach that robot",
        do=(
            hand(
                "give that interface of {place} a network of its own (docker: bip in /etc/docker/daemon.json; libvirt: virsh net-edit; VPN, "
                "hotspot: their configuration)"
            ),
            change("or give that robot another multimaster_network, and addresses in it"),
            site_of_all(),
        ),
        look=(on("ip -4 -br address; ip route show table all"),),
        what="see ip address",
        read=ALWAYS,
        why="its addresses and routes were read",
    ),
    ("interface", "multicast"): Fault(
        "RF-216",
        "multicast of {place} leaves, or comes in, by another interface than planned",
        do=(
            site("gives discovery the planned interface"),
            change(
                "or set multimaster_common_address or multimaster_address of {place} to an address of the right interface"
            ),
        ),
        look=(on("ip route get {group}; ip maddress"),),
        why="it needs two interfaces",
    ),
    ("neighbour", "mute"): Fault(
        "RF-221",
        "{place} answers nobody who asks for its hardware address: a packet filter for ARP, or arp_ignore",
        # site.yml leaves an 8 of the user's, with which the kernel answers nobody.
        do=(
            keep_settings("arp", {"net.ipv4.conf.all.arp_ignore": 3}),
            hand(
                "if the interface of {place} with its planned address has arp_ignore 8, set that to 0, too: the larger value counts"
            ),
        ),
        look=(on("sysctl -a --pattern arp_ignore; nft list ruleset arp; arptables-save"),),
        cost=3.5,
        why="few know that it can be filtered",
    ),
    ("neighbour", "filter"): Fault(
        "RF-222",
        "a packet filter on {place} drops ARP, by which computers find each other: {what}",
        do=(
            hand(
                "delete that rule on {place}: nft -a list ruleset arp shows its handle, nft delete rule ... handle N removes it"
            ),
        ),
        look=(on("nft -a list ruleset arp; arptables-save"),),
        what="arp filter",
        read=ALWAYS,
        why="the rule was read",
    ),
    ("neighbour", "fixed"): Fault(
        "RF-223",
        "on {place} a person or a program has set the hardware address of {what} by hand, and it is not that of {what}",
        do=(on("ip neighbour flush to {target} nud permanent", "until what has set it does so again"),),
        look=(
            on(
                "ip neighbour show nud permanent; grep -rnE 'neigh|arp -s' /etc/network /etc/systemd/network /etc/rc.local 2>/dev/null"
            ),
        ),
        what="a computer",
        read=ALWAYS,
        why="the entry was read",
    ),
}


def _slow(number: int, sentence: str, cost: float) -> Fault:
    """Make a row that costs little: a single stream that is slower than expected is worth a sentence."""
    return Fault(
        f"RF-{number}",
        sentence,
        do=(SIGNAL_DO,),
        look=(SIGNAL,),
        cost=cost,
        why="links are slow every day",
        hard=False,
        what="its link",
    )


LINKS: Mapping[Key, Fault] = {
    ("link", "down"): Fault(
        "RF-231",
        "the link of {place} to {what} is down, or its interface has no address there",
        do=(
            hand("plug the cable of {place} in, or connect it to the wifi again"),
            site("sets its routes, when the link is up"),
        ),
        look=(ADDRESSES,),
        what="its network",
        cost=1.9,
        why="cables come loose, and wifi is lost",
    ),
    ("link", "loss"): Fault(
        "RF-232",
        "{place} loses packets on {what}",
        do=(SIGNAL_DO,),
        look=(SIGNAL,),
        what="its link",
        cost=3.5,
        why="it says less than a fault that lets nothing pass",
        hard=False,
    ),
    ("link", "power_save"): Fault(
        "RF-233",
        "{place} saves power on its wireless interface on {what}, which loses and delays packets",
        do=(
            on(
                "iw dev {device} set power_save off",
                "until the next boot; with NetworkManager, until it connects again",
            ),
            # NetworkManager reads files by name, and Ubuntu's default-wifi-powersave-on.conf after one of digits.
            on(
                r"printf '[connection]\nwifi.powersave = 2\n' >/etc/NetworkManager/conf.d/zz-user-power-save.conf; nmcli general reload conf",
                "for each later connection, with NetworkManager",
            ),
        ),
        look=(on("iw dev; iw dev {device} get power_save"),),
        what="its network",
        cost=3.2,
        why="it is a default of many wireless drivers, and most do no harm",
        hard=False,
    ),
    ("link", "slow"): _slow(234, "{place} is slow on {what}", 0.7),
    ("link", "slow out"): _slow(235, "{place} sends slowly on {what}", 0.8),
    ("link", "slow in"): _slow(236, "{place} receives slowly on {what}", 0.9),
    ("link", "flapping"): Fault(
        "RF-237",
        "the link of {place} comes and goes",
        do=(SIGNAL_DO,),
        look=(on("dmesg --ctime | grep -iE 'link|carrier|disconnect|auth|assoc' | tail -20"),),
        cost=4.0,
        why="a link that is down or loses packets is more frequent",
        hard=False,
    ),
    # Ways of packets: the place where they end, and no other component explains it
    ("way", "between"): Fault(
        "RF-241",
        "packets end between {place}: {what}",
        do=(
            hand(
                "look at the cable, the switch or the access point between {place}: one of them drops the packets of the other"
            ),
        ),
        look=(on("ip -s link; ip neighbour; nft list ruleset"),),
        cost=4.0,
        why="it is named if no component of the table is left",
        what="they leave one and do not come in at the other",
        hard=False,
        at=COMPUTERS,
    ),
    ("way", "ends"): Fault(
        "RF-242",
        "packets end at {place}: {what}",
        do=(
            hand(
                "{place} receives packets and does not pass them on, or does not answer: compare its routes with its packet filter"
            ),
        ),
        look=(on("ip rule; ip route; nft list ruleset; ip -s link; nstat -az | grep -iE 'drop|filter'"),),
        cost=4.0,
        why="it is named if no component of the table is left",
        what="they come in and do not go on",
        hard=False,
    ),
    ("network", "dead"): Fault(
        "RF-251",
        "{place} carries nothing between its computers, as an access point that keeps its clients apart",
        do=(hand("switch client isolation off on the access point of {place}, or switch the switch on"),),
        look=(Advice(THERE, "ping -c 3 {other}"),),
        cost=2.0,
        why="guest networks keep their clients apart",
        at=(NETWORK,),
    ),
    ("network", "loss"): Fault(
        "RF-252",
        "{place} loses packets",
        do=(hand("bring the robots nearer to the access point of {place}, or change its channel"),),
        look=(Advice(THERE, "iw dev; ping -c 100 -i 0.2 {other}"),),
        cost=4.0,
        why="one link is more often the reason",
        hard=False,
        at=(NETWORK,),
    ),
    ("network", "slow"): Fault(
        "RF-253",
        "{place} is slow",
        do=(
            hand("bring the robots nearer to the access point of {place}"),
            change("or leave large topics, such as images, out by multimaster_exports or multimaster_filters"),
            site_of_all(),
        ),
        look=(verify_again("measures each pair, one after the other", "-e verify_throughput=1"),),
        cost=1.2,
        why="links are slow every day",
        hard=False,
        at=(NETWORK,),
    ),
    ("network", "multicast"): Fault(
        "RF-254",
        "{place} does not carry the multicast group: IGMP snooping without a querier, or an access point that drops multicast",
        do=(
            hand("switch IGMP snooping off on the switch of {place}, or a querier on"),
            change("set multimaster_transport: both", "robots also find each other without the group"),
            site_of_all(),
        ),
        look=(Advice(THERE, "timeout 10 tcpdump -n -i any -c 10 udp port 11511"),),
        cost=2.5,
        why="switches come with snooping, and few with a querier",
        at=(NETWORK,),
        hard=False,  # a switch prunes port by port: a computer that has just joined hears the others for some minutes
    ),
    ("network", "large"): Fault(
        "RF-255",
        "{place} loses large packets",
        do=(hand("give all interfaces on {place} and its switch one MTU, such as 1500"),),
        look=(Advice(THERE, "ping -M do -s 1472 -c 3 {other}"),),
        cost=4.0,
        why="few people change an MTU",
        at=(NETWORK,),
    ),
}
