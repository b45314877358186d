# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The checks of the tunnel, if the common network is one: of each computer, and between two."""

from __future__ import annotations

from statistics import median_low

from ..._verify.checks.engine import FAILED, MEMBER, OK, Check, Judgement, judge_fault
from ..._verify.checks.hooks import CheckHooks
from ..._verify.components.component import Component
from ..._verify.context.check_context import CheckContext
from ..._verify.context.needs import Components, make_components
from ..._verify.observe.observations import SeenTunnel, TunnelPeer
from .context import list_way_components
from .model import PlannedPeer, Tunnel

HEADERS = 60  # bytes: of IPv4, UDP and WireGuard around each packet


def _find_small_carrier(context: CheckContext) -> int:
    """Return the MTU of the network that carries the tunnel of the observer, if it is too small for it; else 0."""
    seen = context.probe.tunnel
    sizes = [peer.carrier_mtu for peer in seen.peers if 0 < peer.carrier_mtu < seen.mtu + HEADERS]
    return min(sizes, default=0)


@Check(
    title="its tunnel is up",
    needs=lambda context: make_components("tunnel", context.observer.name, "ended", "mtu"),
)
def _judge_own_tunnel(context: CheckContext) -> Judgement | None:
    if Tunnel.find(context.observer.plan) is None or context.probe.tunnel.up is None:
        return None
    if not context.probe.tunnel.up:
        return Judgement(FAILED, "a tunnel", "none", make_components("tunnel", context.observer.name, "ended"))
    expected = f"a tunnel over a network that takes packets of {context.probe.tunnel.mtu + HEADERS} bytes"
    small = _find_small_carrier(context)
    found = f"one that takes {small} at most" if small else ""
    components = make_components("tunnel", context.observer.name, "mtu", what=f"{small} bytes at most")
    return judge_fault(FAILED, expected, found, "as planned", components)


# Between two computers

LATE = 120.0  # seconds; more than from the first answer of a computer to the last


def _find_planned(context: CheckContext, observer: str, target: str) -> PlannedPeer | None:
    """Return the planned peer of a computer."""
    plan = context.fleet.computers.get(observer)
    tunnel = Tunnel.find(plan) if plan else None
    return next((peer for peer in (tunnel.peers if tunnel else ()) if peer.computer == target), None)


def _look_at(context: CheckContext, computer: str) -> SeenTunnel:
    """Return the tunnel of a computer; that of one that was not looked at is not up."""
    return context.run[computer].probe.tunnel if computer in context.run else SeenTunnel()


def _find_peer(context: CheckContext, observer: str, planned: PlannedPeer) -> TunnelPeer | None:
    """Find a planned peer at a computer by its own address; None if it is reached through the hub."""
    seen = _look_at(context, observer)
    if not seen.up or _find_planned(context, observer, planned.computer) is None:
        return None
    return next((peer for peer in seen.peers if str(planned.networks[0]) in peer.networks), None)


def _is_as_planned(peer: TunnelPeer | None, planned: PlannedPeer) -> bool:
    return peer is not None and sorted(peer.networks) == sorted(map(str, planned.networks))


def _has_its_key(context: CheckContext, observer: str, planned: PlannedPeer) -> bool:
    """Return True if a computer has the key of the target; if the target was not looked at, nothing else is known."""
    there, peer = _look_at(context, planned.computer), _find_peer(context, observer, planned)
    return not there.up or peer is None or peer.public_key == there.public_key


def _hears(context: CheckContext, observer: str) -> bool:
    """Return True if a computer hears another one by its tunnel, or was not looked at."""
    seen = _look_at(context, observer)
    return not seen.up or any(peer.heard for peer in seen.peers)


def _is_heard(context: CheckContext, planned: PlannedPeer, observer: str) -> bool:
    """Return True if any other computer hears this one."""
    peers = [_find_peer(context, other, planned) for other in context.run if other not in (observer, planned.computer)]
    return any(peer.heard for peer in peers if peer)


def _find_silence(context: CheckContext, planned: PlannedPeer) -> Components:
    """Return the tunnel through which nothing comes: that of one of the two, if others do not get through either; else the one between them."""
    name = context.observer.name
    deaf, mute = not _hears(context, name), not _is_heard(context, planned, name)
    if deaf != mute:
        place = name if deaf else planned.computer
        late = _measure_lateness(context, place)
        if late > LATE:
            return make_components("tunnel", place, "clock", what=f"{late:.0f} s behind the others")
        return make_components("tunnel", place, "silent")
    return frozenset({Component.from_pair("tunnel", "pair", name, planned.computer)})


def _measure_lateness(context: CheckContext, place: str) -> float:
    """Return the seconds by which the clock of a computer is behind those of the others; a single one of these may be ahead. All are asked within seconds."""
    seen = {name: _look_at(context, name) for name in context.run}
    times = {name: tunnel.time_s for name, tunnel in seen.items() if tunnel.up and tunnel.time_s is not None}
    others = [moment for name, moment in times.items() if name != place]
    return median_low(others) - times[place] if others and place in times else 0.0


def _find_mistake(context: CheckContext, one: str, other: str) -> Components:
    """Return the mistake of one computer about another one: other addresses, or a key that is not its own."""
    planned = _find_planned(context, one, other)
    if planned is None or not _look_at(context, one).up:
        return frozenset()
    if not _is_as_planned(_find_peer(context, one, planned), planned):
        return make_components("tunnel", one, "peer", what=other)
    if _has_its_key(context, one, planned):
        return frozenset()
    others = [name for name in context.run if name not in (one, other) and _find_peer(context, name, planned)]
    if any(_has_its_key(context, name, planned) for name in others):
        return make_components("tunnel", one, "peer", what=other)
    return make_components("tunnel", other, "key")


def _find_fault(context: CheckContext, planned: PlannedPeer, peer: TunnelPeer | None) -> Components:
    name, target = context.observer.name, context.target
    if peer and peer.beside:
        return make_components("tunnel", name, "beside", what=", ".join(peer.beside))
    if mistake := _find_mistake(context, name, target) or _find_mistake(context, target, name):
        return mistake
    has_ended = _look_at(context, target).up is False  # not None: it was looked at
    return make_components("tunnel", target, "ended") if has_ended else _find_silence(context, planned)


@Check(
    title="the tunnel between two computers is open",
    scope=MEMBER,
    needs=lambda context: list_way_components(context, (context.observer.name, context.target)),
)
def _judge_tunnel(context: CheckContext) -> Judgement | None:
    planned = _find_planned(context, context.observer.name, context.target)
    if planned is None or not _look_at(context, context.observer.name).up:
        return None  # the check above has a row for it
    peer = _find_peer(context, context.observer.name, planned)
    if peer is None or not _is_as_planned(peer, planned):
        networks = ", ".join(map(str, planned.networks))
        found = f"one with {', '.join(peer.networks)}" if peer else "none"
        return Judgement(FAILED, f"a peer with {networks}", found, _find_fault(context, planned, peer))
    if not _has_its_key(context, context.observer.name, planned):
        return Judgement(FAILED, "its own key", f"the key {peer.public_key}", _find_fault(context, planned, peer))
    if peer.beside:
        elsewhere = f"others to {', '.join(peer.beside)}"
        return Judgement(FAILED, "routes by the tunnel", elsewhere, _find_fault(context, planned, peer))
    age = "there was none" if peer.handshake_age_s is None else f"the last was {peer.handshake_age_s:.0f} s ago"
    found = f"{'it is heard' if peer.heard else 'nothing in 9 s'}; of handshakes {age}"
    broken = frozenset() if peer.heard else _find_fault(context, planned, peer)
    return Judgement(OK if peer.heard else FAILED, "something from it within 9 s", found, broken)


HOOKS = CheckHooks(checks=(_judge_own_tunnel, _judge_tunnel), after="programs")
