# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks of the programs on a computer: their parameters, their time, their room to write, their limits, and names in containers."""

from __future__ import annotations

from ..._base.sentences import shorten_list
from ..context.case import Case, Participant
from ..context.needs import Parts, join_parts, make_parts
from ..observe.observations import ContainerNames, Disk, FileLimit, ParameterDifference, Probe
from .engine import FAILED, WARNING, Check, Judgement, judge_fault

# The parameters of the nodes

# (node, parameter) -> the part that it decides; any other parameter is of the node's configuration.
DECIDES = {
    ("master_discovery", "mcast_group"): ("discovery", "group"),
    ("master_discovery", "mcast_port"): ("discovery", "group"),
    ("master_discovery", "rpc_port"): ("discovery", "port"),
    ("master_discovery", "interface"): ("interface", "multicast"),
}
# node -> the kind of its parts, and the modes that its parameters decide
NODES = {"master_discovery": ("discovery", "group", "port", "configuration"), "master_sync": ("sync", "configuration")}


def _has_parameters(case: Case) -> bool:
    return case.observer.plan.is_master and bool(case.probe.parameters.nodes)


def _parameter_part(case: Case, entry: ParameterDifference) -> Parts:
    if entry.node not in NODES:
        return frozenset()  # a strange computer tells of a node that nobody asked for
    kind, mode = DECIDES.get((entry.node, entry.name), (NODES[entry.node][0], "configuration"))
    what = {"group": f"{entry.name} {entry.found}", "port": entry.expected, "multicast": ""}
    return make_parts(kind, case.observer.name, mode, what=what.get(mode, f"{entry.name} is {entry.found}"))


def _parameters_needs(case: Case) -> Parts:
    """A node that was compared has the parameters of the plan."""
    compared = [NODES[node] for node in case.probe.parameters.nodes if node in NODES]
    return join_parts(make_parts(kind, case.observer.name, *modes) for kind, *modes in compared)


@Check(
    title="nodes have the planned parameters",
    when=_has_parameters,
    of_site=True,
    needs=_parameters_needs,
)
def _judge_parameters(case: Case) -> Judgement:
    differing = case.probe.parameters.differing
    expected = "; ".join(f"{entry.name} {entry.expected}" for entry in differing) or "the parameters of the plan"
    found = "; ".join(f"{entry.name} of {entry.node} is {entry.found}" for entry in differing)
    return judge_fault(FAILED, expected, found, "the same", join_parts(_parameter_part(case, one) for one in differing))


# Simulated time

CLOCK = "/clock"


def _list_masters(case: Case) -> list[Participant]:
    """List the computers whose roscores were asked."""
    return [one for one in case.run.values() if one.plan.is_master and one.is_probed and not one.probe.roscore.error]


def _list_clocks(probe: Probe) -> list[str]:
    """List the nodes that publish /clock, as far as the roscore knows them, those of other robots too."""
    tables = (probe.exchange.topics, *(entry.topics for entry in probe.exchange.imports))
    return [node for table in tables for topic in table if topic.name == CLOCK for node in topic.publishers]


@Check(
    title="all robots have the same kind of time",
    when=lambda case: case.observer.plan.is_master and case.probe.parameters.simulated,
)
def _judge_simulated_time(case: Case) -> Judgement:
    name, clocks = case.observer.name, _list_clocks(case.probe)
    real = sorted(one.plan.robot for one in _list_masters(case) if not one.probe.parameters.simulated)
    parts: Parts = frozenset()
    found = []
    if real:
        found.append(f"/use_sim_time is true here, and not at the roscore of {shorten_list(real)}")
        source = f"; its /clock comes from {shorten_list(clocks)}" if clocks else ""
        parts |= make_parts("time", name, "simulated", what=f"{shorten_list(real)}{source}")
    if not clocks and not case.probe.exchange.error:
        found.append("/use_sim_time is true here, and no node publishes /clock")
        parts |= make_parts("time", name, "stopped")
    return judge_fault(WARNING, "/use_sim_time alike on all robots, and a /clock", "; ".join(found), "so", parts)


# Room

LEAST_BYTES, LEAST_FILES = 1 << 20, 16


def _is_full(disk: Disk) -> bool:
    few_bytes = disk.free_bytes is not None and disk.free_bytes < LEAST_BYTES
    return few_bytes or (disk.free_files is not None and disk.free_files < LEAST_FILES)


@Check(
    title="services have room to write",
    when=lambda case: bool(case.probe.disks),
    needs=lambda case: make_parts("computer", case.observer.name, "disk"),
)
def _judge_room(case: Case) -> Judgement:
    full = [disk for disk in case.probe.disks if _is_full(disk)]
    found = "; ".join(f"{disk.path}: {disk.free_bytes} bytes and {disk.free_files} files" for disk in full)
    parts = join_parts(make_parts("computer", case.observer.name, "disk", what=disk.path) for disk in full)
    return judge_fault(FAILED, "1 MiB and 16 files left where services write", found, "enough", parts)


# Limits


def _limit_part(case: Case, entry: FileLimit) -> Parts:
    """A unit has its limit in its file; another node has that of the shell or the container that started it."""
    if entry.unit:
        return make_parts("limit", case.observer.name, "unit", what=entry.unit)
    return make_parts("limit", case.observer.name, "shell", what=entry.node)


@Check(
    title="nodes have an ordinary limit of open files",
    when=lambda case: case.observer.is_probed and not case.observer.lacks_ros,
    needs=lambda case: make_parts("limit", case.observer.name, "unit", "shell"),
)
def _judge_file_limits(case: Case) -> Judgement:
    found = shorten_list(f"{entry.limit} for {entry.node}" for entry in case.probe.file_limits)
    parts = join_parts(_limit_part(case, entry) for entry in case.probe.file_limits)
    return judge_fault(WARNING, "1048576 open files at most", found, "no process of ROS with more", parts)


# Containers


def _describe_container(entry: ContainerNames) -> str:
    return f"{entry.unit or entry.node} lacks {shorten_list(entry.missing)}"


@Check(
    title="containers have the names of the fleet",
    # without names, addresses are told
    when=lambda case: case.observer.is_probed and "ROS_HOSTNAME" in case.observer.plan.environment,
    needs=lambda case: make_parts("container", case.observer.name, "names"),
)
def _judge_container_names(case: Case) -> Judgement | None:
    lacking = list(map(_describe_container, case.probe.container_names))
    parts = join_parts(make_parts("container", case.observer.name, "names", what=one) for one in lacking)
    return judge_fault(WARNING, "the names of the fleet in each container", "; ".join(lacking), "none lacks one", parts)
