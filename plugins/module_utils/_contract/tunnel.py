# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The state of a computer's tunnel."""

import typing

from .fields import Struct, field


class TunnelPeer(Struct):
    """Another computer in the tunnel, as WireGuard of the observer knows it."""

    public_key: str = field(
        "The public key of the other computer.", "aMFEklSnshJSw/GPt1vxqBhXbTHvA70Xv/1DVHwZrAA=", needed=True
    )
    endpoint: str = field(
        "The address and port at which it was heard last, or the one that is tried; empty for neither.",
        "192.168.1.239:51820",
    )
    networks: typing.Tuple[str, ...] = field("The addresses and networks that are its own.", ["10.77.0.2/32"])
    heard: bool = field(
        "Whether anything came from it within 9 s, in which it sends something three times, or tries a handshake again.",
        True,
    )
    handshake_age_s: typing.Optional[float] = field(
        "The seconds since the last handshake, or null if there was none.", 12.0
    )
    beside: typing.Tuple[str, ...] = field("Its addresses to which another route leads than through the tunnel.", [])
    carrier_mtu: int = field(
        "The MTU of the interface by which packets to it leave the computer, in bytes, or 0 if it is not known.",
        1500,
    )


class SeenTunnel(Struct):
    """The tunnel of a computer; `up` is None if it was not looked at."""

    up: typing.Optional[bool] = field("Whether there is one, or null if it was not looked at.", True)
    public_key: str = field("The public half of its own key, or empty.", "gkP4R9BW/LAS3o72Pgyd9RV5/Y+44cDLYXHuIXhbnQY=")
    port: int = field("Its UDP port, or 0.", 51820)
    time_s: typing.Optional[float] = field(
        "The time of its clock, in seconds since 1970, or null if the tunnel was not looked at.", 1764147600.0
    )
    mtu: int = field("The largest packet that it takes, in bytes, or 0.", 1420)
    peers: typing.Tuple[TunnelPeer, ...] = field("The other computers that it lets in.", [])
