# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Faults between networks: routes, forwarding, settings of gateways. Ids RF-26x and RF-27x."""

from __future__ import annotations

from collections.abc import Mapping

from .computer import ROUTES
from .fault import ALWAYS, READ, Advice, Fault, Key, change, hand, on, site, site_of_all

ALL_ROUTES = on("ip rule; ip route show table all")
MAKERS = on(
    "grep -rnE 'blackhole|unreachable|prohibit|ip (route|rule)' /etc/network /etc/netplan /etc/systemd/network /etc/NetworkManager 2>/dev/null"
)

ROUTING: Mapping[Key, Fault] = {
    ("route", "missing"): Fault(
        "RF-261",
        "{place} has no way out of its network to {what}",
        do=(site("sets its routes"),),
        look=(ROUTES,),
        cost=2.0,
        why="routes are lost with a link, and with a network manager that starts again",
        what="the others",
    ),
    ("route", "other"): Fault(
        "RF-262",
        "another route of {place} to {what} comes first: a second default route, as DHCP brings it, that of a VPN or of Docker, or one set by hand",
        do=(
            site("sets its own route, and names the other one"),
            site("takes the place of the other one, if the run refuses it", "-e routes_on_conflict=replace"),
        ),
        look=(ROUTES,),
        cost=2.0,
        why="DHCP, VPNs and Docker bring routes",
        what="the others",
        read=READ,
    ),
    ("route", "closed"): Fault(
        "RF-263",
        "a route of {place} leads nowhere: {what}",
        do=(hand("delete it on {place}: ip route del, with the words of the route"),),
        look=(ALL_ROUTES, MAKERS),
        what="of the type blackhole, unreachable or prohibit",
        read=ALWAYS,
        why="the route was read",
    ),
    ("route", "rule"): Fault(
        "RF-264",
        "a rule for routing on {place} sends packets another way than planned: {what}",
        do=(hand("delete it on {place}: ip rule del, with the words of the rule"),),
        look=(ALL_ROUTES, MAKERS),
        what="see ip rule",
        read=ALWAYS,
        why="the rule was read",
    ),
    ("route", "defaults"): Fault(
        "RF-265",
        "{place} has two default routes",
        do=(
            hand(
                "end the default route that does not lead to the other robots, in the network manager of {place} (ipv4.never-default yes "
                "in NetworkManager, use-routes: false in netplan)"
            ),
            change(
                "set multimaster_routes: networks for this robot", "only the robots' networks go by the gateway then"
            ),
            site_of_all(),
        ),
        look=(ROUTES,),
        cost=2.5,
        why="a computer with wifi and ethernet has two",
        hard=False,
        read=READ,
    ),
    ("route", "circle"): Fault(
        "RF-266",
        "{place} sends packets for {what} back to where they came from",
        do=(site("sets its routes"),),
        look=(on("ip route; traceroute -n {beyond}"),),
        what="the others",
        read=READ,
        why="a router reports it",
    ),
    ("forwarding", "off"): Fault(
        "RF-271",
        "{place} drops packets for other networks, so nobody gets through it",
        do=(site("sets net.ipv4.ip_forward, now and at boot"),),
        look=(
            on(
                "sysctl net.ipv4.ip_forward; grep -rn ip_forward /etc/sysctl.conf /etc/sysctl.d /run/sysctl.d /usr/lib/sysctl.d"
            ),
        ),
        cost=2.0,
        why="it is off by default",
    ),
    ("forwarding", "large"): Fault(
        "RF-272",
        "{place} passes small packets on and loses large ones",
        do=(
            hand(
                "give each interface of {place} the MTU of its network, such as: ip link set dev eth0 mtu 1500; and let ICMP pass its packet filter"
            ),
        ),
        look=(
            on("ip -br link; nft list ruleset"),
            Advice("a computer behind it", "ping -M do -s 1472 -c 3 {beyond}"),
        ),
        cost=3.5,
        why="few people change an MTU",
    ),
    ("reverse_path", "strict"): Fault(
        "RF-273",
        "{place} drops packets that come in on another interface than the one that leads back to their source",
        do=(site("sets net.ipv4.conf.all.rp_filter to 2: the larger value of all and the interface counts"),),
        look=(on("sysctl -a --pattern rp_filter; ip route"),),
        cost=3.5,
        why="it needs two interfaces",
        hard=False,
        read=ALWAYS,
    ),
    ("redirects", "sent"): Fault(
        "RF-274",
        "{place} sends ICMP redirects, because packets turn round on the common network",
        do=(site("sets net.ipv4.conf.*.send_redirects to 0"),),
        look=(on("sysctl -a --pattern send_redirects"),),
        why="the value was read",
    ),
    ("translation", "on"): Fault(
        "RF-275",
        "{place} translates addresses (masquerading, NAT)",
        do=(
            hand("delete the rule on {place} that masquerades packets to the robots' networks: the look shows it"),
            hand("a container or virtual machine: connect it by a bridge, instead of NAT"),
            on(
                "conntrack -D --src-nat",
                "if no rule is left: it ends older connections, which are still translated",
            ),
        ),
        look=(
            on("nft -a list ruleset | grep -nE 'masquerade|snat|dnat'; iptables -t nat -S"),
            on("conntrack -L --src-nat", "the connections that are translated now"),
        ),
        cost=2.0,
        why="routers of homes, Docker and libvirt do it",
    ),
}
