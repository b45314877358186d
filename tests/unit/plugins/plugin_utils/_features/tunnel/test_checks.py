# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The check of the tunnel between computers: each fault is one finding, whatever fails with it."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._features.tunnel.model import Tunnel
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import (
    SeenTunnel,
    ServiceState,
    TunnelPeer,
)
from fleets import components, diagnosed, plan, update

NAMES = ["kobuki1computer", "kobuki2computer", "kobuki3computer"]
ONE, TWO, THREE = NAMES


def tunnels(fleet):
    """Make the answers of WireGuard on each computer, where all is well; the key of a computer is its name."""
    return {
        name: SeenTunnel(
            up=True,
            public_key=name,
            port=51820,
            time_s=5000.0,
            mtu=1420,
            peers=tuple(
                TunnelPeer(
                    peer.computer,
                    "",
                    tuple(map(str, peer.networks)),
                    heard=True,
                    handshake_age_s=30.0,
                    carrier_mtu=1480,
                )
                for peer in Tunnel.find(fleet.computers[name]).peers
            ),
        )
        for name in NAMES
    }


def tell(change=lambda seen: None):
    """The diagnosis of three robots with a tunnel after a change of what they see."""
    fleet = plan(
        3,
        multimaster_tunnel="wireguard",
        multimaster_transport="unicast",
        multimaster_firewall="fleet",
    )

    def seen_so(seen):
        for name, tunnel in tunnels(fleet).items():
            update(seen[name].probe, tunnel=tunnel)
        change(seen)

    return diagnosed(seen_so, fleet)


def peer(seen, one, other):
    """A peer as a computer sees it."""
    return next(entry for entry in seen[one].probe.tunnel.peers if entry.public_key == other)


def mute(*pairs):
    """Between these nothing comes through."""

    def change(seen):
        for one, other in pairs:
            for here, there in ((one, other), (other, one)):
                update(peer(seen, here, there), heard=False)

    return change


def another_key(*observers):
    """The key of TWO is not the one that these have of it."""

    def change(seen):
        for name in observers:
            update(peer(seen, name, TWO), public_key="other", heard=False)

    return change


def late(seconds):
    """Nothing comes through the tunnel of TWO, and its clock is so much behind."""

    def change(seen):
        update(seen[TWO].probe.tunnel, time_s=5000.0 - seconds)
        mute((ONE, TWO), (TWO, THREE))(seen)

    return change


def late_by_a_liar(seen):
    """Nothing comes through the tunnel of TWO, and the clock of THREE alone is ahead."""
    late(0)(seen)
    update(seen[THREE].probe.tunnel, time_s=12200.0)


def small_carrier(seen):
    for other in (ONE, THREE):
        update(peer(seen, TWO, other), carrier_mtu=1300)


def beside(seen):
    update(peer(seen, ONE, TWO), beside=("192.168.1.2",))


def without_peer(seen):
    kept = tuple(entry for entry in seen[ONE].probe.tunnel.peers if entry.public_key != TWO)
    update(seen[ONE].probe.tunnel, peers=kept)
    update(peer(seen, TWO, ONE), heard=False)


def ended(seen):
    update(seen[TWO].probe.tunnel, up=False, public_key="", port=0, peers=())
    services = tuple(entry for entry in seen[TWO].probe.services if "tunnel" not in entry.unit)
    update(
        seen[TWO].probe,
        services=(*services, ServiceState("tunnel", "multimaster-tunnel.service", "loaded", "inactive", "dead")),
    )
    for name in (ONE, THREE):
        update(peer(seen, name, TWO), heard=False)


def killed(seen):
    """Its unit is active, and wireguard-go is gone: so are its interface, the address and the routes."""
    update(seen[TWO].probe.tunnel, up=False, public_key="", port=0, peers=())
    update(seen[TWO].probe.forwarding.interfaces[0], addresses=())
    for name in (ONE, THREE):
        update(peer(seen, name, TWO), heard=False)


@pytest.mark.parametrize(
    ("change", "component"),
    [
        (mute((ONE, TWO), (TWO, THREE)), ("tunnel", TWO, "silent")),
        (late(3600), ("tunnel", TWO, "clock")),
        (late(-3600), ("tunnel", TWO, "silent")),
        (late(20), ("tunnel", TWO, "silent")),
        (late_by_a_liar, ("tunnel", TWO, "silent")),
        (small_carrier, ("tunnel", TWO, "mtu")),
        (beside, ("tunnel", ONE, "beside")),
        (mute((ONE, TWO)), ("tunnel", f"{ONE} and {TWO}", "pair")),
        (another_key(ONE, THREE), ("tunnel", TWO, "key")),
        (another_key(ONE), ("tunnel", ONE, "peer")),
        (without_peer, ("tunnel", ONE, "peer")),
        (ended, ("tunnel", TWO, "ended")),
        (killed, ("tunnel", TWO, "ended")),
    ],
)
def test_each_fault_of_a_tunnel_is_named_once(change, component):
    assert components(tell(change)) == [component]


def test_a_tunnel_that_works_has_no_finding():
    assert not tell().findings
