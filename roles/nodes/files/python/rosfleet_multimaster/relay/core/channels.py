# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The channels of a relay: which topics and services cross, to whom, by which names.

On the robot that a channel is of, names are inner ones (/scan). Its peers have them below a namespace (/kobuki1/scan), and so
have the two relays between them. Topics of the robot go to the peer; topics that are named for it come back. Each relay
gives and takes by this itself, so no other one makes it do more.
"""

from typing import Any, Container, Dict, Iterable, List, Mapping, NamedTuple, Optional, Sequence, Tuple

from ...protocol.filters import MAX_NAME, Pattern
from ...protocol.graph import NAME, VISIBLE
from ...protocol.messages import NodeKey
from ...protocol.tcpros.hosts import host_of
from .frames import STATIC, STATIC_TYPE, Frames
from .rates import NO_RATE, Rate

MOST_OFFERS = 1000  # of one peer
# Of one topic, of all topics of one peer, and of all peers together: each costs 800 bytes if they are taken.
MOST_NODES, MOST_OF_ALL, TOGETHER = 50, 2000, 40_000
TOPIC, SERVICE = "topic", "service"


class Offer(NamedTuple):
    """A topic or service that a relay offers to another one."""

    kind: str  # TOPIC or SERVICE
    name: str  # as the relays have it
    type: str  # of the messages; empty for a service
    nodes: Tuple[str, ...]  # that publish it, or the one that provides it


class Channel(NamedTuple):
    """The way of topics and services between this robot and a peer, by one entry of the inventory."""

    peer: str  # a robot
    hosts: Tuple[str, ...]  # addresses of its relay
    port: int  # of its relay
    topics: Pattern  # inner names
    services: Pattern
    back: Pattern  # inner names of topics that come from the peer to the robot with the inner names
    namespace: str  # such as /kobuki1; empty: the names are the same on both
    inner: bool  # the inner names are those of this robot
    base: str = ""  # the beginning of inner names that the namespace replaces
    rate: Rate = NO_RATE  # of each topic
    newest: bool = False  # only the newest message waits for a slow link
    frames: Optional[Frames] = None  # of the robot with the inner names, if the others have them by other names

    @classmethod
    def from_entry(cls, entry: Mapping[str, Any]) -> "Channel":
        """Read an entry of ~channels, which has been checked."""
        return cls(
            peer=entry["peer"],
            hosts=tuple(entry["hosts"]),
            port=entry["port"],
            topics=Pattern.from_items(entry["topics"], "topics"),
            services=Pattern.from_items(entry["services"], "services"),
            back=Pattern.from_items(entry["back"], "back"),
            namespace=entry["as"],
            inner=entry["inner"],
            base=entry["base"],
            rate=Rate(entry["rate"], tuple(entry["whole"])),
            newest=entry["newest"],
            frames=Frames(*(entry[name].encode() for name in ("frames", "world", "root"))) if entry["frames"] else None,
        )

    @property
    def inner_frames(self) -> Optional[Frames]:
        """The frames of this robot, if the peer has them by other names."""
        return self.frames if self.inner else None

    @property
    def has_root(self) -> bool:
        """True if the relay itself publishes the transform between this robot's tree of frames and those of others."""
        return self.inner_frames is not None and bool(self.inner_frames.world) and self.topics.matches(STATIC)

    def find_name(self, kind: str, local: str) -> Optional[str]:
        """Return the relays' name of a topic or service that this robot gives; None if it does not cross."""
        inner = local if self.inner else self._strip(local)
        return None if inner is None or not self._goes(kind, inner, given=True) else self.rename(inner)

    def find_local(self, kind: str, name: str, *, given: bool) -> Optional[str]:
        """Return this robot's name of a topic or service that the relays name so, and that it gives or takes; None if it does not."""
        inner = self._strip(name)
        if inner is None or not self._goes(kind, inner, given):
            return None
        return inner if self.inner else name

    def rename(self, inner: str) -> str:
        """Return the relays' name of an inner one."""
        return self.namespace + inner[len(self.base) :]

    def _goes(self, kind: str, inner: str, given: bool) -> bool:
        """Return True if this robot gives that, or takes it."""
        if given == self.inner:
            return (self.topics if kind == TOPIC else self.services).matches(inner)
        return kind == TOPIC and self.back.matches(inner)

    def _strip(self, name: str) -> Optional[str]:
        rest = name[len(self.namespace) :]
        inside = name.startswith(self.namespace) and (not rest or rest.startswith("/"))
        return (self.base + rest or None) if inside else None


Own = Dict[str, Tuple[str, ...]]  # topic or service -> nodes of this robot


class OwnNodes(NamedTuple):
    """Distinguishes the nodes of this robot from all others at its roscore: they are on its computers, and not in the record of master_sync."""

    hosts: Container[str]  # of this robot; multimaster_fkie's master_sync records nothing
    claims: Container[NodeKey] = ()

    def have(self, node: str, uri: str) -> bool:
        """True for a node of this robot."""
        return (node, uri) not in self.claims and host_of(uri) in self.hosts


def list_own(table: Mapping[str, Sequence[str]], uris: Mapping[str, str], own: str, ours: OwnNodes) -> Own:
    """Return the nodes of this robot of each topic or service. `uris`: of nodes; `own`: the relay itself."""
    found = {}
    for name, nodes in table.items():
        mine = tuple(node for node in nodes if node != own and NAME.match(node) and ours.have(node, uris.get(node, "")))
        if mine:
            found[name] = mine[:MOST_NODES]
    return found


def list_offers(
    channels: Iterable[Channel], topics: Own, services: Own, types: Mapping[str, str], own: str
) -> List[Offer]:
    """Return the offers of one peer's channels to it. `own`: the relay itself."""
    found: Dict[Tuple[str, str], Offer] = {}
    for channel in channels:
        if channel.has_root:
            static, others = channel.rename(STATIC), topics.get(STATIC, ())
            found[TOPIC, static] = Offer(TOPIC, static, STATIC_TYPE, (*others[: MOST_NODES - 1], own))
        for kind, table in ((TOPIC, topics), (SERVICE, services)):
            for local, nodes in table.items():
                name = channel.find_name(kind, local)
                if name is not None and (kind == SERVICE or local in types) and (kind, name) not in found:
                    found[kind, name] = Offer(kind, name, types.get(local, "") if kind == TOPIC else "", nodes)
    return _limit_nodes(sorted(filter(_is_good, found.values()))[:MOST_OFFERS])


def read_offers(value: Any, peers: int = 1) -> List[Offer]:
    """Read the offers of one of so many other relays, without those that have an odd name or type. Raises ValueError."""
    if not isinstance(value, list) or len(value) > MOST_OFFERS:
        raise ValueError(f"its offers are no list of at most {MOST_OFFERS}")
    return _limit_nodes(list(filter(_is_good, map(_read_offer, value))), min(MOST_OF_ALL, TOGETHER // peers))


def _limit_nodes(offers: List[Offer], most_of_all: int = MOST_OF_ALL) -> List[Offer]:
    """Leave out nodes of the topics that have most, if all of them have too many. No topic is lost."""
    counts = [len(offer.nodes) for offer in offers]
    most = MOST_NODES
    while sum(min(count, most) for count in counts) > most_of_all and most > 1:
        most -= 1
    return [offer._replace(nodes=offer.nodes[:most]) for offer in offers]


def _is_good(offer: Offer) -> bool:
    """Return True if an offer has nodes, and a name and a type that a roscore is to have."""
    good_name = NAME.match(offer.name) and len(offer.name) <= MAX_NAME
    return bool(offer.nodes and good_name and VISIBLE.match(offer.type or "*"))


def _read_offer(entry: Any) -> Offer:
    if (
        not isinstance(entry, list)
        or len(entry) != 4
        or entry[0] not in (TOPIC, SERVICE)
        or not isinstance(entry[3], list)
    ):
        raise ValueError("an offer is no topic or service with its type and its nodes")
    kind, name, type_name, nodes = entry
    texts = (name, *nodes, *([type_name] if kind == TOPIC else []))
    if len(nodes) > MOST_NODES or not all(isinstance(text, str) and 0 < len(text) <= MAX_NAME for text in texts):
        raise ValueError(f"an offer has an empty or too long name, or more than {MOST_NODES} nodes")
    return Offer(kind, name, type_name if kind == TOPIC else "", tuple(node for node in nodes if NAME.match(node)))


def find_taken(channels: Sequence[Channel], offers: Iterable[Offer]) -> Dict[Tuple[str, str], Tuple[Offer, Channel]]:
    """Return (kind, this robot's name) -> the offer and its channel, of the topics that a peer offers and a channel takes."""
    taken: Dict[Tuple[str, str], Tuple[Offer, Channel]] = {}
    for offer in offers:
        for channel in channels:
            local = channel.find_local(offer.kind, offer.name, given=False)
            if local is not None:
                taken.setdefault((offer.kind, local), (offer, channel))
    return taken
