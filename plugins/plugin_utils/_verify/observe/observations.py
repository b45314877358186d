# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Observations: what the modules multimaster_verify and multicast_verify return, as types.

`_base.plain.from_plain` reads them, once, in the action fleet_report. A field here is a key of the result there, with the
same meaning; the documentation of the two modules describes each.

Addresses are texts here, and compared as texts, since a machine may print something else. For example,
`ip route` prints "via inet6 fe80::1" for a route of IPv4 with a next hop of IPv6 (RFC 5549).
"""

from __future__ import annotations

from dataclasses import dataclass

from ..._plan.preflight import MachineState
from .outcomes import Outcome
from .second_look import SecondLook

# multimaster_verify: the network


@dataclass(frozen=True)
class Ping:
    """The answer to an ICMP echo request."""

    ok: bool = False
    rtt_ms: float | None = None
    error: str = ""
    outcome: Outcome = Outcome.NOT_TRIED
    errno: int | None = None  # of the observer's kernel
    icmp_type: int | None = None
    icmp_code: int | None = None
    reporter: str = ""  # the address that has answered: the target, or a router that says why it passes nothing on


@dataclass(frozen=True)
class Route:
    """The route that the kernel takes to an address."""

    device: str | None = None
    source: str | None = None
    gateway: str | None = None
    error: str = ""


@dataclass(frozen=True)
class DefaultRoute:
    """A default route of the computer."""

    device: str | None = None
    source: str | None = None
    gateway: str | None = None
    metric: str | None = None


@dataclass(frozen=True)
class SeenMember:
    """A computer of the fleet, seen from another computer. A computer looks up its own name only."""

    name: str
    address: str = ""
    addresses: tuple[str, ...] = ()
    file_addresses: tuple[str, ...] = ()  # of its name in /etc/hosts
    resolve_error: str = ""
    route: Route | None = None
    discovery_route: Route | None = None  # to its other address, at which its discovery node is; None without one
    ping_address: Ping | None = None
    ping_name: Ping | None = None
    ping_large: Ping | None = (
        None  # as large as the observer's interface allows; None without an answer to a small ping
    )
    neighbour: str = ""  # its hardware address, as the observer's kernel knows it; empty in another network
    neighbour_fixed: bool = False  # a permanent entry, set by hand
    # the addresses of its name for a user without rights; None where they were not looked up
    user_addresses: tuple[str, ...] | None = None
    loss: float | None = None  # the share of further small pings without an answer, 0 to 1; None where not measured
    tcp: str = ""  # where no ping was answered: the answer of an unused TCP port, "refused" or an error
    tcp_outcome: Outcome = Outcome.NOT_TRIED
    silent: bool = False  # no ping was answered, and no ICMP error came, though there was time for it


@dataclass(frozen=True)
class Claim:
    """The ARP answers for an address on a network of the computer: all hardware addresses but the computer's own."""

    address: str
    interface: str = ""
    macs: tuple[str, ...] = ()


@dataclass(frozen=True)
class Policy:
    """Rules and routes beside the main table: lines of `ip rule` and of `ip route show table all`."""

    rules: tuple[str, ...] = ()  # rules for other tables than the kernel's own
    closed: tuple[str, ...] = ()  # routes that lead nowhere


@dataclass(frozen=True)
class ForwardingInterface:
    """The kernel's settings of one interface; a setting is None where it cannot be read."""

    interface: str
    addresses: tuple[str, ...] = ()
    forwarding: int | None = None
    rp_filter: int | None = None
    send_redirects: int | None = None
    prefixes: tuple[int, ...] = ()  # the prefix length of each address; empty where it was not read
    mtu: int | None = None
    mac: str = ""
    state: str = ""  # the kernel's operational state: up, down, unknown and so on
    carrier_changes: int | None = None  # the times that its link came or went
    last: str = ""  # where it is down: the last line of the journal about its link
    point_to_point: bool = False  # a link with two ends, such as a tunnel
    power_save: bool | None = None  # of a wireless interface; None of any other one, and without an answer of iw
    port_of: str = ""  # the bridge or bond above it


@dataclass(frozen=True)
class ForwardingSettings:
    """The settings that decide whether the computer passes packets on."""

    ip_forward: int | None = None
    interfaces: tuple[ForwardingInterface, ...] = ()
    icmp_echo_ignore_all: int | None = None
    macs: tuple[str, ...] = ()  # the hardware addresses of all interfaces, also of those without an address


@dataclass(frozen=True)
class SeenMaster:
    """The discovery node of a master: its TCP port and its clock, seen from another computer."""

    computer: str
    address: str = ""
    port: int = 0
    open: bool = False
    connect_ms: float | None = None
    error: str = ""
    outcome: Outcome = Outcome.NOT_TRIED  # of the connection to that port
    errno: int | None = None
    route: Route | None = None  # to that address
    roscore: str = ""  # the port of its roscore: "open", or why it does not open; empty where it was not tried
    roscore_outcome: Outcome = Outcome.NOT_TRIED
    clock_offset_s: float | None = None
    clock_uncertainty_s: float | None = None
    clock_error: str = ""


# multimaster_verify: ROS


@dataclass(frozen=True)
class Roscore:
    """The answer of the roscore that ROS_MASTER_URI names."""

    uri: str = ""
    answer: str = ""
    error: str = ""
    outcome: Outcome = Outcome.NOT_TRIED


@dataclass(frozen=True)
class ListedMaster:
    """A master in the answer of `rosservice call /master_discovery/list_masters`."""

    name: str
    uri: str = ""
    online: bool = False
    monitoruri: str = ""


@dataclass(frozen=True)
class ListMasters:
    """The answer of `rosservice call /master_discovery/list_masters`."""

    masters: tuple[ListedMaster, ...] = ()
    seconds: float = 0.0
    error: str = ""


@dataclass(frozen=True)
class Publisher:
    """A registered publisher of a topic."""

    node: str
    uri: str = ""


@dataclass(frozen=True)
class HeardTopic:
    """The topic of another computer's talker, and the message on it."""

    computer: str
    topic: str
    publishers: tuple[Publisher, ...] = ()
    reached: str = ""  # where no message came from a publisher: "open", or why no connection to it opens
    reached_outcome: Outcome = Outcome.NOT_TRIED
    step: str = ""  # how far the call has come, where nothing was heard: told, answered or connected; empty before that
    listened: bool = True  # False where the listener itself failed
    heard: bool = False
    text: str = ""
    seconds: float | None = None
    error: str = ""


@dataclass(frozen=True)
class Refusal:
    """A name of another robot that a sync node refuses, and why."""

    name: str
    kind: str = ""  # node, service, type, place or parameter
    there: str = ""  # the URI of the node or service there, or the type of the topic
    master: str = ""  # the name of its master
    here: str = ""  # the same here, or the objection


@dataclass(frozen=True)
class Service:
    """A systemd service of the collection; `differing` is None where its process cannot be looked at."""

    name: str
    unit: str
    load_state: str = ""
    active_state: str = ""
    sub_state: str = ""
    restarts: int = 0
    differing: tuple[str, ...] | None = ()
    drop_ins: tuple[str, ...] = ()  # files of somebody else that set its variables, where some differ
    since: str = ""  # the time of its last change of state, as systemd writes it
    stopped: bool = False  # by a signal or a debugger
    refused: tuple[str, ...] = ()  # names of others that a sync node refuses
    refusals: tuple[Refusal, ...] = ()  # the same with the reasons; empty of an older sync node
    age_s: float | None = (
        None  # seconds since its last start, by the computer's own clock that nobody steps; None where it is unknown
    )
    open_files: int | None = None  # of its process with the fewest left; None where it could not be read
    most_files: int | None = None  # that this process may have open
    result: str = ""  # how it ended last, where it was started again or has failed: the Result of systemd
    status: int | None = None  # the exit status then, or the number of the signal


@dataclass(frozen=True)
class BootDeviation:
    """Something that will not be as planned after the next boot."""

    kind: str  # unit, sysctl, route or names
    name: str
    expected: str = ""
    found: str = ""
    file: str = ""
    when: str = ""  # the last change of the file; empty without one


@dataclass(frozen=True)
class Talker:
    """The talker of the computer itself."""

    running: bool = True
    error: str = ""


# multimaster_verify: the content of a roscore


@dataclass(frozen=True)
class RegisteredTopic:
    """A topic with the nodes that registered it."""

    name: str
    type: str = ""
    publishers: tuple[str, ...] = ()
    subscribers: tuple[str, ...] = ()
    md5sum: str = ""


@dataclass(frozen=True)
class RegisteredService:
    """A service with the node that provides it."""

    name: str
    node: str


@dataclass(frozen=True)
class Import:
    """The registrations that a roscore holds for another master."""

    master: str  # its URI
    topics: tuple[RegisteredTopic, ...] = ()
    services: tuple[RegisteredService, ...] = ()


@dataclass(frozen=True)
class Connection:
    """A connection of an own node with a node of another robot."""

    node: str
    topic: str
    direction: str  # in or out
    peer: str
    host: str
    robot: str


@dataclass(frozen=True)
class ParameterDifference:
    """A parameter of a node that is not as planned."""

    node: str  # master_discovery or master_sync
    name: str
    expected: str = ""
    found: str = ""


@dataclass(frozen=True)
class CrossingParameter:
    """A parameter that two robots are to have alike."""

    name: str
    digest: str = ""  # of its value; empty where it is not set


@dataclass(frozen=True)
class NodeParameters:
    """The parameters of the nodes on the roscore, compared with the plan; `nodes` names the compared nodes."""

    nodes: tuple[str, ...] = ()
    differing: tuple[ParameterDifference, ...] = ()
    crossing: tuple[CrossingParameter, ...] = ()
    error: str = ""


@dataclass(frozen=True)
class TunnelPeer:
    """Another computer in the tunnel, as WireGuard of the observer knows it."""

    public_key: str
    endpoint: str = ""
    networks: tuple[str, ...] = ()
    heard: bool = False
    handshake_age_s: float | None = None
    beside: tuple[str, ...] = ()  # its addresses to which another route leads than by the tunnel
    carrier_mtu: int = 0  # bytes, of the interface by which packets to it leave; 0: not known


@dataclass(frozen=True)
class SeenTunnel:
    """The tunnel of a computer; `up` is None where it was not looked at."""

    up: bool | None = None
    public_key: str = ""
    port: int = 0
    time_s: float | None = None  # of its clock, since 1970
    mtu: int = 0  # bytes
    peers: tuple[TunnelPeer, ...] = ()


@dataclass(frozen=True)
class TimeSource:
    """A computer or server that the time service of a computer asks."""

    address: str
    selected: bool = False
    reachable: bool = False
    offset_s: float | None = None  # this computer's clock is so much ahead of it


@dataclass(frozen=True)
class Clock:
    """The clock of the computer; None where its state is unknown."""

    synchronised: bool | None = None  # by the kernel: something disciplines it
    answers: bool | None = None  # a time service does
    service: str = ""
    sources: tuple[TimeSource, ...] = ()


@dataclass(frozen=True)
class Change:
    """A file that was changed, or a service that was started, and when."""

    about: str  # names, the order of name services, a maker of packet filters, or a table such as "table inet fleet"
    what: str  # the file or the service
    how: str = "was changed"
    when: str = ""


@dataclass(frozen=True)
class Disk:
    """The room for an ordinary user where services write; None where the file system does not count it."""

    path: str
    free_bytes: int | None = None
    free_files: int | None = None


@dataclass(frozen=True)
class FileLimit:
    """A process of ROS that may have very many files open."""

    node: str  # its name, or that of its program
    limit: int  # of open files; the soft one
    unit: str = ""  # that systemd starts it by


@dataclass(frozen=True)
class NodeHost:
    """A process of ROS that announces a host which the plan does not have for its computer, uses another roscore, or is stopped."""

    host: str  # empty if it is not known
    source: str = ""  # the variable or argument that has decided it, or hostname
    unit: str = ""  # of systemd, in which it runs
    ports: tuple[int, ...] = ()  # on which it listens
    node: str = ""  # the last part of its name, or its program
    master: str = ""  # the roscore that it uses, if that is not the planned one
    starter: str = ""  # shell, unit, launch or container
    launch: str = ""  # the launch file
    stopped: bool = False  # by a signal or a debugger
    readable: bool = True  # False where its environment may not be read


@dataclass(frozen=True)
class ContainerNames:
    """A container whose /etc/hosts is older than the names of the fleet."""

    node: str  # a process of ROS there
    unit: str = ""  # of the container
    missing: tuple[str, ...] = ()  # names


@dataclass(frozen=True)
class SilentNode:
    """A registered node of the robot that does not answer."""

    node: str
    host: str = ""  # in its URI
    error: str = ""  # such as "Connection refused"
    outcome: Outcome = Outcome.NOT_TRIED
    tcp_outcome: Outcome = Outcome.NOT_TRIED  # of a connection alone: it opens where the node hangs


@dataclass(frozen=True)
class AnnouncedHost:
    """An own node of a robot that announces a host which the plan does not have for its robot, or services elsewhere."""

    node: str
    host: str = ""
    port: int = 0
    services: str = ""  # the host of its services, if that is another computer


@dataclass(frozen=True)
class HostOfNodes:
    """A host that nodes announce, and how many do."""

    host: str
    nodes: int = 0


@dataclass(frozen=True)
class NodeCount:
    """The number of a robot's own nodes, and how many were asked for an answer."""

    registered: int = 0
    asked: int = 0
    hosts: tuple[HostOfNodes, ...] = ()


@dataclass(frozen=True)
class Exchange:
    """The content of a roscore: own registrations, those for other masters, and connections with other robots."""

    error: str = ""
    types_error: str = ""
    topics: tuple[RegisteredTopic, ...] = ()
    services: tuple[RegisteredService, ...] = ()
    imports: tuple[Import, ...] = ()
    silent: tuple[str, ...] = ()
    silences: tuple[SilentNode, ...] = ()  # the same nodes with their errors
    announced: tuple[AnnouncedHost, ...] = ()
    nodes: NodeCount = NodeCount()
    connections: tuple[Connection, ...] = ()


@dataclass(frozen=True)
class SentTopic:
    """The traffic of a topic from a node of the robot to the subscribers on another robot, by the node's own counters."""

    node: str
    topic: str
    robot: str
    subscribers: int = 0
    bytes_s: float = 0.0
    messages_s: float = 0.0


@dataclass(frozen=True)
class Traffic:
    """The traffic from the nodes of a robot to nodes of others, measured for some seconds."""

    seconds: float = 0.0
    flows: tuple[SentTopic, ...] = ()


@dataclass(frozen=True)
class Outsider:
    """A sender of heartbeats that the computer's discovery node ignores."""

    address: str
    name: str = ""
    uri: str = ""
    why: str = ""


@dataclass(frozen=True)
class Source:
    """The topics that the discovery node of a master gives, of those that it was asked for."""

    computer: str
    topics: tuple[str, ...] = ()
    given: tuple[str, ...] = ()
    error: str = ""  # why it gave no answer
    outcome: Outcome = Outcome.NOT_TRIED


@dataclass(frozen=True)
class Probe:
    """The result of multimaster_verify with `action: collect`."""

    members: tuple[SeenMember, ...] = ()
    default_routes: tuple[DefaultRoute, ...] = ()
    claims: tuple[Claim, ...] = ()
    policy: Policy = Policy()
    name_sources: tuple[str, ...] = ()  # the sources of names in their order (nsswitch.conf); empty where unknown
    forwarding: ForwardingSettings = ForwardingSettings()
    masters: tuple[SeenMaster, ...] = ()
    roscore: Roscore = Roscore()
    list_masters: ListMasters = ListMasters()
    topics: tuple[HeardTopic, ...] = ()
    outsiders: tuple[Outsider, ...] = ()
    sources: tuple[Source, ...] = ()
    exchange: Exchange = Exchange()
    traffic: Traffic = Traffic()
    parameters: NodeParameters = NodeParameters()
    clock: Clock = Clock()
    tunnel: SeenTunnel = SeenTunnel()
    disks: tuple[Disk, ...] = ()
    file_limits: tuple[FileLimit, ...] = ()
    container_names: tuple[ContainerNames, ...] = ()
    node_hosts: tuple[NodeHost, ...] = ()
    changes: tuple[Change, ...] = ()
    services: tuple[Service, ...] = ()
    next_boot: tuple[BootDeviation, ...] = ()
    talker: Talker | None = None
    ros_missing: str = ""
    problems: tuple[str, ...] = ()


@dataclass(frozen=True)
class Stream:
    """The rate of a stream to another computer; None where it was not measured."""

    computer: str
    mbit_s: float | None = None
    error: str = ""


@dataclass(frozen=True)
class Streams:
    """The result of multimaster_verify with `action: stream`."""

    streams: tuple[Stream, ...] = ()


# multicast_verify


@dataclass(frozen=True)
class Datagrams:
    """The datagrams between the computer and another computer; None where no count came back."""

    name: str
    address: str = ""
    multicast: bool = False
    heard_from: bool = False
    heard: int = 0
    source_address: str | None = None
    other_interfaces: tuple[str, ...] = ()
    heard_by: bool | None = None
    loss: float | None = None  # the share of this computer's datagrams that the other did not hear, 0 to 1
    own_source_address: str | None = None
    unicast: bool | None = None


@dataclass(frozen=True)
class Caller:
    """An address from which empty datagrams came to the computer itself."""

    address: str
    datagrams: int = 0


@dataclass(frozen=True)
class Stranger:
    """An address outside the fleet from which datagrams came on the group."""

    address: str
    interface: str
    datagrams: int = 0


@dataclass(frozen=True)
class IcmpRound:
    """One ping of a multicast group: the names of the computers that answered."""

    round: int
    answered: tuple[str, ...] = ()


@dataclass(frozen=True)
class Icmp:
    """The pings of a multicast group."""

    group: str
    error: str | None = None
    rounds: tuple[IcmpRound, ...] = ()


@dataclass(frozen=True)
class SendErrors:
    """The datagrams that the kernel refused to send."""

    count: int = 0
    last: str | None = None


@dataclass(frozen=True)
class Membership:
    """A multicast group that programs of the computer have joined on an interface; the measurement does not count."""

    interface: str
    group: str
    users: int = 1


@dataclass(frozen=True)
class Multicast:
    """The result of multicast_verify with `action: collect`."""

    memberships: tuple[Membership, ...] = ()
    udp: tuple[Datagrams, ...] = ()
    unexpected: tuple[Stranger, ...] = ()
    callers: tuple[Caller, ...] = ()
    icmp: Icmp | None = None
    send_errors: SendErrors = SendErrors()


# firewall, in check mode


@dataclass(frozen=True)
class PacketFilter:
    """The packet filter of the computer, compared with its plan."""

    changed: bool = False  # it is not as planned
    failed: bool = False
    msg: str = ""


@dataclass(frozen=True)
class FilterRule:
    """A rule of the packet filter, as multimaster_info has read it; an empty field matches everything."""

    verdict: str
    protocol: str = ""
    ports: tuple[int, ...] = ()  # of the destination: the first and the last one
    sources: tuple[str, ...] = ()
    destinations: tuple[str, ...] = ()
    incoming: str = ""
    leaving: str = ""
    state: str = ""
    above: int = 0  # bytes
    chain: str = ""  # in which it stands


@dataclass(frozen=True)
class FilterChain:
    """A chain of the packet filter."""

    hook: str
    table: str = ""
    policy: str = ""
    rules: tuple[FilterRule, ...] = ()
    unread: int = 0  # rules that were not understood whole


@dataclass(frozen=True)
class FilterChains:
    """All chains of the packet filter that may drop something."""

    readable: bool = False
    chains: tuple[FilterChain, ...] = ()
    arp: tuple[str, ...] = ()  # tables that drop ARP, whoever asks or answers


# All


@dataclass(frozen=True)
class Observation:
    """The results of one computer of the run; None for a module without a result, and `problem` says why."""

    multicast: Multicast | None = None
    probe: Probe | None = None
    unreachable: bool = False
    problem: str = ""
    packet_filter: PacketFilter | None = None  # None where no packet filter is planned or left over
    found: MachineState | None = None  # None where preflight did not look
    services: tuple[str, ...] | None = None  # the planned services that can run there, by preflight
    streams: Streams | None = None  # None where no throughput was measured
    filters: FilterChains | None = None  # None where the machine was not looked at
    second_look: SecondLook | None = None  # None where nothing was followed
