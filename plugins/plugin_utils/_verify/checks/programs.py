# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks of the programs on a computer: their parameters, their time, their room to write, their limits, and names in containers."""

from __future__ import annotations

import re

from ..._base.sentences import shorten_list
from ..context.check_context import CheckContext, Participant
from ..context.needs import Components, join_components, make_components
from ..observe.observations import ContainerNames, Disk, FileLimit, FullProcess, ParameterDifference, Probe
from .engine import FAILED, WARNING, Check, Judgement, judge_fault

# The parameters of the nodes

# (node, parameter) -> the component that it decides; any other parameter is of the node's configuration.
DECIDES = {
    ("master_discovery", "mcast_group"): ("discovery", "group"),
    ("master_discovery", "mcast_port"): ("discovery", "group"),
    ("master_discovery", "rpc_port"): ("discovery", "port"),
    ("master_discovery", "interface"): ("interface", "multicast"),
}
# node -> the kind of its components, and the modes that its parameters decide
NODES = {
    "master_discovery": ("discovery", "group", "port", "configuration"),
    "master_sync": ("sync", "configuration"),
    "master_relay": ("relay", "configuration"),
}


def _has_parameters(context: CheckContext) -> bool:
    return context.observer.plan.is_master and bool(context.probe.parameters.nodes)


def _parameter_component(context: CheckContext, entry: ParameterDifference) -> Components:
    if entry.node not in NODES:
        return frozenset()  # a strange computer reports a node that the probe did not ask for
    kind, mode = DECIDES.get((entry.node, entry.name), (NODES[entry.node][0], "configuration"))
    what = {"group": f"{entry.name} {entry.found}", "port": entry.expected, "multicast": ""}
    return make_components(kind, context.observer.name, mode, what=what.get(mode, f"{entry.name} is {entry.found}"))


def _parameters_needs(context: CheckContext) -> Components:
    """A node that was compared has the parameters of the plan."""
    compared = [NODES[node] for node in context.probe.parameters.nodes if node in NODES]
    return join_components(make_components(kind, context.observer.name, *modes) for kind, *modes in compared)


@Check(
    title="nodes have the planned parameters",
    when=_has_parameters,
    of_site=True,
    needs=_parameters_needs,
)
def _judge_parameters(context: CheckContext) -> Judgement:
    differing = context.probe.parameters.differing
    expected = "; ".join(f"{entry.name} {entry.expected}" for entry in differing) or "the parameters of the plan"
    found = "; ".join(f"{entry.name} of {entry.node} is {entry.found}" for entry in differing)
    return judge_fault(
        FAILED, expected, found, "the same", join_components(_parameter_component(context, one) for one in differing)
    )


# Simulated time

CLOCK = "/clock"


def _list_masters(context: CheckContext) -> list[Participant]:
    """List the computers whose roscores were asked."""
    return [one for one in context.run.values() if one.plan.is_master and one.is_probed and not one.probe.roscore.error]


def _list_clocks(probe: Probe) -> list[str]:
    """List the nodes that publish /clock, as far as the roscore knows them, those of other robots too."""
    tables = (probe.exchange.topics, *(entry.topics for entry in probe.exchange.imports))
    return [node for table in tables for topic in table if topic.name == CLOCK for node in topic.publishers]


@Check(
    title="all robots have the same kind of time",
    when=lambda context: context.observer.plan.is_master and context.probe.parameters.simulated,
)
def _judge_simulated_time(context: CheckContext) -> Judgement:
    name, clocks = context.observer.name, _list_clocks(context.probe)
    real = sorted(one.plan.robot for one in _list_masters(context) if not one.probe.parameters.simulated)
    components: Components = frozenset()
    found = []
    if real:
        found.append(f"/use_sim_time is true here, and not at the roscore of {shorten_list(real)}")
        source = f"; its /clock comes from {shorten_list(clocks)}" if clocks else ""
        components |= make_components("time", name, "simulated", what=f"{shorten_list(real)}{source}")
    if not clocks and not context.probe.exchange.error:
        found.append("/use_sim_time is true here, and no node publishes /clock")
        components |= make_components("time", name, "stopped")
    return judge_fault(WARNING, "/use_sim_time alike on all robots, and a /clock", "; ".join(found), "so", components)


# Room

LEAST_BYTES, LEAST_FILES = 1 << 20, 16


def _is_full(disk: Disk) -> bool:
    few_bytes = disk.free_bytes is not None and disk.free_bytes < LEAST_BYTES
    return few_bytes or (disk.free_files is not None and disk.free_files < LEAST_FILES)


@Check(
    title="services have room to write",
    when=lambda context: bool(context.probe.disks),
    needs=lambda context: make_components("computer", context.observer.name, "disk"),
)
def _judge_room(context: CheckContext) -> Judgement:
    full = [disk for disk in context.probe.disks if _is_full(disk)]
    found = "; ".join(f"{disk.path}: {disk.free_bytes} bytes and {disk.free_files} files" for disk in full)
    components = join_components(
        make_components("computer", context.observer.name, "disk", what=disk.path) for disk in full
    )
    return judge_fault(FAILED, "1 MiB and 16 files left on the disks of services", found, "enough", components)


# Limits


def _limit_component(context: CheckContext, entry: FileLimit) -> Components:
    """A unit has its limit in its file; another node has that of the shell or the container that started it."""
    if entry.unit:
        return make_components("limit", context.observer.name, "unit", what=entry.unit)
    return make_components("limit", context.observer.name, "shell", what=entry.node)


@Check(
    title="nodes have an ordinary limit of open files",
    when=lambda context: context.observer.is_probed and not context.observer.lacks_ros,
    needs=lambda context: make_components("limit", context.observer.name, "unit", "shell"),
)
def _judge_file_limits(context: CheckContext) -> Judgement:
    found = shorten_list(f"{entry.limit} for {entry.node}" for entry in context.probe.file_limits)
    components = join_components(_limit_component(context, entry) for entry in context.probe.file_limits)
    return judge_fault(WARNING, "1048576 open files at most", found, "no process of ROS with more", components)


OURS = re.compile(r"multimaster-[a-z-]+\.service\Z")  # the check `services` says it of these


def describe_full(entry: FullProcess) -> str:
    """Say which process has all of its files open."""
    return f"{entry.name} (PID {entry.pid}) has {entry.open_files} of {entry.most_files} files open"


def find_full(probe: Probe, node: str, computer: str) -> Components:
    """Find the process of a node among those that have all of their files open, by its name or that of its program; no other one counts."""
    own = node.rpartition("/")[2]
    names = {one: one.name.strip('"').removesuffix(".py") for one in probe.full_processes}
    # An anonymous node has numbers after its name.
    full = (one for one, name in names.items() if re.fullmatch(re.escape(name) + r"(_\d+)*", own))
    return join_components(make_components("program", computer, "full", what=describe_full(one)) for one in full)


@Check(
    title="programs may open further files",
    needs=lambda context: make_components("program", context.observer.name, "full"),
    when=lambda context: context.observer.is_probed,
)
def _judge_open_files(context: CheckContext) -> Judgement:
    full = [describe_full(entry) for entry in context.probe.full_processes if not OURS.match(entry.unit)]
    components = join_components(make_components("program", context.observer.name, "full", what=one) for one in full)
    return judge_fault(WARNING, "files left to open, for new connections", "; ".join(full), "enough", components)


# Containers


def _describe_container(entry: ContainerNames) -> str:
    return f"{entry.unit or entry.node} lacks {shorten_list(entry.missing)}"


@Check(
    title="containers have the names of the fleet",
    # without names, addresses are reported
    when=lambda context: context.observer.is_probed and "ROS_HOSTNAME" in context.observer.plan.environment,
    needs=lambda context: make_components("container", context.observer.name, "names"),
)
def _judge_container_names(context: CheckContext) -> Judgement | None:
    lacking = list(map(_describe_container, context.probe.container_names))
    components = join_components(
        make_components("container", context.observer.name, "names", what=one) for one in lacking
    )
    return judge_fault(
        WARNING, "the names of the fleet in each container", "; ".join(lacking), "none lacks one", components
    )
