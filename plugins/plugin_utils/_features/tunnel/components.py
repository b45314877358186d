# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The faults of a tunnel."""

from __future__ import annotations

from ..._verify.components.fault import READ, ROUTES, SITE, ComponentHooks, Fault

ENDED, BESIDE = ("tunnel", "ended"), ("tunnel", "beside")

HOOKS = ComponentHooks(
    faults={
        ("tunnel", "ended"): Fault(
            "multimaster-tunnel.service does not run on {place}, or its tunnel has ended",
            "on {place}: systemctl restart multimaster-tunnel; see on {place}: journalctl -b -u multimaster-tunnel; wg show multimaster0",
            "on {place}: systemctl status multimaster-tunnel; wg show multimaster0",
            cost=2.0,
            read=READ,
        ),
        ("tunnel", "peer"): Fault(
            "{place} has other peers in its tunnel than planned: {what}",
            f"{SITE}, which writes the peers of all computers",
            "on {place}: wg show multimaster0 allowed-ips",
            cost=2.0,
            what="a computer of the fleet",
            read=READ,
        ),
        ("tunnel", "key"): Fault(
            "the key of {place} is not the one that others have of it",
            f"find out who has set {{place}} up anew; if it was you, {SITE} with -e tunnel_rotate=true",
            "on {place}: wg show multimaster0 public-key",
            cost=2.0,
            read=READ,
        ),
        ("tunnel", "silent"): Fault(
            "nothing comes through the tunnel of {place}",
            "let its UDP port pass in the network that carries it, and look at the clock: handshakes of a computer whose clock went back are refused; see",
            "on {place}: wg show multimaster0; date --utc; nft list ruleset",
        ),
        ("tunnel", "beside"): Fault(
            "packets of {place} for {what} take another route than the tunnel",
            "remove it, or the program that makes it; see",
            ROUTES,
            cost=2.0,
            what="others",
            read=READ,
        ),
        ("tunnel", "mtu"): Fault(
            "the network that carries the tunnel of {place} takes packets of {what}, so large ones are lost",
            "on {place}: systemctl restart multimaster-tunnel, which takes the size of that network anew; see",
            "on {place}: ip link",
            cost=2.0,
            what="less than the tunnel sends",
            read=READ,
        ),
        ("tunnel", "clock"): Fault(
            "nothing comes through the tunnel of {place}, and its clock is {what}: handshakes of a clock that went back are refused",
            "set its clock: on {place}: date --utc --set ...; keep it right with a battery for the clock, or with multimaster_clock",
            "on {place}: date --utc; wg show multimaster0 latest-handshakes",
            what="behind the others",
        ),
        ("tunnel", "pair"): Fault(
            "nothing comes through the tunnel between {place}, and both reach others",
            "look at what is between them in the network that carries it; see",
            "on {place}: wg show multimaster0 endpoints",
            cost=4.0,
        ),
    },
    # With a tunnel its interface is gone, with its address and its routes; what is measured by the group needs that address.
    causes={
        ("computer", "unmeasured"): (ENDED,),
        ("route", "missing"): (ENDED,),
        ("route", "other"): (BESIDE, ENDED),
        ("interface", "address"): (ENDED,),
        ("interface", "prefix"): (ENDED,),
    },
)
