# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Providers of the discovery and sync nodes: the bundled ones, or multimaster_fkie or its successor, called upstream here.

Upstream's packages and programs are in tables, by release. They are found on a machine here.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from .._base.plain_text import quote
from . import quotes
from .model import ComputerPlan, NodeProgram

# Releases of upstream

# The Python modules of both nodes in their packages, in each release; until fkie_mas their executables, too.
MODULES = ("master_discovery", "master_sync")


@dataclass(frozen=True)
class Release:
    """The ROS packages of a release, and the packages that it needs besides ROS."""

    discovery: str
    sync: str
    messages: str
    hides: bool  # master_discovery has hide_nodes, hide_topics and hide_services
    executables: tuple[str, str] = MODULES
    needs: tuple[str, ...] = ()  # Python modules that are looked for before its own, which end without them
    packages: str = ""  # the packages with these modules
    programs: tuple[str, ...] = ()
    environment: Mapping[str, str] = field(default_factory=dict)  # if the ROS does not set it


OLD = Release("master_discovery_fkie", "master_sync_fkie", "multimaster_msgs_fkie", hides=False)
NEW = Release("fkie_master_discovery", "fkie_master_sync", "fkie_multimaster_msgs", hides=True)  # since 1.0.0
# fkie_mas, whose version 5 runs on ROS 1 and 2: it asks the environment which one this is, and takes its ports from that.
SUCCESSOR = Release(
    "fkie_mas_discovery",
    "fkie_mas_sync",
    "fkie_mas_msgs",
    hides=True,
    executables=("mas-discovery", "mas-sync"),
    needs=("websockets.sync.server", "psutil", "netifaces"),
    packages="fkie_mas needs the Python packages websockets (12 or newer), psutil and netifaces for the Python of ROS",
    programs=("screen",),
    environment={"ROS_VERSION": "1", "ROS_DISTRO": "noetic"},
)
RELEASES = (NEW, OLD, SUCCESSOR)

# The release in the packages of each ROS distribution. Debian's own ROS packages have no multimaster_fkie.
# Melodic has 0.8.12; newer ones need packages that Ubuntu 18.04 lacks.
DISTRIBUTIONS = {**dict.fromkeys(("indigo", "jade", "kinetic", "lunar", "melodic"), OLD), "noetic": NEW}


def debian_packages(distribution: str, is_master: bool) -> list[str]:
    """Return the Debian packages of a computer: a master's nodes without the GUI, elsewhere the messages for rosservice."""
    release = DISTRIBUTIONS[distribution]
    names = (release.discovery, release.sync, release.messages) if is_master else (release.messages,)
    return [f"ros-{distribution}-{name.replace('_', '-')}" for name in names]


def packages_to_look_for(provider: str, is_master: bool) -> tuple[str, ...]:
    """Return the Debian packages for multimaster_info to look for."""
    if provider != "fkie_apt":
        return ()
    return tuple(name for distribution in DISTRIBUTIONS for name in debian_packages(distribution, is_master))


def nodes_to_look_for(provider: str) -> tuple[NodeProgram, ...]:
    """Return the nodes for multimaster_info to look for."""
    return tuple(node for release in RELEASES for node in _nodes(release)) if provider == "fkie_existing" else ()


def _nodes(release: Release) -> tuple[NodeProgram, ...]:
    messages = (f"{release.messages}.msg", f"{release.messages}.srv")
    parts = zip((release.discovery, release.sync), release.executables, MODULES, strict=True)
    return tuple(
        NodeProgram(
            package,
            executable,
            (*release.needs, f"{package}.{module}", *messages),
            release.programs,
            release.environment,
        )
        for package, executable, module in parts
    )


# On a machine


@dataclass(frozen=True)
class Installation:
    """Upstream on a machine: the paths of its executables, the packages to install, and the problems."""

    paths: Mapping[str, str] = field(default_factory=dict)
    packages: Sequence[str] = ()
    problems: Sequence[str] = ()
    release: Release = NEW
    lacks: Sequence[str] = ()  # programs that are not there

    def list_limits(self, plan: ComputerPlan) -> Iterator[str]:
        """Yield a sentence for each program that is missing, and one if this release does not know all parameters."""
        for program in self.lacks:
            yield (
                f"{plan.computer}: multimaster_provider is '{plan.provider}', but the fkie_mas of this robot finds no program {program}; "
                f"expected it for the nodes that its mas-daemon starts: install the Debian package {program}. Discovery and sync work "
                "without it."
            )
        if not self.release.hides and any(name.startswith("hide_") for name in plan.discovery):
            yield (
                f"{plan.computer}: multimaster_exports is declared, but the multimaster_fkie of this robot is one from before 1.0, which cannot "
                "hide anything; expected hide_topics and hide_services: rely on the filters of the other robots of the inventory, or set "
                "multimaster_provider to 'bundled'."
            )


def find_nodes(plan: ComputerPlan, chosen: Mapping[str, Any], info: Mapping[str, Any]) -> Installation:
    """Find the provider's executables on the machine. `chosen` is the ROS that multimaster_info chose there."""
    if plan.provider == "fkie_apt":
        return _find_packages(plan, chosen, info)
    return _find_existing(plan, chosen) if plan.provider == "fkie_existing" and plan.is_master else Installation()


def _find_packages(plan: ComputerPlan, chosen: Mapping[str, Any], info: Mapping[str, Any]) -> Installation:
    host, distribution = plan.computer, chosen["distro"]
    if distribution not in DISTRIBUTIONS:
        ros = f"{quote(chosen['setup'])} ({quote(distribution) or 'of no name'})"
        if chosen["kind"] == "debian":
            ros = "Debian's own packages"
        problem = (
            f"{host}: multimaster_provider is 'fkie_apt', but the ROS is {ros}, for which there are no packages of multimaster_fkie; expected "
            f"one of {', '.join(DISTRIBUTIONS)}: set multimaster_provider to 'bundled', or to 'fkie_existing' with an installation of your own."
        )
        return Installation(problems=[problem])
    packages = debian_packages(distribution, plan.is_master)
    available = {
        entry["name"] for entry in info.get("packages", ()) if entry.get("installed") or entry.get("candidate")
    }
    missing = [name for name in packages if name not in available]
    problem = (
        f"{host}: multimaster_provider is 'fkie_apt', but the package sources of the machine have no {', '.join(missing)}; expected them for the ROS "
        f"distribution {distribution}: add the source that its ROS came from and run apt-get update, or set multimaster_provider to 'bundled'."
    )
    release = DISTRIBUTIONS[distribution]
    folder = f"/opt/ros/{distribution}/lib"
    paths = {
        "discovery": f"{folder}/{release.discovery}/master_discovery",
        "sync": f"{folder}/{release.sync}/master_sync",
    }
    return Installation(paths, packages, [problem] if missing else [], release)


def _find_existing(plan: ComputerPlan, chosen: Mapping[str, Any]) -> Installation:
    release, nodes = _choose_release(chosen["nodes"])
    where = quote(chosen["setup"]) or "Debian's packages"
    wrong = [
        f"{node['package']}/{node['executable']} "
        + (f"does not run ({quote(node['problem'])})" if node["problem"] else "is not there")
        for node in nodes
        if not _runs(node)
    ]
    unmet = any(module.partition(".")[0] in node["problem"] for module in release.needs for node in nodes)
    problem = (
        f"{plan.computer}: multimaster_provider is 'fkie_existing', but in the ROS of {where} {' and '.join(wrong)}"
        f"{f' ({release.packages})' if unmet else ''}; expected both nodes of "
        "multimaster_fkie or of fkie_mas in lib/<package> of its CMAKE_PREFIX_PATH or in a package below its ROS_PACKAGE_PATH, importable for any user: name "
        "the set-up file of that installation in multimaster_ros_setup, or set multimaster_provider to 'bundled'."
    )
    paths = {"discovery": nodes[0]["path"], "sync": nodes[1]["path"]}
    problems = [problem] if wrong else list(check_paths(plan, paths.values()))
    lacks = tuple(dict.fromkeys(program for node in nodes for program in node.get("lacks", ())))
    return Installation(paths, (), problems, release, () if wrong else lacks)


def _choose_release(found: Sequence[Mapping[str, Any]]) -> tuple[Release, tuple[Mapping[str, Any], Mapping[str, Any]]]:
    """Choose the release of which most is there, the first one if they are equal: the release, and its two nodes."""
    by_package = {node["package"]: node for node in found}
    nodes = [(release, (by_package[release.discovery], by_package[release.sync])) for release in RELEASES]
    return max(nodes, key=lambda item: [sum(map(there, item[1])) for there in (_runs, _is_there)])


def _is_there(node: Mapping[str, Any]) -> bool:
    return bool(node["path"])


def _runs(node: Mapping[str, Any]) -> bool:
    return _is_there(node) and not node["problem"]


def check_paths(plan: ComputerPlan, paths: Iterable[str]) -> Iterator[str]:
    """Yield a sentence for each path that a unit cannot have."""
    for path in paths:
        try:
            quotes.check_program(path)
        except quotes.Unquotable as problem:
            yield f"{plan.computer}: {problem}"
