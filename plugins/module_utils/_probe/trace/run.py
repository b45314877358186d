# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The actions of multimaster_packet_trace: listen, send and collect."""

import typing

from ..._base.background import ask, end_others, explain_refusal, find_wrong_value, leave, open_door, path_of
from ..._base.deadlines import call_all
from ..._base.problem import Problem
from ..._contract.outcomes import Outcome
from ..._machine.network import is_address
from .capture import Tag, open_socket
from .counters import read_counters
from .listener import serve
from .sender import LARGEST, Probe, SendResult, send

KIND = "follow"  # of the doors of listeners
MOST_PROBES = 16
SETTLE = 8.0  # seconds for all probes of this computer
ANSWER = 20.0  # seconds for a listener to count once more, and to reply

Params = typing.Dict[str, typing.Any]
Result = typing.Dict[str, typing.Any]


def find_wrong_option(params: Params) -> typing.Optional[str]:
    """Name in one sentence the option that cannot be used; None if all can."""
    wrong = find_wrong_value(params, (("lifetime", 1, 120),), " seconds")
    if wrong:
        return wrong
    if len(params["probes"]) > MOST_PROBES:
        return f"probes has {len(params['probes'])} entries, expected {MOST_PROBES} at most."
    return next(filter(None, map(_find_wrong_probe, params["probes"])), None)


def _find_wrong_probe(probe: Probe) -> typing.Optional[str]:
    place = f"probes: the %s of number {probe['number']}"
    for key in ("address", "interface_address"):
        if not is_address(probe[key]) and (probe[key] or key == "address"):
            return f"{place % key} is {probe[key]!r}, expected an IPv4 address such as 192.168.1.239."
    for key, least, most in (
        ("number", 0, 255),
        ("size", 0, LARGEST),
        ("port", 0 if probe["protocol"] == "icmp" else 1, 65535),
    ):
        if not least <= probe[key] <= most:
            return f"{place % key} is {probe[key]}, expected {least} to {most}."
    return None


def start_listener(params: Params, _check_mode: bool) -> Result:
    """Leave a listener behind. Its sockets are opened first, so an error shows in this task."""
    ports = (probe["port"] for probe in params["probes"] if probe["protocol"] == "tcp")
    tag, path = Tag.from_run(params["run"], ports), path_of(KIND, params["run"])
    with explain_refusal("Cannot see the packets of this computer"):
        end_others(KIND)
        before = read_counters()
        link = open_socket(tag)
        door = open_door(path)
    leave(lambda: serve(link, door, path, tag, params["lifetime"], before), (link, door), "multimaster_packet_trace")
    return {"msg": f"The listener lives for {params['lifetime']} s at most."}


def send_probes(params: Params, _check_mode: bool) -> Result:
    """Send the probes of this computer, all at the same time."""
    tag = Tag.from_run(params["run"])
    own = [probe for probe in params["probes"] if probe["sender"] == params["name"]]
    results = call_all(
        lambda probe: send(tag, probe), own, SETTLE, lambda probe: SendResult(probe["number"], Outcome.NO_ANSWER)
    )
    sent = [dict(one._asdict(), outcome=one.outcome.value, data=one.data.value) for one in results]
    return {"msg": f"Sent {len(sent)} probes.", "sent": sent}


def collect_packets(params: Params, _check_mode: bool) -> Result:
    """Ask the listener for the packets that it has seen. It ends with its answer."""
    reply = ask(path_of(KIND, params["run"]), {"do": "tell"}, ANSWER)
    if not reply:
        raise Problem(
            "No listener of this run lives on this computer: its task with action=listen did not run, "
            "or its lifetime was over."
        )
    return dict(reply, msg=f"Saw {len(reply['seen'])} packets.")


ACTIONS = {"listen": start_listener, "send": send_probes, "collect": collect_packets}
