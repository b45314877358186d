# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The parts of a verification: their keys in the result, the functions that look, and all of them at the same time, in lanes."""

import time
import typing
from itertools import chain

from .._base.deadlines import call_all, measure_pace
from .._base.module import validate_options
from .._base.plain_text import LINE, quote
from .._base.problem import Problem
from .._features.probes import PROBES
from .measure import (
    changes,
    claims,
    exchange,
    masters,
    network,
    parameters,
    resources,
    services,
    sources,
    topics,
    traffic,
)
from .options import Params
from .part import Part
from .people import node_processes, unregistered
from .ros_client import ros as ros_commands
from .ros_client.ros import Ros

# Seconds; more than any part takes by its own limits. A part that is later is named and left behind.
LONGEST = 900.0
UNSEEN = "not looked at"

Result = typing.Dict[str, typing.Any]


def present(params: Params) -> typing.Set[str]:
    """Name the computers that take part."""
    members = [member["name"] for member in params["members"]]
    return set(members if params["present"] is None else params["present"])


def list_members(params: Params) -> typing.List[Result]:
    """List the members to look at, this computer among them."""
    names = None if params["tried"] is None else {params["name"], *params["tried"]}
    return [member for member in params["members"] if names is None or member["name"] in names]


def list_talkers(params: Params) -> typing.List[str]:
    """Name the computers with talkers that are to be heard here, in the order of the members."""
    talkers = (present(params) if params["talkers"] is None else set(params["talkers"])) - {params["name"]}
    return [member["name"] for member in list_members(params) if member["name"] in talkers]


def look_members(params: Params) -> typing.List[Result]:
    return network.members(list_members(params), params["name"], not params["is_router"])


def look_claims(params: Params) -> typing.List[Result]:
    """Ask for the owners of the own addresses, and of the others' addresses on the same networks."""
    others = [member for member in list_members(params) if member["name"] != params["name"]]
    return claims.claims(
        address for member in others for address in (member["address"], member["discovery_address"]) if address
    )


def look_masters(params: Params, deadline: float) -> typing.List[Result]:
    """Look at the discovery nodes of all masters. Wait only for those of computers that take part."""
    awaited = present(params)
    return call_all(
        lambda master: masters.discovery(master, deadline if master["computer"] in awaited else 0.0),
        params["masters"],
        LONGEST,
        lambda master: None,
    )


def look_list_masters(params: Params, ros: Ros, deadline: float) -> Result:
    """Call list_masters until it has the masters of all computers that take part."""
    computers = present(params)
    names = {master["name"] for master in params["masters"] if master["computer"] in computers}
    return ros_commands.list_masters(ros, names, deadline)


def look_outsiders(params: Params) -> typing.List[Result]:
    """Ask the discovery node of this computer for the peers that it ignores."""
    own = [master["monitor_uri"] for master in params["masters"] if master["computer"] == params["name"]]
    return masters.outsiders(own[0]) if own else []


def look_relays(params: Params, ros: Ros) -> typing.List[Result]:
    """Ask the relays with which that of this robot has channels, and hear topics that come through both."""
    return masters.relays((params["parameters"] or {}).get("master_relay"), ros)


def look_sources(params: Params, ros: Ros, deadline: float) -> typing.List[Result]:
    robots = {member["name"]: member["robot"] for member in params["members"]}
    return sources.sources(ros, params["masters"], robots, params["name"], list_talkers(params), deadline)


def look_topics(params: Params, ros: Ros, deadline: float) -> typing.List[Result]:
    return topics.topics(ros, list_talkers(params), params["run"], params["name"], deadline)


# Imports take most of a module's start. A part that few computers or actions need is imported in the function that uses it.


def look_next_boot(services_here: typing.List[str], planned: typing.Optional[Params]) -> typing.List[Result]:
    from .facts import next_boot

    return [] if planned is None else next_boot.differences(services_here, planned)


def group(params: Params, action: str) -> typing.Optional[Result]:
    """Return the result of multicast_verify for this action, also an obstacle; None if nothing is measured on the group."""
    if params["multicast"] is None:
        return None
    from .multicast import multicast

    try:
        own = {name: value for name, value in params["multicast"].items() if name != "state"}  # the alias of action
        options = validate_options("multicast", dict(own, action=action), multicast.OPTIONS, multicast.REQUIRED_IF)
        return multicast.run_action(options, check_mode=False)
    except Problem as problem:
        return {"failed": True, "msg": str(problem)}


def look_traffic(params: Params, ros: Ros) -> Result:
    """Measure the traffic of the robot to others, only on the computer of its roscore."""
    return traffic.measure_traffic(ros, params["members"], params["name"]) if params["is_master"] else traffic.NOTHING


def environment(params: Params, ros: Ros) -> typing.Dict[str, str]:
    """The environment that services are to have: that of the file, and the values that the plan sets in any case."""
    return {**ros.variables, **{name: str(value) for name, value in params["variables"].items()}}


def look_services(params: Params, ros: Ros) -> typing.List[Result]:
    return services.services(params["services"], environment(params, ros))


def look_node_hosts(params: Params, ros: Ros) -> typing.List[Result]:
    """Look at the processes of people's nodes, and at the roscore that they are to use."""
    master = environment(params, ros).get("ROS_MASTER_URI", "")
    return node_processes.node_hosts(params["members"], params["name"], master)


def look_unregistered(params: Params, ros: Ros) -> Result:
    """Look for people's nodes that are registered at no roscore."""
    master = environment(params, ros).get("ROS_MASTER_URI", "")
    return unregistered.find_unregistered(ros, params["members"], params["name"], master)


_ALL = ("params", "ros", "deadline")
PARTS = (
    # first: it waits most
    Part("multicast", lambda params: group(params, "collect"), ("params",), runs_commands=True, shared=True),
    Part("traffic", look_traffic, ("params", "ros"), runs_commands=True, shared=True),
    Part("members", look_members, ("params",), on_router=True),
    Part("claims", look_claims, ("params",), on_router=True),
    Part("policy", network.policy, on_router=True),
    Part("name_sources", network.name_sources),
    Part("default_routes", network.default_routes, on_router=True),
    Part("forwarding", network.forwarding, on_router=True),
    Part("masters", look_masters, ("params", "deadline")),
    Part(
        "roscore",
        ros_commands.roscore,
        ("ros", "deadline"),
        unseen={"error": UNSEEN},
    ),
    Part(
        "list_masters",
        look_list_masters,
        _ALL,
        unseen={"error": UNSEEN},
        runs_commands=True,
    ),
    Part("topics", look_topics, _ALL, runs_commands=True),
    Part("outsiders", look_outsiders, ("params",), final=True),
    Part("sources", look_sources, _ALL, runs_commands=True, final=True),
    Part(
        "exchange",
        exchange.exchange,
        ("ros", "members", "name"),
        unseen={"error": UNSEEN},
        runs_commands=True,
        final=True,
    ),
    Part("parameters", parameters.parameters, ("ros", "parameters", "crossing"), final=True),
    Part("relays", look_relays, ("params", "ros"), final=True),
    *PROBES,
    Part("changes", changes.changes, on_router=True),
    Part("disks", resources.disks, ("services",), on_router=True),
    Part("file_limits", resources.file_limits),
    Part("full_processes", resources.full_processes, on_router=True),
    Part(
        "container_names",
        lambda members: resources.container_names(member["name"] for member in members),
        ("members",),
    ),
    Part("node_hosts", look_node_hosts, ("params", "ros")),
    Part("unregistered", look_unregistered, ("params", "ros")),
    Part("ros_missing", Ros.problem, ("ros",), unseen=UNSEEN),
    Part("next_boot", look_next_boot, ("services", "boot"), on_router=True),
    Part("services", look_services, ("params", "ros")),
)


def is_due(part: Part, params: Params, check_mode: bool) -> bool:
    """Return True if a part is looked at on this computer; with `check_mode` no command of ROS is run."""
    if params["is_router"] and not part.on_router:
        return False
    return not (check_mode and part.runs_commands) and (params["is_master"] or not part.final)


PartResult = typing.Tuple[Part, typing.Any, str]  # a part, its value, and the reason if the value is missing


def look(params: Params, check_mode: bool) -> Result:
    """Look at all due parts at the same time. A part that fails gives a sentence in `problems`."""
    busy = measure_pace()  # before the threads below, which would wait for each other
    start = time.monotonic()
    result: Result = {part.name: part.default for part in PARTS}
    result.update(problems=[], pace=busy)
    ros = Ros(params["environment_file"], params["environment"])
    given = dict(params, params=params, ros=ros, deadline=start + params["patience"])

    def attempt(part: Part) -> PartResult:
        try:
            return part, part.look(*[given[name] for name in part.arguments]), ""
        except Exception as problem:  # a strange machine may raise anything: the other parts still count
            return part, part.default, f"{part.name} could not be looked at: {quote(str(problem).rstrip('.'), LINE)}."

    def late(part: Part) -> PartResult:
        return part, part.default, f"{part.name} gave no result within {LONGEST:g} s."

    for part, value, problem in look_in_lanes(
        [part for part in PARTS if is_due(part, params, check_mode)], attempt, late
    ):
        result[part.name] = value
        result["problems"] += [problem] if problem else []
    result["seconds"] = round(time.monotonic() - start, 1)
    return result


def look_in_lanes(
    parts: typing.List[Part], attempt: typing.Callable[[Part], PartResult], late: typing.Callable[[Part], PartResult]
) -> typing.List[PartResult]:
    """Look at parts at the same time: the final parts after the others, and the shared parts during both."""

    def lane(members: typing.List[Part]) -> typing.List[PartResult]:
        stages = ([part for part in members if part.final == final] for final in (False, True))
        return [result for stage in stages for result in call_all(attempt, stage, LONGEST, late)]

    lanes = [[part for part in parts if part.shared == shared] for shared in (True, False)]
    return list(chain.from_iterable(call_all(lane, lanes, 2 * LONGEST, lambda members: list(map(late, members)))))
