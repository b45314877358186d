# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# Private to this collection: may change at any time.

"""The plan of a computer compared with the machine as `multimaster_info` found it, before anything changes.

Pure: plan and description in, sentences out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

# The units of the collection: what they hold is no stranger's.
OWN_UNITS = ("multimaster-roscore.service", "multimaster-discovery.service", "multimaster-sync.service")
# The bundled nodes need this Python (Noetic's).
NODES_PYTHON = (3, 8)


@dataclass(frozen=True)
class Comparison:
    """What stands against applying a plan to a machine, what only deserves a word, and where the address is."""

    problems: tuple[str, ...]
    warnings: tuple[str, ...]
    interface: str


def compare(plan: Mapping[str, Any], info: Mapping[str, Any]) -> Comparison:
    """Compare one computer's plan with its machine.

    `plan` is an entry of `computers` of `fleet_plan`, `info` the return of `multimaster_info`.
    """
    interface, problems = _interface(plan, info)
    problems += _systemd(plan, info)
    warnings = _own_name(plan, info) + _exports(plan, info) + _sshd(plan, info)
    if plan["is_master"]:
        problems += _ros(plan, info) + _port_holders(plan, info)
        warnings += _no_roscore(plan, info)
    else:
        warnings += _ros(plan, info)
    return Comparison(tuple(problems), tuple(warnings), interface)


def _interface(plan: Mapping[str, Any], info: Mapping[str, Any]) -> tuple[str, list[str]]:
    host, address = plan["computer"], plan["address"]
    found = []
    for interface in info["interfaces"]:
        addresses = [entry["address"] for entry in interface["addresses"]]
        if address in addresses:
            if not interface["up"]:
                return interface["name"], [
                    f"{host}: the interface {interface['name']} with multimaster_address {address} is down; expected it to be up: "
                    f"bring it up (ip link set {interface['name']} up) and find out why it was not."
                ]
            if plan["is_master"] and plan["discovery"]["send_mcast"] and not interface["multicast"]:
                return interface["name"], [
                    f"{host}: the interface {interface['name']} with multimaster_address {address} does not do multicast; expected "
                    f"the flag MULTICAST: set it (ip link set {interface['name']} multicast on), or set multimaster_transport to "
                    "unicast."
                ]
            return interface["name"], []
        if not interface["loopback"]:
            found += [f"{entry} on {interface['name']}" for entry in addresses if ":" not in entry]
    return "", [
        f"{host}: multimaster_address is {address}, but the machine has {', '.join(found) or 'no address'}; expected that address "
        "on one of its interfaces: correct the inventory, or give the machine the address."
    ]


def _systemd(plan: Mapping[str, Any], info: Mapping[str, Any]) -> list[str]:
    if info["systemd"]["running"]:
        return []
    return [
        f"{plan['computer']}: systemd does not run the machine; expected it, since the nodes are its services: "
        "use a system with systemd."
    ]


def _ros(plan: Mapping[str, Any], info: Mapping[str, Any]) -> list[str]:
    host, ros = plan["computer"], info["ros"]
    if ros["problem"]:
        return [f"{host}: {ros['problem']}"]
    chosen = ros["chosen"]
    if not chosen:
        return [
            f"{host}: multimaster_ros_setup is '{plan['ros_setup']}', but no ROS was found on the machine; expected ROS 1 below "
            "/opt/ros, as Debian's packages, or in a workspace: install it, or name its set-up file in multimaster_ros_setup."
        ]
    where = chosen["setup"] or "Debian's packages"
    if chosen["missing"]:
        return [
            f"{host}: the ROS of {where} lacks the Python modules {', '.join(chosen['missing'])}; expected them for the bundled "
            f"nodes: install them ({_packages(chosen)})."
        ]
    if plan["is_master"] and plan["roscore"] == "managed" and not chosen["commands"].get("roscore"):
        return [
            f"{host}: the ROS of {where} has no roscore; expected it, since multimaster_roscore is 'managed': install it, or set "
            "multimaster_roscore to 'existing' where something else starts a roscore."
        ]
    version = tuple(int(part) for part in chosen["python_version"].split(".")[:2])
    if version < NODES_PYTHON:
        return [
            f"{host}: the ROS of {where} has Python {chosen['python_version']}; expected 3.8 or later for the bundled nodes (Ubuntu 20.04, Debian 11 "
            "or later)."
        ]
    return []


def _packages(chosen: Mapping[str, Any]) -> str:
    names = [module.replace("_", "-") for module in chosen["missing"]]
    prefix = "python3-" if chosen["kind"] == "debian" else f"ros-{chosen['distro'] or '<distro>'}-"
    return "apt-get install " + " ".join(prefix + name for name in names)


def _port_holders(plan: Mapping[str, Any], info: Mapping[str, Any]) -> list[str]:
    problems = []
    for port in plan["ports"]:
        for holder in info["ports"]:
            if (holder["protocol"], holder["port"]) != (port["protocol"], port["port"]) or holder["unit"] in OWN_UNITS:
                continue
            use = "roscore" if port == {"protocol": "tcp", "port": plan["roscore_port"]} else "discovery"
            if use == "roscore" and plan["roscore"] == "existing":
                continue
            who = f"{holder['command'] or 'a process'} (pid {holder['pid']}, user {holder['user']}" + (
                f", {holder['unit']})" if holder["unit"] else ")"
            )
            what = {
                "roscore": "stop it, or set multimaster_roscore to 'existing' to use it",
                "discovery": "stop it: only one discovery node can answer for a master",
            }[use]
            problems.append(
                f"{plan['computer']}: {port['protocol'].upper()} port {port['port']} is held by {who}; expected it to be free for the "
                f"{use} of the collection: {what}."
            )
    return list(dict.fromkeys(problems))  # a process may hold a port on several addresses


def _no_roscore(plan: Mapping[str, Any], info: Mapping[str, Any]) -> list[str]:
    listening = {(holder["protocol"], holder["port"]) for holder in info["ports"]}
    if plan["roscore"] == "managed" or ("tcp", plan["roscore_port"]) in listening:
        return []
    return [
        f"{plan['computer']}: nothing listens on TCP port {plan['roscore_port']}; expected the roscore that something else starts, "
        "since multimaster_roscore is 'existing': start it now, for the discovery node waits for it."
    ]


def _own_name(plan: Mapping[str, Any], info: Mapping[str, Any]) -> list[str]:
    if info["hostname"].split(".")[0].lower() == plan["computer"].split(".")[0].lower():
        return []
    return [
        f"{plan['computer']}: the machine calls itself '{info['hostname']}'; expected its name in the inventory: nodes that are "
        "started without the environment of the collection advertise that other name; rename one of the two."
    ]


def _exports(plan: Mapping[str, Any], info: Mapping[str, Any]) -> list[str]:
    return [
        f"{plan['computer']}: {export['file']}, line {export['line']} sets {export['variable']} ({export['text']}); expected that "
        "only the collection sets it: shells that read this file differ from the services; remove the line."
        for export in info["exports"]
        if plan["environment"].get(export["variable"], None) != export["value"].rstrip("/")
    ]


def _sshd(plan: Mapping[str, Any], info: Mapping[str, Any]) -> list[str]:
    sshd = info["sshd"]
    if not sshd["installed"]:
        return []
    warnings = []
    if not sshd["includes_drop_ins"]:
        warnings.append(
            f"{plan['computer']}: sshd does not read /etc/ssh/sshd_config.d; expected it, so that commands by ssh have the ROS "
            "environment: add 'Include /etc/ssh/sshd_config.d/*.conf' at the top of /etc/ssh/sshd_config, or use login shells."
        )
    for other in sshd["other_setenv"]:
        if other["match"]:
            continue  # below a Match it adds to ours
        warnings.append(
            f"{plan['computer']}: {other['file']}, line {other['line']} has its own SetEnv ({other['text']}), and sshd takes only one; "
            "expected none: commands by ssh get no ROS environment from the collection; move it into the users' ~/.ssh/environment, "
            "or use login shells."
        )
    return warnings
