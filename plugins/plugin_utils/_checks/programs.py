# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Checks of the programs on a computer: their parameters, their room to write, their limits, and names in containers."""

from __future__ import annotations

from .._case.case import Case
from .._case.needs import Parts, join_parts, make_parts
from .._fleet.sentences import shorten_list
from .._observed.observations import ContainerNames, Disk, FileLimit, ParameterDifference
from .engine import FAILED, OK, WARNING, Check, Judgement
from .manual_setup import guard

# The parameters of the nodes

# (node, parameter) -> the part that it decides; any other parameter is of the node's configuration.
DECIDES = {
    ("master_discovery", "mcast_group"): ("discovery", "group"),
    ("master_discovery", "mcast_port"): ("discovery", "group"),
    ("master_discovery", "rpc_port"): ("discovery", "port"),
    ("master_discovery", "interface"): ("interface", "multicast"),
}
KINDS = {"master_discovery": "discovery", "master_sync": "sync"}


def _has_parameters(case: Case) -> bool:
    return case.observer.plan.is_master and bool(case.probe.parameters.nodes)


def _parameters_evidence(case: Case) -> Parts:
    return join_parts(_parameter_part(case, entry) for entry in case.probe.parameters.differing)


def _parameter_part(case: Case, entry: ParameterDifference) -> Parts:
    kind, mode = DECIDES.get((entry.node, entry.name), (KINDS[entry.node], "configuration"))
    what = {"group": f"{entry.name} {entry.found}", "port": entry.expected, "multicast": ""}
    return make_parts(kind, case.observer.name, mode, what=what.get(mode, f"{entry.name} is {entry.found}"))


def _parameters_needs(case: Case) -> Parts:
    """A node that was compared has the parameters of the plan."""
    name, nodes = case.observer.name, case.probe.parameters.nodes
    parts = (
        make_parts("discovery", name, "group", "port", "configuration") if "master_discovery" in nodes else frozenset()
    )
    return parts | (make_parts("sync", name, "configuration") if "master_sync" in nodes else frozenset())


@guard(_has_parameters)
@Check(
    title="nodes have the planned parameters",
    about="roscore",
    expected="the parameters of discovery and sync on the roscore are those of the plan",
    report="3.3",
    needs=_parameters_needs,
    evidence=_parameters_evidence,
)
def _judge_parameters(case: Case) -> Judgement | None:
    if not _has_parameters(case):
        return None
    differing = case.probe.parameters.differing
    expected = "; ".join(f"{entry.name} {entry.expected}" for entry in differing)
    found = "; ".join(f"{entry.name} of {entry.node} is {entry.found}" for entry in differing)
    return Judgement(FAILED, expected, found) if differing else Judgement(OK, "the parameters of the plan", "the same")


# Room

LEAST_BYTES, LEAST_FILES = 1 << 20, 16


def _full(case: Case) -> list[Disk]:
    disks = case.probe.disks
    return [
        disk
        for disk in disks
        if (disk.free_bytes is not None and disk.free_bytes < LEAST_BYTES)
        or (disk.free_files is not None and disk.free_files < LEAST_FILES)
    ]


@Check(
    title="services have room to write",
    expected="where services write, 1 MiB and 16 files are left for others than root",
    needs=lambda case: make_parts("computer", case.observer.name, "disk"),
    evidence=lambda case: join_parts(
        make_parts("computer", case.observer.name, "disk", what=disk.path) for disk in _full(case)
    ),
)
def _judge_room(case: Case) -> Judgement | None:
    if not case.probe.disks:
        return None
    full = [f"{disk.path}: {disk.free_bytes} bytes and {disk.free_files} files" for disk in _full(case)]
    return Judgement(
        FAILED if full else OK, "1 MiB and 16 files left where services write", "; ".join(full) or "enough"
    )


# Limits


def _limit_part(case: Case, entry: FileLimit) -> Parts:
    """A unit has its limit in its file; another node has that of the shell or the container that started it."""
    if entry.unit:
        return make_parts("limit", case.observer.name, "unit", what=entry.unit)
    return make_parts("limit", case.observer.name, "shell", what=entry.node)


@Check(
    title="nodes have an ordinary limit of open files",
    expected="no process of ROS may open more than 1048576 files: libxmlrpcpp takes memory and time for each that may be (warning)",
    needs=lambda case: make_parts("limit", case.observer.name, "unit", "shell"),
    evidence=lambda case: join_parts(_limit_part(case, entry) for entry in case.probe.file_limits),
)
def _judge_file_limits(case: Case) -> Judgement | None:
    if not case.observer.is_probed or case.observer.lacks_ros:
        return None
    found = shorten_list(f"{entry.limit} for {entry.node}" for entry in case.probe.file_limits)
    return Judgement(WARNING if found else OK, "1048576 open files at most", found or "no process of ROS with more")


# Containers


def _describe_container(entry: ContainerNames) -> str:
    return f"{entry.unit or entry.node} lacks {shorten_list(entry.missing)}"


@Check(
    title="containers have the names of the fleet",
    expected="a container with ROS has the names of the fleet in its own /etc/hosts, which it got when it was started (warning)",
    needs=lambda case: make_parts("container", case.observer.name, "names"),
    evidence=lambda case: join_parts(
        make_parts("container", case.observer.name, "names", what=_describe_container(entry))
        for entry in case.probe.container_names
    ),
)
def _judge_container_names(case: Case) -> Judgement | None:
    if not case.observer.is_probed or "ROS_HOSTNAME" not in case.observer.plan.environment:
        return None  # without names, addresses are told
    found = "; ".join(map(_describe_container, case.probe.container_names))
    return Judgement(WARNING if found else OK, "the names of the fleet in each container", found or "none lacks one")
