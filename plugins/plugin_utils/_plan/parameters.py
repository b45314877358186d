# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The private parameters of the nodes master_discovery and master_sync, in the words of the provider.

First come the parameters of the bundled nodes. Upstream's (multimaster_fkie) are made of them, with the same meaning if
upstream has it. `list_limits` has a sentence for each thing that upstream lacks.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from .._base.sentences import shorten_list
from .._inventory.exports import DIAGNOSTICS, make_node_filters
from .._inventory.filters import HOSTS, NAMES, NO_NAME, SUCCESSOR, WHITE_LISTS
from .._inventory.flows import RELAY_PORT, VERIFICATION_TOPICS, Flow
from .._inventory.model import Fleet, Robot
from .model import Parameters

UPSTREAM = ("fkie_apt", "fkie_existing")

# Filters by their parameters, such as {"ignore_topics": ["/tf"]}.
Filters = dict[str, list[str]]
# The names that a robot serves to some addresses: `to`, `topics` and `services`.
ServedNames = Mapping[str, Sequence[str]]


def discovery(fleet: Fleet, robot: Robot) -> Parameters:
    """Return the parameters of a robot's master_discovery."""
    bundled = _make_discovery(fleet, robot)
    if robot.variables.provider in UPSTREAM:
        return _upstream_discovery(bundled)
    return {**bundled, **_share_parameters(fleet, robot, "discovery")}


def sync(fleet: Fleet, robot: Robot) -> Parameters:
    """Return the parameters of a robot's master_sync."""
    bundled = _make_sync(fleet, robot)
    _add_for_upstream(bundled, fleet, robot)
    if robot.variables.provider in UPSTREAM:
        return _upstream_sync(bundled)
    return {**bundled, **_share_parameters(fleet, robot, "sync")}


def relay(fleet: Fleet, robot: Robot) -> Parameters | None:
    """Return the parameters of a robot's master_relay, None if no channel leads from or to it."""
    robots = {other.name: other for other in fleet.robots}
    channels = [
        {
            "peer": other,
            "hosts": _addresses(robots[other]),
            "port": robots[other].variables.roscore_port + RELAY_PORT,
            "topics": list(channel.entry.given_topics),
            "services": list(channel.entry.services),
            "back": list(channel.back),
            "as": channel.entry.namespace,
            "base": channel.entry.base,
            "inner": channel.robot == robot.name,
            "rate": channel.entry.rate,
            "whole": list(channel.entry.whole),
            "newest": channel.entry.newest,
            **_make_frames(channel.entry.frames, robots[channel.robot]),
        }
        for channel in fleet.channels
        if robot.name in (channel.robot, channel.other)
        for other in (channel.other if channel.robot == robot.name else channel.robot,)
    ]
    if not channels:
        return None
    port = robot.variables.roscore_port + RELAY_PORT
    return {"robot": robot.name, "port": port, "channels": channels, **_share_parameters(fleet, robot, "relay")}


def _make_frames(frames: str, robot: Robot) -> dict[str, str]:
    """Return how the frames of the robot with the inner names are called by the other one."""
    world, root = (robot.variables.frames or ("", "")) if frames else ("", "")
    return {"frames": frames, "world": world, "root": root}


def add_members(parameters: Parameters, members: Sequence[Any]) -> Parameters:
    """Return the parameters of a node with the robots of the fleet. Upstream's nodes take no robots."""
    return {**parameters, "members": list(members)} if "strangers" in parameters else parameters


# The parameters of all bundled nodes


def writes_metrics(robot: Robot) -> bool:
    """Return True if the nodes of a robot write metrics."""
    return robot.variables.metrics == "textfile" and robot.variables.provider == "bundled"


def _share_parameters(fleet: Fleet, robot: Robot, service: str) -> dict[str, Any]:
    """Return who is no stranger, and the output for people if it is not the default. The file is in memory, in the folder of the service."""
    shared = fleet.variables
    parameters: dict[str, Any] = {"strangers": shared.strangers, "allow": [str(network) for network in shared.allow]}
    if shared.diagnostics == "none":
        parameters["diagnostics"] = False
    if writes_metrics(robot):
        parameters["metrics"] = f"/run/multimaster-{service}/metrics.prom"
    return parameters


# master_discovery, bundled


def _make_discovery(fleet: Fleet, robot: Robot) -> dict[str, Any]:
    """Return the parameters of the bundled master_discovery, with upstream's names if upstream has the same ones."""
    shared, exports = fleet.variables, robot.variables.exports
    multicast = shared.transport in ("both", "multicast")
    peers = [str(other.companion.discovery_address) for other in fleet.robots if other != robot]
    return {
        "name": robot.master_name,
        "mcast_group": str(shared.multicast_group),
        "mcast_port": shared.multicast_port,
        "interface": str(robot.companion.discovery_address),
        "rpc_port": robot.variables.rpc_port,
        "heartbeat_hz": shared.heartbeat_hz,
        "offline_after": shared.offline_after,
        "send_mcast": multicast,
        "listen_mcast": multicast,
        "robot_hosts": peers if shared.transport in ("both", "unicast") else [],
        "hide_subscribers": ["*"] if is_restricted(fleet, robot) else [],
        **({} if exports is None else {"exports": _list_served_names(fleet, robot)}),
    }


def _list_served_names(fleet: Fleet, robot: Robot) -> list[ServedNames]:
    """Return the names of each flow of a robot, with the addresses of the callers that get them. `*` is any caller."""
    addresses = {other.name: _addresses(other) for other in fleet.robots}
    return [
        {
            "to": [address for other in flow.to for address in addresses[other]] or ["*"],
            "topics": [*flow.topics, VERIFICATION_TOPICS],
            "services": [*flow.services],
        }
        for flow in fleet.flows
        if robot.name in flow.givers
    ]


def _addresses(robot: Robot) -> list[str]:
    """Return the addresses from which a robot's master_sync asks the others."""
    return list(dict.fromkeys(map(str, filter(None, (robot.companion.address, robot.companion.common_address)))))


# Filters that leave no publisher out.
FREE_FILTERS = ("ignore_services", "ignore_subscribers")


def is_restricted(fleet: Fleet, robot: Robot) -> bool:
    """Return True if this robot exchanges no subscribers. A roscore would send every publisher to those of other robots."""
    return fleet.has_exports or any(
        patterns for name, patterns in robot.variables.filters.items() if name not in FREE_FILTERS
    )


# master_sync, bundled


def _make_sync(fleet: Fleet, robot: Robot) -> dict[str, Any]:
    """Return the robot's filters, and a section with a white list for each robot that declares."""
    parameters: dict[str, Any] = {**_list_filters(robot)}
    if is_restricted(fleet, robot):
        parameters["ignore_subscribers"] = ["*"]
    if fleet.variables.diagnostics == "local":
        parameters.setdefault("ignore_topics", []).append(DIAGNOSTICS)
    received = _list_received(fleet, robot)
    crossing = list_crossing(fleet, robot)
    if crossing:
        parameters["sync_parameters"] = crossing
    _leave_to_relay(parameters, fleet, robot)
    for other in fleet.robots:
        if other.variables.exports is None or other == robot:
            continue
        section = parameters.get(other.master_name, {})
        if other.name in received:
            topics = dict.fromkeys(name for flow in received[other.name] for name in flow.topics)
            services = dict.fromkeys(name for flow in received[other.name] for name in flow.services)
            lists = {"sync_topics": [*topics, VERIFICATION_TOPICS], "sync_services": [*services]}
            parameters[other.master_name] = {**section, **lists}
            continue
        parameters.setdefault("ignore_hosts", []).append(other.master_name.replace(".", r"\."))
        if robot.variables.filters.get("sync_hosts"):  # it would take the host back
            parameters[other.master_name] = {**section, "ignore_nodes": ["*"]}
    return parameters


def _leave_to_relay(parameters: dict[str, Any], fleet: Fleet, robot: Robot) -> None:
    """Add the topics that the relay takes across to the ignored ones, of each robot that gives everything, and the relays if they are not known."""
    if fleet.channels and robot.variables.provider in UPSTREAM:
        parameters.setdefault("ignore_nodes", []).append("/master_relay")
    for channel in fleet.channels:
        if channel.robot == robot.name:
            (other,) = (other for other in fleet.robots if other.name == channel.other)
            section, entry = parameters.setdefault(other.master_name, {}), channel.entry
            for rule, names in (("ignore_topics", entry.topic_names), ("ignore_services", entry.services)):
                if names:
                    section.setdefault(rule, []).extend(map(entry.rename, names))


def list_crossing(fleet: Fleet, robot: Robot) -> list[dict[str, Any]]:
    """Return the parameters that a robot copies, with the master that each is of."""
    received = _list_received(fleet, robot)
    crossing: list[dict[str, Any]] = []
    for other in fleet.robots:
        names: dict[str, dict[str, None]] = {}  # by namespace
        for flow in received.get(other.name, ()) if other != robot else ():
            if flow.parameters:
                names.setdefault(flow.namespace, {}).update(dict.fromkeys(flow.parameters))
        for namespace, these in names.items():
            crossing.append({"from": other.master_name, "names": [*these], **({"as": namespace} if namespace else {})})
    return crossing


def _list_received(fleet: Fleet, robot: Robot) -> dict[str, list[Flow]]:
    """List the flows to a robot, by giver."""
    received: dict[str, list[Flow]] = {}
    for flow in fleet.flows:
        for giver in flow.givers if flow.reaches(robot.name) else ():
            received.setdefault(giver, []).append(flow)
    return received


def list_own_crossing(fleet: Fleet, robot: Robot) -> tuple[str, ...]:
    """Return the parameters that a robot gives to others, or gets of them."""
    found: list[str] = []
    for flow in fleet.flows:
        found += flow.parameters if robot.name in flow.givers else ()
        found += (flow.namespace + name for name in flow.parameters if flow.reaches(robot.name))
    return tuple(dict.fromkeys(found))


def _list_filters(robot: Robot) -> Filters:
    """Return the robot's filters. A white list also has the topics of the verification."""
    parameters = make_node_filters(robot.variables.filters)
    if any(parameters.get(name) for name in WHITE_LISTS):
        parameters.setdefault("sync_topics", []).append(VERIFICATION_TOPICS)
    return parameters


def _add_for_upstream(parameters: dict[str, Any], fleet: Fleet, robot: Robot) -> None:
    """Add the parameters that other robots with upstream's nodes make necessary, for any provider of this robot.

    Upstream calls the nodes on the further computers of its robot remote, so this robot asks for remote nodes. Upstream
    cannot hide its subscribers, so this robot ignores them if that robot is restricted.
    """
    for other in fleet.robots:
        if other == robot or other.variables.provider not in UPSTREAM:
            continue
        if len(other.computers) > 1:
            parameters["sync_remote_nodes"] = True
        if is_restricted(fleet, other) and parameters.get("ignore_subscribers") != ["*"]:
            section = parameters.get(other.master_name, {})
            parameters[other.master_name] = {**section, "ignore_subscribers": ["*"]}


# Upstream's words


# The filters of upstream's master_sync without those of hosts. The white lists are last.
UPSTREAM_FILTERS = (*(name for name in NAMES if name not in (*WHITE_LISTS, "do_not_sync")), *WHITE_LISTS)
# Upstream gives a silent robot up without a question. Ten datagrams in a row do not get lost.
BEATS = 10
# Upstream multiplies these seconds of silence by timeout_factor, at one heartbeat a second or more.
INTERVAL = 5.0
# Below this rate upstream counts requests instead: five of them and 60 s.
COUNTED_HZ, UNCOUNTED = 0.3, 65.0
# Parameters with the same name and meaning in upstream.
SAME = ("name", "mcast_port", "interface", "rpc_port", "heartbeat_hz", "send_mcast", "listen_mcast", "robot_hosts")


def _upstream_discovery(bundled: Parameters) -> dict[str, Any]:
    hz, silence = bundled["heartbeat_hz"], _offline_after(bundled)
    return {
        **{name: bundled[name] for name in SAME},
        "mcast_group": f"{bundled['mcast_group']}@{bundled['interface']}",
        "timeout_factor": round(silence / (INTERVAL if hz >= 1 else INTERVAL / hz), 3),
        "remove_after": int(silence + 0.999),
        **_hide_names(bundled.get("exports")),
    }


def _offline_after(bundled: Parameters) -> float:
    """Return the seconds of silence until upstream gives a robot up and withdraws its names."""
    hz, after = float(bundled["heartbeat_hz"]), float(bundled["offline_after"])
    return max(after, BEATS / hz if hz >= COUNTED_HZ else UNCOUNTED)


def _hide_names(exports: Sequence[ServedNames] | None) -> Filters:
    """Hide the names without a receiver. Upstream serves a name either to all robots or to no robot."""
    if exports is None:
        return {}
    return {
        f"hide_{kind}": [_invert_patterns(name for entry in exports for name in entry[kind])]
        for kind in ("topics", "services")
    }


def _invert_patterns(patterns: Iterable[str]) -> str:
    alternatives = "|".join(dict.fromkeys(patterns))
    return rf"(?!(?:{alternatives})\Z)*" if alternatives else "*"


def _upstream_sync(bundled: Mapping[str, Any]) -> dict[str, Any]:
    sections = {key: value for key, value in bundled.items() if isinstance(value, Mapping)}
    ours = (*sections, *UPSTREAM_FILTERS, *HOSTS, "sync_parameters")
    kept = {key: value for key, value in bundled.items() if key not in ours}
    common = _close_white_lists(bundled, {})
    # Upstream knows its own names, and not those of its successor: a stranger's start button would be registered.
    lists: dict[str, list[Any]] = {
        name: [*SUCCESSOR.get(name, ()), *_group_alternatives(items)] for name, items in common.items()
    }
    for master, section in sections.items():
        for name, items in _close_white_lists(section, common).items():
            if items:
                lists[name].append({master.lower(): _group_alternatives(items)})
    return {**kept, **_list_hosts(bundled), **{name: items for name, items in lists.items() if items}}


def _list_hosts(bundled: Mapping[str, Any]) -> Filters:
    """Return the filters of hosts. In upstream `sync_hosts` restricts nothing, unless `ignore_hosts` has all."""
    wanted, ignored = (_group_alternatives(bundled.get(name, ())) for name in ("sync_hosts", "ignore_hosts"))
    if wanted:
        return {"ignore_hosts": ["*"], "sync_hosts": wanted}
    return {"ignore_hosts": ignored} if ignored else {}


def _close_white_lists(rules: Mapping[str, Any], common: Mapping[str, list[str]]) -> Filters:
    """Return the filters with closed white lists: with a white list of any kind, an empty one of topics or services lets nothing pass."""
    closed = {name: list(rules.get(name, ())) for name in UPSTREAM_FILTERS}
    if any(closed[name] or common.get(name) for name in WHITE_LISTS):
        for name in ("sync_topics", "sync_services"):
            if not closed[name] and not common.get(name):
                closed[name] = [NO_NAME]
    return closed


def _group_alternatives(items: Iterable[str]) -> list[str]:
    """Put alternatives in a group. Upstream anchors the whole text, so `a|b` would match every name that starts with a."""
    return [f"(?:{item.strip()})" if "|" in item else item.strip() for item in items if item.strip()]


# Things that upstream lacks


def list_limits(fleet: Fleet, robot: Robot) -> Iterator[str]:
    """Yield a sentence for each thing that the provider of a robot cannot do. The bundled nodes can do everything."""
    host, provider = robot.companion.name, robot.variables.provider
    if provider not in UPSTREAM:
        return
    bundled = _make_discovery(fleet, robot)
    yield (
        f"{host}: multimaster_provider is '{provider}', whose nodes register whatever they find; expected names of nodes and "
        "services that are unique in the fleet, and one type for a topic, since a roscore ends its own node when another robot's has "
        "the same name: rename them or leave them out by multimaster_filters, or set multimaster_provider to 'bundled', which refuses "
        "such registrations."
    )
    if fleet.variables.strangers == "ignore":
        yield (
            f"{host}: multimaster_strangers is 'ignore', but multimaster_provider is '{provider}', which exchanges with whoever is "
            "heard; expected nodes that know the members of the fleet: keep strangers off the common network, or set "
            "multimaster_provider to 'bundled'; set multimaster_strangers to 'allow' if strangers are wanted."
        )
    if robot.variables.metrics == "textfile":
        yield (
            f"{host}: multimaster_metrics is 'textfile', but multimaster_provider is '{provider}', whose nodes measure nothing; expected "
            "the bundled nodes: set multimaster_metrics to 'none', or multimaster_provider to 'bundled'."
        )
    silence = _offline_after(bundled)
    if silence > bundled["offline_after"]:
        yield (
            f"{host}: multimaster_offline_after is {bundled['offline_after']:g} s, but multimaster_provider is '{provider}', which cannot ask a "
            f"silent robot; expected to wait {silence:g} s here, so that lost datagrams remove nobody: accept that, or set "
            "multimaster_provider to 'bundled'."
        )
    yield from _explain_crossing(host, provider, list_crossing(fleet, robot))
    if "exports" in bundled:
        yield _explain_exports(host, provider, bundled["exports"])
    if len(robot.computers) > 1:
        others = ", ".join(computer.name for computer in robot.computers if computer != robot.master)
        yield (
            f"{host}: multimaster_provider is '{provider}', which reports the nodes on {others} as remote ones; expected the parameter "
            "sync_remote_nodes on whoever takes them: the robots of the inventory have it, set it on any other, or set "
            "multimaster_provider to 'bundled'."
        )
    if robot.variables.roscore == "existing":
        yield (
            f"{host}: multimaster_roscore is 'existing', and multimaster_provider is '{provider}', whose nodes do not notice that a "
            "roscore was started again; expected it to run as long as they: after a restart of it, run 'systemctl restart "
            "multimaster-discovery multimaster-sync', or set multimaster_roscore to 'managed'."
        )


def _explain_crossing(host: str, provider: str, entries: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Yield a sentence if parameters of other robots are for this robot."""
    crossing = [entry.get("as", "") + name for entry in entries for name in entry["names"]]
    if crossing:
        yield (
            f"{host}: multimaster_exports of other robots has the parameters {shorten_list(crossing)} for this robot, but multimaster_provider is "
            f"'{provider}', which copies none; expected the bundled nodes: set them here by hand, or set multimaster_provider to 'bundled'."
        )


def _explain_exports(host: str, provider: str, exports: Sequence[ServedNames]) -> str:
    some = [entry for entry in exports if entry["to"] != ["*"]]
    topics = dict.fromkeys(name for entry in some for name in entry["topics"] if name != VERIFICATION_TOPICS)
    names = [*topics, *dict.fromkeys(name for entry in some for name in entry["services"])]
    served = f"serves {shorten_list(names)} to every robot alike, and " if names else ""
    return (
        f"{host}: multimaster_exports is declared, but multimaster_provider is '{provider}', which {served}hides topics for nobody only "
        "from robots that ask as master_sync does; expected a robot that knows the caller: rely on the filters of the other robots of "
        "the inventory, which leave out the topics that are not for them, or set multimaster_provider to 'bundled', which serves nothing else."
    )
