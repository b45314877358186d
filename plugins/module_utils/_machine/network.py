# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The network of this machine: its interfaces, and the routes that the kernel would take."""

import json
import os
import re
import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.commands import run, text

_FLAGS = {"up": 0x1, "loopback": 0x8, "multicast": 0x1000}  # net_device(7), linux/if.h


def interfaces() -> typing.List[typing.Dict[str, typing.Any]]:
    """The network interfaces with their addresses. Raises OSError where the machine cannot be asked."""
    answer = run(["ip", "-json", "address"])
    if answer.status == 0:
        try:
            return from_json(answer.output.decode("utf-8"))
        except ValueError:
            pass  # iproute2 before 4.14 takes the option and prints text
    answer = run(["ip", "-oneline", "address"])
    if answer.status != 0:
        raise OSError("the interfaces' addresses cannot be read: %s" % (answer.error or "ip failed"))
    return from_text(answer.output.decode("utf-8", "replace"), links())


def from_json(output: str) -> typing.List[typing.Dict[str, typing.Any]]:
    """Interfaces out of the text of `ip -json address`. Raises ValueError for anything else."""
    data = json.loads(output)
    if not isinstance(data, list):
        raise ValueError("expected a list of interfaces")
    return [
        {
            "name": link["ifname"],
            "up": "UP" in link.get("flags", ()),
            "multicast": "MULTICAST" in link.get("flags", ()),
            "loopback": "LOOPBACK" in link.get("flags", ()),
            "mtu": link.get("mtu", 0),
            "addresses": [
                {"address": entry["local"], "prefix": entry["prefixlen"], "family": entry["family"]}
                for entry in link.get("addr_info", ())
                if "local" in entry
            ],
        }
        for link in data
        if "ifname" in link  # old versions leave empty objects
    ]


def links(folder: str = "/sys/class/net") -> typing.List[typing.Dict[str, typing.Any]]:
    """Interfaces without their addresses, as the kernel shows them in files."""
    found = []
    for name in sorted(os.listdir(folder)):
        flags = text(os.path.join(folder, name, "flags")).strip()
        if not flags:
            continue  # a file such as bonding_masters
        link = {"name": name, "mtu": int(text(os.path.join(folder, name, "mtu")).strip() or 0), "addresses": []}
        link.update((key, bool(int(flags, 16) & bit)) for key, bit in _FLAGS.items())
        found.append(link)
    return found


def from_text(
    output: str, found: typing.List[typing.Dict[str, typing.Any]]
) -> typing.List[typing.Dict[str, typing.Any]]:
    """Interfaces with the addresses out of the text of `ip -oneline address`."""
    by_name = {link["name"]: link for link in found}
    lines = re.findall(r"^\d+:\s+(\S+)\s+(inet6?)\s+([^\s/]+)(?: peer [^\s/]+)?(?:/(\d+))?", output, re.MULTILINE)
    for name, family, address, prefix in lines:
        if name in by_name:
            length = int(prefix) if prefix else {"inet": 32, "inet6": 128}[family]
            by_name[name]["addresses"].append({"address": address, "prefix": length, "family": family})
    return found


def ways(destinations: typing.List[str]) -> typing.List[typing.Dict[str, typing.Any]]:
    """The routes that the kernel would take to IPv4 addresses (ip-route(8), get)."""
    found = []
    for destination in destinations:
        answer = run(["ip", "-json", "-4", "route", "get", destination])
        way = {"destination": destination, "gateway": None, "device": None, "source": None, "error": ""}
        if answer.status == 0:
            route = json.loads(answer.output.decode("utf-8"))[0]
            way.update(gateway=route.get("gateway"), device=route.get("dev"), source=route.get("prefsrc"))
        else:
            way["error"] = answer.error.replace("RTNETLINK answers: ", "") or "no route"
        found.append(way)
    return found
