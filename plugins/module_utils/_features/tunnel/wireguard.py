# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The tunnel of this computer as WireGuard shows it. The words that are asked for have no private key (wg(8))."""

import re
import time
import typing

from ..._base.commands import run, text
from ..._machine import network

INTERFACE = "multimaster0"
MOST = 1000  # peers that are listed
LISTENS = 9.0  # seconds at most: three keepalives, or a handshake that is tried again after 5 s
# Seconds that a session lasts without another handshake, and those after which its loss at the other end is noticed: 15 s, and a handshake.
SESSION, NOTICED = 180.0, 17.0
LOOKS = 0.5  # seconds between two looks
_KEY = re.compile(r"[A-Za-z0-9+/]{43}=")
_NETWORK = re.compile(r"\d{1,3}(?:\.\d{1,3}){3}/\d{1,2}")
_ENDPOINT = re.compile(r"\d{1,3}(?:\.\d{1,3}){3}:\d{1,5}")
_NUMBER = re.compile(r"\d{1,18}")


def look() -> typing.Dict[str, typing.Any]:
    """Read the tunnel: whether it is up, its key and port, and its peers, with whether each was heard meanwhile."""
    before = count_received()
    heard = _listen(before, before.keys(), LISTENS)
    key, port = _ask("public-key"), _ask("listen-port")
    ends, networks, times = (_read(word) for word in ("endpoints", "allowed-ips", "latest-handshakes"))
    now = time.time()
    peers = [
        {
            "public_key": peer,
            "endpoint": next(iter(_ENDPOINT.findall(ends.get(peer, ""))), ""),
            "networks": sorted(_NETWORK.findall(allowed))[:MOST],
            "handshake_age_s": _measure_age(times.get(peer, ""), now),
            "heard": peer in heard,
            "beside": _list_beside(allowed),
            "carrier_mtu": _measure_carrier(ends.get(peer, "")),
        }
        for peer, allowed in sorted(networks.items())
    ]
    return {
        "up": _KEY.fullmatch(key) is not None,
        "public_key": key if _KEY.fullmatch(key) else "",
        "port": int(port) if _NUMBER.fullmatch(port) else 0,
        "time_s": round(now, 1),
        "mtu": _read_mtu(INTERFACE),
        "peers": peers[:MOST],
    }


def wait_for_sessions(before: typing.Mapping[str, int]) -> None:
    """Wait until something has come from all with whom there was a handshake lately. `before`: count_received, some time ago.

    The tunnel at the other end may have been started again. Who knows its endpoint notices that at once, and others when nothing answers.
    """
    now, times = time.time(), _read("latest-handshakes")
    ages = {peer: _measure_age(times.get(peer, ""), now) for peer in before}
    _listen(before, {peer for peer, age in ages.items() if age is not None and age < SESSION}, NOTICED)


def count_received() -> typing.Dict[str, int]:
    """Count the bytes that have come from each peer: {public key: bytes}; empty if there is no tunnel."""
    numbers = {peer: line.partition("\t")[0] for peer, line in _read("transfer").items()}
    return {peer: int(number) if _NUMBER.fullmatch(number) else 0 for peer, number in numbers.items()}


def _listen(before: typing.Mapping[str, int], wanted: typing.AbstractSet[str], limit: float) -> typing.Set[str]:
    """Return the peers that something comes from, as soon as all that are wanted are among them."""
    heard: typing.Set[str] = set()
    for _look in range(int(limit / LOOKS)):
        if wanted <= heard:
            break
        time.sleep(LOOKS)
        after = count_received()
        heard = {peer for peer in before if before[peer] < after.get(peer, 0)}
    return heard


def _ask(word: str) -> str:
    """Ask wg for one thing; empty if it does not answer."""
    answer = run(["wg", "show", INTERFACE, word])
    return answer.text.strip() if answer.status == 0 else ""


def _read(word: str) -> typing.Dict[str, str]:
    """Read lines of a key and a value."""
    lines = (line.partition("\t") for line in _ask(word).splitlines())
    return {key: value for key, _tab, value in lines if _KEY.fullmatch(key)}


def _list_beside(allowed: str) -> typing.List[str]:
    """List the addresses of a peer to which another route leads than by the tunnel."""
    addresses = [place[:-3] for place in _NETWORK.findall(allowed)[:MOST] if place.endswith("/32")]
    return [address for address in addresses if network.route_to(address).device not in (None, INTERFACE)]


def _measure_carrier(endpoint: str) -> int:
    """Return the MTU of the interface that leads to a peer; 0 if no route does."""
    return _read_mtu(network.route_to(endpoint.rpartition(":")[0]).device or "")


def _read_mtu(interface: str) -> int:
    number = text(f"/sys/class/net/{interface}/mtu").strip()
    return int(number) if _NUMBER.fullmatch(number) else 0


def _measure_age(moment: str, now: float) -> typing.Optional[float]:
    """Return the seconds since a handshake; None if there was none. A clock that went back makes no age below 0."""
    if not _NUMBER.fullmatch(moment) or int(moment) == 0:
        return None
    return round(max(0.0, now - int(moment)), 1)
