# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Metrics in the text format of Prometheus, for the textfile collector of node_exporter.

`FAMILIES` has all metrics. Names of others become values of labels: plain, short and escaped, and there
are at most as many values as there are links that are shown (health.py).
"""

from typing import Dict, List, Mapping, NamedTuple, Sequence, Tuple

from .plain_text import plain

PREFIX = "multimaster_"  # of all names, as Prometheus has them
VERSION = "1.1.0"  # of the collection; galaxy.yml has the same
LABEL = 100  # characters of the value of a label
MOST = 1000  # lines of one metric
REASONS = ("node", "service", "type", "place", "limit", "parameter")  # kinds of refusals
CHANGES = ("registered", "unregistered")

Values = Tuple[str, ...]
Samples = Dict[str, Dict[Values, float]]  # metric -> values of its labels -> value


class Family(NamedTuple):
    """A metric: its kind, its labels, and a sentence about it."""

    kind: str
    labels: Sequence[str]
    help: str


_OF_BOTH = ("node",)
_OF_LINK = ("master",)
_OF_TOPIC = ("topic",)

#: name -> metric, in the order in which they are written
FAMILIES: Mapping[str, Family] = {
    # of all nodes
    "build_info": Family("gauge", ("node", "version"), "Version of the collection; the value is always 1."),
    "last_update_timestamp_seconds": Family("gauge", _OF_BOTH, "When the node wrote this, in seconds since 1970."),
    "queue_length": Family("gauge", _OF_BOTH, "Calls of its threads that wait for the loop of the node."),
    "received_bytes_total": Family("counter", _OF_BOTH, "Bytes of answers of other computers over XML-RPC."),
    # of master_discovery
    "roscore_up": Family("gauge", (), "Whether the roscore of this robot answers."),
    "masters_online": Family("gauge", (), "Masters of other robots that are heard."),
    "link_up": Family("gauge", _OF_LINK, "Whether a master is heard. Those of the fleet are always listed."),
    "link_lost_total": Family("counter", _OF_LINK, "How often a master was lost."),
    "link_silence_seconds": Family("gauge", _OF_LINK, "Seconds since a master was heard."),
    "link_heartbeats_ratio": Family("gauge", _OF_LINK, "Heartbeats that came lately, of those that are promised."),
    "link_answer_seconds": Family(
        "gauge", _OF_LINK, "Seconds until a master answered a question over TCP, with the connection."
    ),
    "clock_offset_seconds": Family(
        "gauge",
        _OF_LINK,
        "How far the clock of a master is ahead of the one here, give or take half of the answer time.",
    ),
    "links_left_out": Family("gauge", (), "Links that are not listed, since there are too many."),
    "strangers_ignored": Family("gauge", (), "Senders that are ignored, since they do not belong to the fleet."),
    "datagrams_sent_total": Family("counter", (), "Datagrams that discovery sent."),
    "datagrams_received_total": Family("counter", (), "Datagrams that discovery received."),
    "malformed_total": Family("counter", ("what",), "Datagrams and requests that were malformed or not allowed."),
    "changes_sent_total": Family("counter", (), "Answers with changes to other masters."),
    "sent_bytes_total": Family("counter", (), "Bytes of answers to other programs over XML-RPC."),
    # of master_sync
    "registrations": Family("gauge", ("master", "kind"), "Registrations of other masters in the own roscore."),
    "registration_changes_total": Family(
        "counter", ("change",), "Registrations of other masters that were made in the own roscore, and withdrawn."
    ),
    "parameters": Family("gauge", _OF_LINK, "Parameters of other masters that are kept in the own roscore."),
    "refusals": Family("gauge", ("reason",), "Registrations and parameters that are refused now."),
    "refusals_total": Family("counter", ("reason",), "Registrations and parameters that were refused."),
    "changes_received_total": Family("counter", (), "Changes that other masters reported."),
    "states_received_total": Family("counter", (), "Whole states that were fetched from other masters."),
    "round_seconds": Family("gauge", (), "Seconds that the last round of synchronising took."),
    "round_failures_total": Family("counter", (), "Rounds of synchronising that failed."),
    # of master_relay
    "relay_robots": Family("gauge", (), "Robots whose relay answers."),
    "relay_messages_total": Family("counter", _OF_TOPIC, "Messages that came to the relay."),
    "relay_bytes_total": Family("counter", _OF_TOPIC, "Bytes of messages that came to the relay."),
    "relay_dropped_total": Family(
        "counter", _OF_TOPIC, "Messages that did not get to a listener: too many, or too fast."
    ),
}


def text(samples: Mapping[str, Mapping[Values, float]]) -> str:
    """The text of samples. Of two with the same labels, which would spoil the whole file, the first one counts."""
    lines: List[str] = []
    for name, family in FAMILIES.items():
        found = samples.get(name, {})
        if found:
            lines += [f"# HELP {PREFIX}{name} {family.help}", f"# TYPE {PREFIX}{name} {family.kind}"]
            unique: Dict[str, float] = {}
            for values, value in found.items():
                unique.setdefault(_labels(family.labels, values), value)
            lines += [f"{PREFIX}{name}{labels} {_number(value)}" for labels, value in list(unique.items())[:MOST]]
    return "".join(f"{line}\n" for line in lines)


def _labels(names: Sequence[str], values: Values) -> str:
    pairs = ",".join(f'{name}="{_escape(value)}"' for name, value in zip(names, values))
    return f"{{{pairs}}}" if pairs else ""


def _escape(value: str) -> str:
    return plain(value, LABEL).replace("\\", "\\\\").replace('"', '\\"')


def _number(value: float) -> str:
    return str(int(value)) if value == int(value) else repr(round(value, 6))


# The samples


def scalar_samples(**values: float) -> Samples:
    """Samples of metrics without labels, by their names."""
    return {name: {(): value} for name, value in values.items()}


def node_samples(node: str, now: float, queue: int, received: int) -> Samples:
    """The samples that both nodes have. `now`: the wall clock."""
    name = node.rpartition("/")[2]
    return {
        "build_info": {(name, VERSION): 1},
        "last_update_timestamp_seconds": {(name,): now},
        "queue_length": {(name,): queue},
        "received_bytes_total": {(name,): received},
    }
