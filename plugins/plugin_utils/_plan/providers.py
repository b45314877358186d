# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Whose discovery and sync nodes run: the bundled ones, or multimaster_fkie, called upstream here.

Pure. The plan's parameters are those of the bundled nodes; here they become upstream's, with the same meaning as far as
upstream has it, and one sentence for each thing that it has not. What differs between releases is rows of tables.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet.filters import (
    HOSTS,
    NAMES,
    NO_NAME,
    WHITE_LISTS,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet.flows import VERIFICATION_TOPICS
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet.read import Fleet, Robot

UPSTREAM = ("fkie_apt", "fkie_existing")


# Releases of upstream


@dataclass(frozen=True)
class Release:
    """The ROS packages of a release; their executables are called master_discovery and master_sync in all of them."""

    discovery: str
    sync: str
    messages: str
    hides: bool  # whether master_discovery has hide_nodes, hide_topics and hide_services


OLD = Release("master_discovery_fkie", "master_sync_fkie", "multimaster_msgs_fkie", hides=False)
NEW = Release("fkie_master_discovery", "fkie_master_sync", "fkie_multimaster_msgs", hides=True)  # since 1.0.0

# What a distribution's packages are; below is which. Debian's own ROS packages have no multimaster_fkie.
DISTRIBUTIONS = {
    "indigo": OLD,
    "jade": OLD,
    "kinetic": OLD,
    "lunar": OLD,
    "melodic": OLD,  # 0.8.12; newer ones need packages that Ubuntu 18.04 has not
    "noetic": NEW,
}


def debian_packages(distribution: str, is_master: bool) -> list[str]:
    """The Debian packages that a computer needs: the nodes without the GUI; elsewhere the messages, for rosservice."""
    release = DISTRIBUTIONS[distribution]
    names = (release.discovery, release.sync, release.messages) if is_master else (release.messages,)
    return [f"ros-{distribution}-{name.replace('_', '-')}" for name in names]


def looked_for(provider: str, is_master: bool) -> dict[str, Any]:
    """What multimaster_info is asked for beyond what every computer is: its options."""
    names = [name for distribution in DISTRIBUTIONS for name in debian_packages(distribution, is_master)]
    return {
        "packages": names if provider == "fkie_apt" else [],
        "nodes": [node for release in (NEW, OLD) for node in _nodes(release)] if provider == "fkie_existing" else [],
    }


def _nodes(release: Release) -> list[dict[str, Any]]:
    messages = [f"{release.messages}.msg", f"{release.messages}.srv"]
    return [
        {"package": package, "executable": executable, "modules": [f"{package}.{executable}", *messages]}
        for package, executable in ((release.discovery, "master_discovery"), (release.sync, "master_sync"))
    ]


# Parameters


# The filters of upstream's master_sync beside those of hosts.
FILTERS = tuple(name for name in NAMES if name != "do_not_sync")
# At one heartbeat a second, ten datagrams in a row do not get lost; upstream asks nobody before it gives a robot up.
BEATS = 10
# Upstream's: seconds of silence that timeout_factor multiplies, at one heartbeat a second or more.
INTERVAL = 5.0
# Below this rate upstream counts requests instead: 60 s and five of them.
COUNTED_HZ, UNCOUNTED = 0.3, 65.0


def discovery(provider: str, bundled: Mapping[str, Any]) -> dict[str, Any]:
    """The private parameters of master_discovery out of those of the bundled node."""
    if provider == "bundled":
        return dict(bundled)
    hz = bundled["heartbeat_hz"]
    silence = offline_after(bundled)
    same = ("name", "mcast_port", "interface", "rpc_port", "heartbeat_hz", "send_mcast", "listen_mcast", "robot_hosts")
    return {
        **{name: bundled[name] for name in same},
        "mcast_group": f"{bundled['mcast_group']}@{bundled['interface']}",
        "timeout_factor": round(silence / (INTERVAL if hz >= 1 else INTERVAL / hz), 3),
        "remove_after": int(silence + 0.999),
        **_hidden(bundled.get("exports")),
    }


def offline_after(bundled: Mapping[str, Any]) -> float:
    """After how many seconds of silence upstream gives a robot up and withdraws what it has of it."""
    hz = bundled["heartbeat_hz"]
    return max(bundled["offline_after"], BEATS / hz if hz >= COUNTED_HZ else UNCOUNTED)


def _hidden(exports: Sequence[Mapping[str, Any]] | None) -> dict[str, list[str]]:
    """What goes to nobody can be hidden from everybody; what goes to some, upstream serves to all of them."""
    if exports is None:
        return {}
    return {f"hide_{kind}": [_all_but(_of(exports, kind))] for kind in ("topics", "services")}


def _of(exports: Sequence[Mapping[str, Any]], kind: str) -> list[str]:
    return list(dict.fromkeys(pattern for entry in exports for pattern in entry[kind]))


def _all_but(patterns: Sequence[str]) -> str:
    return rf"(?!(?:{'|'.join(patterns)})\Z)*" if patterns else "*"


def sync(
    provider: str, fleet: Fleet, robot: Robot, bundled: Mapping[str, Any], restricted: Collection[str]
) -> dict[str, Any]:
    """The private parameters of master_sync out of those of the bundled node.

    A robot with upstream tells of the nodes of its further computers as remote ones, and cannot hide its subscribers.
    So the others ask for the former, and leave the latter out where that robot's master is among the `restricted`.
    """
    parameters = dict(bundled)
    for other in fleet.robots:
        if other == robot or other.provider not in UPSTREAM:
            continue
        if len(other.computers) > 1:
            parameters["sync_remote_nodes"] = True
        if other.master_name in restricted and parameters.get("ignore_subscribers") != ["*"]:
            section = parameters.get(other.master_name, {})
            parameters[other.master_name] = {**section, "ignore_subscribers": ["*"]}
    return parameters if provider == "bundled" else _sync(parameters)


def _sync(bundled: Mapping[str, Any]) -> dict[str, Any]:
    sections = {key: value for key, value in bundled.items() if isinstance(value, Mapping)}
    kept = {key: value for key, value in bundled.items() if key not in (*sections, *FILTERS, *HOSTS)}
    everybody = _closed({name: list(bundled.get(name, ())) for name in FILTERS}, {})
    lists: dict[str, list[Any]] = {name: _grouped(items) for name, items in everybody.items()}
    for master, section in sections.items():
        own = _closed({name: list(section.get(name, ())) for name in FILTERS}, everybody)
        for name, items in own.items():
            if items:
                lists[name].append({master.lower(): _grouped(items)})
    return {**kept, **_hosts(bundled), **{name: items for name, items in lists.items() if items}}


def _hosts(bundled: Mapping[str, Any]) -> dict[str, list[str]]:
    """Beside `ignore_hosts`, upstream's `sync_hosts` restricts nothing, unless all are ignored."""
    wanted, ignored = (_grouped(bundled.get(name, ())) for name in ("sync_hosts", "ignore_hosts"))
    if wanted:
        return {"ignore_hosts": ["*"], "sync_hosts": wanted}
    return {"ignore_hosts": ignored} if ignored else {}


def _closed(own: Mapping[str, list[str]], everybody: Mapping[str, list[str]]) -> dict[str, list[str]]:
    """With a white list of any kind, an empty one of topics or services is one in which nothing is."""
    closed = {name: list(items) for name, items in own.items()}
    if any(own[name] or everybody.get(name) for name in WHITE_LISTS):
        for name in ("sync_topics", "sync_services"):
            if not own[name] and not everybody.get(name):
                closed[name] = [NO_NAME]
    return closed


def _grouped(items: Iterable[str]) -> list[str]:
    """Upstream anchors the text as it is: `a|b` would be everything that starts with a."""
    return [f"(?:{item.strip()})" if "|" in item else item.strip() for item in items if item.strip()]


# What the configuration asks for, and upstream has not


def limits(robot: Robot, bundled: Mapping[str, Any]) -> list[str]:
    """One sentence each, for the master of a robot with upstream; `bundled` are the parameters of its discovery."""
    host, provider = robot.master.name, robot.provider
    said = [
        f"{host}: multimaster_provider is '{provider}', whose nodes register whatever they find; expected names of nodes and "
        "services that are unique in the fleet, and one type for a topic, since a roscore ends its own node when another robot's has "
        "the same name: rename them or leave them out by multimaster_filters, or set multimaster_provider to 'bundled', which refuses "
        "such registrations."
    ]
    silence = offline_after(bundled)
    if silence > bundled["offline_after"]:
        said.append(
            f"{host}: multimaster_offline_after is {bundled['offline_after']:g} s, but multimaster_provider is '{provider}', which cannot ask a "
            f"silent robot; expected to wait {silence:g} s here, so that lost datagrams remove nobody: accept that, or set "
            "multimaster_provider to 'bundled'."
        )
    if "exports" in bundled:
        said.append(_exported(robot, bundled["exports"]))
    if len(robot.computers) > 1:
        others = ", ".join(computer.name for computer in robot.computers if computer != robot.master)
        said.append(
            f"{host}: multimaster_provider is '{provider}', which tells of the nodes on {others} as remote ones; expected the parameter "
            "sync_remote_nodes on whoever takes them: the robots of the inventory have it, set it on any other, or set "
            "multimaster_provider to 'bundled'."
        )
    if robot.roscore == "existing":
        said.append(
            f"{host}: multimaster_roscore is 'existing', and multimaster_provider is '{provider}', whose nodes do not notice that a "
            "roscore was started again; expected it to run as long as they: after a restart of it, run 'systemctl restart "
            "multimaster-discovery multimaster-sync', or set multimaster_roscore to 'managed'."
        )
    return said


def _exported(robot: Robot, exports: Sequence[Mapping[str, Any]]) -> str:
    some = [entry for entry in exports if entry["to"] != ["*"]]
    names = [name for kind in ("topics", "services") for name in _of(some, kind) if name != VERIFICATION_TOPICS]
    shown = ", ".join(names[:3]) + (f" and {len(names) - 3} more" if len(names) > 3 else "")
    served = f"serves {shown} to every robot alike, and " if names else ""
    return (
        f"{robot.master.name}: multimaster_exports is declared, but multimaster_provider is '{robot.provider}', which {served}hides what goes to nobody only "
        "from robots that ask as master_sync does; expected a robot that knows who asks: rely on the filters of the other robots of "
        "the inventory, which leave out what is not for them, or set multimaster_provider to 'bundled', which serves nothing else."
    )


# What is on a machine


@dataclass(frozen=True)
class Found:
    """Upstream on a machine: the paths of its executables, the packages to install, and what stands against using it."""

    paths: Mapping[str, str]
    packages: Sequence[str] = ()
    problems: Sequence[str] = ()
    release: Release = NEW

    def limits(self, plan: Mapping[str, Any]) -> list[str]:
        """What of the parameters this release does not know."""
        if self.release.hides or not any(name.startswith("hide_") for name in plan["discovery"]):
            return []
        return [
            f"{plan['computer']}: multimaster_exports is declared, but the multimaster_fkie of this robot is one from before 1.0, which cannot "
            "hide anything; expected hide_topics and hide_services: rely on the filters of the other robots of the inventory, or set "
            "multimaster_provider to 'bundled'."
        ]


def find(plan: Mapping[str, Any], chosen: Mapping[str, Any], info: Mapping[str, Any]) -> Found:
    """Where the provider's executables are on the machine; `chosen` is its ROS as multimaster_info found it."""
    if plan["provider"] == "fkie_apt":
        return _packaged(plan, chosen, info)
    return _existing(plan, chosen) if plan["provider"] == "fkie_existing" else Found({})


def _packaged(plan: Mapping[str, Any], chosen: Mapping[str, Any], info: Mapping[str, Any]) -> Found:
    host, distribution = plan["computer"], chosen["distro"]
    if distribution not in DISTRIBUTIONS:
        ros = (
            "Debian's own packages"
            if chosen["kind"] == "debian"
            else f"{chosen['setup']} ({distribution or 'of no name'})"
        )
        return Found(
            {},
            problems=[
                f"{host}: multimaster_provider is 'fkie_apt', but the ROS is {ros}, for which there are no packages of multimaster_fkie; expected "
                f"one of {', '.join(DISTRIBUTIONS)}: set multimaster_provider to 'bundled', or to 'fkie_existing' with an installation of your own."
            ],
        )
    packages = debian_packages(distribution, plan["is_master"])
    known = {entry["name"]: entry for entry in info.get("packages", ())}
    missing = [
        name
        for name in packages
        if not known.get(name, {}).get("installed") and not known.get(name, {}).get("candidate")
    ]
    problems = [
        f"{host}: multimaster_provider is 'fkie_apt', but the package sources of the machine have no {', '.join(missing)}; expected them for the ROS "
        f"distribution {distribution}: add the source that its ROS came from and run apt-get update, or set multimaster_provider to 'bundled'."
    ]
    release = DISTRIBUTIONS[distribution]
    paths = {
        "discovery": f"/opt/ros/{distribution}/lib/{release.discovery}/master_discovery",
        "sync": f"/opt/ros/{distribution}/lib/{release.sync}/master_sync",
    }
    return Found(paths, packages, problems if missing else [], release)


def _existing(plan: Mapping[str, Any], chosen: Mapping[str, Any]) -> Found:
    if not plan["is_master"]:
        return Found({})
    known = {node["package"]: node for node in chosen["nodes"]}
    releases = [(known[release.discovery], known[release.sync]) for release in (NEW, OLD)]
    nodes = max(releases, key=lambda nodes: sum(bool(node["path"]) for node in nodes))  # the new one of equals
    where = chosen["setup"] or "Debian's packages"
    wrong = [
        f"{node['package']}/{node['executable']} "
        + (f"does not run ({node['problem']})" if node["path"] else "is not there")
        for node in nodes
        if node["problem"] or not node["path"]
    ]
    problem = (
        f"{plan['computer']}: multimaster_provider is 'fkie_existing', but in the ROS of {where} {' and '.join(wrong)}; expected both nodes of "
        "multimaster_fkie in lib/<package> of its CMAKE_PREFIX_PATH or in a package below its ROS_PACKAGE_PATH, importable for any user: name "
        "the set-up file of that installation in multimaster_ros_setup, or set multimaster_provider to 'bundled'."
    )
    paths = {"discovery": nodes[0]["path"], "sync": nodes[1]["path"]}
    return Found(paths, (), [problem] if wrong else [], OLD if nodes == releases[1] else NEW)
