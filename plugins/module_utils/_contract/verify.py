# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The answers of multimaster_verify."""

import typing

from .clock import ClockState
from .computer import (
    BootDeviation,
    ContainerNames,
    Disk,
    FileLimit,
    FullProcess,
    NodeHost,
    RecentChange,
    ServiceState,
    UnregisteredNodes,
)
from .fields import Struct, field
from .network import Claim, DefaultRoute, ForwardingSettings, PolicyRouting, SeenMaster, SeenMember
from .ros import (
    Exchange,
    GivenTopics,
    HeardTopic,
    IgnoredSender,
    MasterList,
    NodeParameters,
    NodeTraffic,
    RoscoreAnswer,
    SeenRelay,
    Stream,
    Talker,
)
from .tunnel import SeenTunnel


class Probe(Struct, returned="when O(action=collect)"):
    """The result of multimaster_verify with `action: collect`."""

    members: typing.Tuple[SeenMember, ...] = field(
        "The measurements from this computer to every computer of the fleet; of itself only the addresses of its name."
    )
    default_routes: typing.Tuple[DefaultRoute, ...] = field("The default routes of this computer.")
    claims: typing.Tuple[Claim, ...] = field(
        "The computers that answer for an address on the networks of this computer, asked by ARP without an address of its own, so that it changes "
        "nothing. The own addresses, for which no other computer is to answer, and those of O(members) and of gateways, for which one "
        "computer is. Empty if the kernel does not allow it, and without an interface of Ethernet."
    )
    policy: PolicyRouting = field(
        "The rules and tables that decide about packets besides the routes of the main table."
    )
    name_sources: typing.Tuple[str, ...] = field(
        "The sources for the address of a name, in this order, as the line C(hosts) of C(/etc/nsswitch.conf) says it. Empty if it "
        "says nothing.",
        ["files", "dns"],
        returned="when O(action=collect), but not for the router",
    )
    forwarding: ForwardingSettings = field(
        "The values that decide about packets from one network to another through this computer."
    )
    masters: typing.Tuple[SeenMaster, ...] = field("The discovery node of every master.")
    roscore: RoscoreAnswer = field("The roscore of this computer's robot.")
    list_masters: MasterList = field(
        "The answer of C(rosservice call /master_discovery/list_masters) on this computer."
    )
    topics: typing.Tuple[HeardTopic, ...] = field("The texts of the talkers of the other computers, as heard here.")
    outsiders: typing.Tuple[IgnoredSender, ...] = field(
        "The senders of heartbeats that the discovery node of this computer ignores, since they do not belong to the fleet. Empty if"
        " the nodes are not the collection's own."
    )
    sources: typing.Tuple[GivenTopics, ...] = field(
        "The topics in the states of discovery nodes. The own one is asked for all that the roscore has, another one for those of talkers that "
        "are to be heard here and that the own roscore has not. If O(is_master=false), it is empty."
    )
    exchange: Exchange = field(
        "The contents of the roscore of this computer, by the robot that it is of, read at the end of the run. If O(is_master=false), "
        "it is empty, and RV(exchange.error) says so."
    )
    traffic: NodeTraffic = field(
        "The traffic of the robot's nodes to nodes of other robots, on the computer of a roscore. Their counters (C(getBusStats)) were read "
        "twice."
    )
    relays: typing.Tuple[SeenRelay, ...] = field(
        "The relays of other robots with which the relay of this robot has a channel by O(parameters.master_relay): are they reached, and "
        "the ports of their data.",
        added="1.1.0",
    )
    parameters: NodeParameters = field("The parameters of the nodes on the roscore, compared with O(parameters).")
    clock: ClockState = field("The clock of this computer.")
    tunnel: SeenTunnel = field(
        "The tunnel of the collection on this computer, as WireGuard shows it. No private key is asked for.",
        added="1.1.0",
    )
    disks: typing.Tuple[Disk, ...] = field(
        "The room that is left for others than root on the disks of services, each file system once."
    )
    file_limits: typing.Tuple[FileLimit, ...] = field(
        "Processes of ROS that may open more than 1048576 files, once for each unit, 20 at most."
    )
    full_processes: typing.Tuple[FullProcess, ...] = field(
        "Processes that have as many files open as they may, or one fewer, 20 at most."
    )
    container_names: typing.Tuple[ContainerNames, ...] = field(
        "Containers with processes of ROS whose own C(/etc/hosts) lacks names of the fleet that this computer's has, 20 at most."
    )
    node_hosts: typing.Tuple[NodeHost, ...] = field(
        "Processes of ROS on this computer that announce another host than its planned name and addresses, use another roscore than "
        "planned, or are stopped, and those of which this cannot be read, 100 at most. A node announces the host of C(ROS_HOSTNAME) or "
        "C(ROS_IP), or else the name of the computer.",
        added="1.1.0",
    )
    unregistered: UnregisteredNodes = field(
        "The nodes on this computer that are registered nowhere at the roscore of its robot, as after it was started anew.",
        added="1.1.0",
    )
    changes: typing.Tuple[RecentChange, ...] = field(
        "When files were changed and services were started that may decide names and packet filters. A change of a kernel by hand has"
        " no time."
    )
    services: typing.Tuple[ServiceState, ...] = field(
        "The services of O(services).",
        [
            {
                "name": "discovery",
                "unit": "multimaster-discovery.service",
                "load_state": "loaded",
                "active_state": "active",
                "sub_state": "running",
                "restarts": 0,
                "stopped": False,
                "differing": [],
                "drop_ins": [],
                "since": "Sun 2026-11-22 09:12:44 UTC",
                "refused": [],
                "refusals": [],
                "age_s": 86400.5,
                "open_files": 18,
                "most_files": 1024,
                "result": "",
                "status": None,
            }
        ],
    )
    next_boot: typing.Tuple[BootDeviation, ...] = field(
        "Things that work now, or not, and will not be as O(boot) and O(services) say after the next boot."
    )
    pace: float = field(
        "How many times longer things take on this computer than if it were idle, 1 to 6; its limits of time were stretched by it at least.",
        1.0,
        default=1.0,
        added="1.1.0",
    )
    talker: typing.Optional[Talker] = field(
        "The talker of this computer.",
        {"running": True, "error": ""},
        returned="unless O(action=stop) or O(is_router=true)",
    )
    ros_missing: str = field("Why no node can run on this computer, or empty if ROS is set up.", "")
    problems: typing.Tuple[str, ...] = field(
        "One sentence for each part that could not be looked at; such a part has an empty value.", []
    )


class Streams(Struct, returned="when O(action=stream)"):
    """The result of multimaster_verify with `action: stream`."""

    streams: typing.Tuple[Stream, ...] = field("How fast a stream of this computer comes to each of O(talkers).")


class VerifyAnswer(Struct):
    """The further answers of each action of multimaster_verify."""

    multicast: typing.Dict[str, typing.Any] = field(
        "The result of M(rosfleet.multimaster.multicast_verify) with the same action; if that fails, V(failed) and the sentence in "
        "C(msg).",
        {
            "udp": [],
            "heard": [],
            "missing": [],
            "unexpected": [],
            "msg": "Every other computer (0) is heard on the group and hears this one.",
        },
        returned="when O(multicast), with O(action=start) or O(action=collect)",
        kept=False,
    )
    machine: typing.Dict[str, typing.Any] = field(
        "The result of M(rosfleet.multimaster.multimaster_info).",
        {"problems": [], "hostname": "kobuki1computer", "owned": ["routes", "sysctl"]},
        returned="when O(action=start) and O(look)",
        kept=False,
    )
    seconds: float = field("How long the looking took.", 2.3, returned="when O(action=collect)")
    msg: str = field("The result, in a sentence.", "Looked at 2 computers in 2.3 s.")
