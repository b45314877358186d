# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""What multimaster_verify knows without a socket, a process or a clock: texts and packets in, facts out."""

import re
import shlex
import struct
import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._verify.multicast import packet

TALKER = "multimaster-verify-talker.service"

# RFC 792: (type, code) of the messages that come back instead of an echo reply
_REFUSALS = {
    (3, 0): "network unreachable",
    (3, 1): "host unreachable",
    (3, 9): "network administratively prohibited",
    (3, 10): "host administratively prohibited",
    (3, 13): "communication administratively prohibited",
    (11, 0): "time to live exceeded: the routers pass it round in a circle",
}

# A connection of a node, as its getBusInfo tells it: "in" from a publisher (peer is its URI), "out" to a subscriber (peer
# is its name); host is the other end.
Link = typing.NamedTuple("Link", [("direction", str), ("topic", str), ("peer", str), ("host", str)])
Echo = typing.NamedTuple("Echo", [("source", str), ("sequence", int), ("error", str)])


def topic_of(computer: str) -> str:
    """The topic on which a computer's talker publishes: its name in the letters of a ROS graph name."""
    return "/multimaster_verify/" + re.sub(r"\W", "_", computer)


def node_of(run: str, computer: str) -> str:
    """The name of a computer's talker: no other node of the fleet has it, however many start in the same instant."""
    return re.sub(r"\W", "_", f"multimaster_verify_talker_{computer}_{run}")


def listener_of(computer: str) -> str:
    """The beginning of the name of the node that hears the others' talkers; rospy makes the rest of it."""
    return re.sub(r"\W", "_", f"multimaster_verify_listener_{computer}")


def interpreter(script: bytes) -> typing.List[str]:
    """The words of a script's first line (execve(2)): what runs a command of ROS; empty where it is no script."""
    line = script.split(b"\n", 1)[0].decode("utf-8", "replace")
    return line[2:].split() if line.startswith("#!") else []


def sentence_of(run: str, computer: str) -> str:
    """What the talker says: the label of the run, so that an older talker is not taken for it, and who it is."""
    return f"{run} {computer}"


def environment(content: str) -> typing.Dict[str, str]:
    """The variables of an environment file (systemd.exec(5)): plain, or in double quotes, as this collection writes it."""
    variables = {}
    for line in content.split("\n"):
        name, equals, value = line.partition("=")
        if equals and not line.startswith(("#", ";")):
            try:
                variables[name.strip()] = "".join(shlex.split(value))
            except ValueError:  # an unfinished quotation
                variables[name.strip()] = value
    return variables


def differing(process: typing.Dict[str, str], wanted: typing.Dict[str, str]) -> typing.List[str]:
    """Name the wanted variables that have another value, or none, in the environment of a process."""
    return sorted(name for name, value in wanted.items() if process.get(name) != value)


def masters(output: str) -> typing.List[typing.Dict[str, typing.Any]]:
    """The masters in what `rosservice call .../list_masters` prints (YAML by genpy): their texts and `online`.

    The deeper lines (secs and nsecs of the times) are left out; the report's version had other fields for them.
    """
    found: typing.List[typing.Dict[str, typing.Any]] = []
    for line in output.splitlines():
        if re.match(r"\s*-\s*$", line):
            found.append({"name": "", "uri": "", "online": False, "monitoruri": ""})
        field = re.match(r" {4}(name|uri|online|monitoruri):\s*(.*?)\s*$", line)
        if field and found:
            name, value = field.groups()
            found[-1][name] = value == "True" if name == "online" else unquoted(value)
    return found


def unquoted(value: str) -> str:
    """A text as genpy prints it: in quotes where ROS is new enough."""
    return value[1:-1] if len(value) > 1 and value[0] == value[-1] and value[0] in "\"'" else value


def links(entries: typing.Any) -> typing.List[Link]:
    """The connections in an answer to getBusInfo (ROS Slave API); the last element, a text, is missing before kinetic."""
    found = []
    for entry in entries if isinstance(entries, list) else []:
        if not isinstance(entry, list) or len(entry) < 5 or not all(isinstance(text, str) for text in entry[1:5]):
            continue
        peer, inward = entry[1], entry[2] == "i"
        text = entry[6] if len(entry) > 6 else ""
        end = re.search(r" to \[(.+):\d+ on socket", text if isinstance(text, str) else "")
        found.append(
            Link(
                "in" if inward else "out", entry[4], peer, end.group(1).lower() if end else host(peer if inward else "")
            )
        )
    return found


def host(uri: str) -> str:
    """The host text of a URI, in small letters; empty where there is none."""
    match = re.match(r"\w+://([^/:]+)", uri)
    return match.group(1).lower() if match else ""


def echo(received: bytes, identifier: int) -> typing.Optional[Echo]:
    """What an IPv4 packet says on an echo request of ours: a reply, or a router's refusal; None for anything else."""
    outer = packet(received)
    if outer is None or len(outer.body) < 8:
        return None
    kind, code, echoed, sequence = struct.unpack("!BB2xHH", outer.body[:8])
    if (kind, code) == (0, 0):
        return Echo(outer.source, sequence, "") if echoed == identifier else None
    inner = packet(outer.body[8:]) if (kind, code) in _REFUSALS else None
    if inner is None or len(inner.body) < 8:
        return None
    kind_sent, echoed, sequence = struct.unpack("!B3xHH", inner.body[:8])
    if (kind_sent, echoed) != (8, identifier):
        return None
    return Echo(outer.source, sequence, f"{outer.source} reports: {_REFUSALS[kind, code]}")


def route(output: str) -> typing.Dict[str, typing.Optional[str]]:
    """Device, source address, gateway and metric in a line of `ip route`; None for what it does not say."""
    found = {}
    for field, word in (("device", "dev"), ("source", "src"), ("gateway", "via"), ("metric", "metric")):
        match = re.search(rf"\b{word} (\S+)", output)
        found[field] = match.group(1) if match else None
    return found
