# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The faults of a tunnel."""

from __future__ import annotations

from ..._faults.fault import COMPUTERS, READ, ComponentHooks, Fault, controller, hand, on, site, site_of_all

ENDED, BESIDE = ("tunnel", "ended"), ("tunnel", "beside")

HOOKS = ComponentHooks(
    kinds={"tunnel": "The robots of the fleet meet in the tunnel. A robot outside of it reaches nobody."},
    faults={
        ("tunnel", "ended"): Fault(
            "RF-611",
            "multimaster-tunnel.service does not run on {place}, or its tunnel has ended",
            do=(on("systemctl restart multimaster-tunnel"),),
            look=(
                on(
                    "systemctl status multimaster-tunnel; journalctl -b -n 50 -u multimaster-tunnel; wg show multimaster0"
                ),
            ),
            cost=2.0,
            why="programs end, and are switched off",
            read=READ,
        ),
        ("tunnel", "peer"): Fault(
            "RF-612",
            "{place} has other peers in its tunnel than planned: {what}",
            do=(site("writes the peers of all computers"),),
            look=(on("wg show multimaster0 allowed-ips"),),
            cost=2.0,
            why="a robot was added, and site.yml has not run here since",
            what="a computer of the fleet",
            read=READ,
        ),
        ("tunnel", "key"): Fault(
            "RF-613",
            "the key of {place} is not the one that others have of it",
            do=(
                hand("find out who has set {place} up anew; if it was you:"),
                site("makes and believes its new key", "-e tunnel_rotate=true"),
                site_of_all("gives that key to all others"),
            ),
            look=(on("wg show multimaster0 public-key"),),
            cost=2.0,
            why="a computer was set up anew",
            read=READ,
        ),
        ("tunnel", "silent"): Fault(
            "RF-614",
            "nothing comes through the tunnel of {place}",
            do=(
                hand("let the UDP port of the tunnel of {place} pass in the network that carries it"),
                on(
                    "systemctl restart multimaster-tunnel",
                    "after its clock was set right: handshakes of a clock that went back are refused",
                ),
            ),
            look=(on("wg show multimaster0; date --utc; nft list ruleset"),),
            why="packet filters of sites drop UDP",
        ),
        ("tunnel", "beside"): Fault(
            "RF-615",
            "packets of {place} for {what} take another route than the tunnel",
            do=(hand("delete that route on {place}, or end the program that makes it, such as another VPN"),),
            look=(on("ip rule; ip route"),),
            cost=2.0,
            why="DHCP, VPNs and Docker bring routes",
            what="others",
            read=READ,
        ),
        ("tunnel", "mtu"): Fault(
            "RF-616",
            "the network that carries the tunnel of {place} takes packets of {what}, so large ones are lost",
            do=(on("systemctl restart multimaster-tunnel", "takes the size of that network anew"),),
            look=(on("ip -br link; ip link show multimaster0"),),
            cost=2.0,
            why="the size of that network was read",
            what="less than the tunnel sends",
            read=READ,
        ),
        ("tunnel", "clock"): Fault(
            "RF-617",
            "nothing comes through the tunnel of {place}, and its clock is {what}: handshakes of a clock that went back are refused",
            do=(
                controller(
                    'ansible {place} -i {inventory} -b -m ansible.builtin.command -a "date --utc --set @$(date +%s)"',
                    "the time of the controller",
                ),
                hand("keep it right with a battery for the clock, or with multimaster_clock"),
            ),
            look=(on("date --utc; wg show multimaster0 latest-handshakes"),),
            what="behind the others",
            why="boards without a battery begin in the past",
        ),
        ("tunnel", "pair"): Fault(
            "RF-618",
            "nothing comes through the tunnel between {place}, and both reach others",
            do=(hand("let the UDP ports of the tunnels pass between {place}, in the network that carries them"),),
            look=(on("wg show multimaster0 endpoints; wg show multimaster0 latest-handshakes"),),
            cost=4.0,
            why="one computer is more often the reason than a pair",
            at=COMPUTERS,
        ),
    },
    # With a tunnel its interface is gone, with its address and its routes; measurements with the group need that address.
    causes={
        ("computer", "unmeasured"): (ENDED,),
        ("route", "missing"): (ENDED,),
        ("route", "other"): (BESIDE, ENDED),
        ("interface", "address"): (ENDED,),
        ("interface", "prefix"): (ENDED,),
    },
)
