# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The look at a machine before it becomes a computer of the fleet: its parts, the options, and how each part is read."""

import re
import typing

from ..._apply.routes.kernel import MAIN, read_routes
from ..._apply.routes.tables import read_tables
from ..._apply.transaction import record
from ..._base import deadlines
from ..._base.plain_text import LINE, quote
from ..._features.facts import FACTS
from ..._machine import filters, fkie, network, ports, ros, shells, system
from ..measure.network import forwarding
from .part import FactPart

MOST_TABLES = 32  # other tables of routes that are read


def routing() -> typing.Dict[str, typing.Any]:
    """Read the main table, the rules that lead to other tables, and these tables."""
    rules = network.policy_rules()
    asked = sorted({match.group(1) for match in re.finditer(r"\blookup (\S+)", "\n".join(rules))} - {"main", "local"})
    numbers = read_tables() if asked else {}
    known = ((name, int(name) if name.isdigit() else numbers.get(name)) for name in asked[:MOST_TABLES])
    others = [{"table": name, "routes": table(number)} for name, number in known if number is not None]
    return {"routes": table(MAIN), "rules": rules, "tables": others}


def table(number: int) -> typing.List[typing.Dict[str, typing.Any]]:
    """List the routes of a table as plain data."""
    names = ("destination", "gateway", "device", "metric", "source", "type")
    held = [entry.route._asdict() for entry in read_routes(4, number)]
    return [{name: route[name] for name in names} for route in held]


def masters(wanted: typing.List[typing.Dict[str, typing.Any]]) -> typing.List[typing.Dict[str, typing.Any]]:
    """Describe the roscores; the client for them is imported only here, since the start of a module is its imports."""
    from ..ros_client import facts

    return facts.masters(wanted)


#: the keys of a part with several
KEYS = {"system": ("hostname", "python", "kernel", "os", "systemd"), "exports": ("exports", "silent_shells")}
PARTS = (
    FactPart("system", system.system, 10),
    FactPart("owned", record.records, 5),
    FactPart("interfaces", lambda: [interface.plain() for interface in network.interfaces()], 15),
    FactPart(
        "ways", lambda wanted: [network.route_to(place).plain() for place in wanted], 15, options=("destinations",)
    ),
    FactPart("routing", routing, 15),
    FactPart("forwarding", forwarding, 10),
    FactPart("filters", filters.filters, 15),
    FactPart("ros", ros.find, 180, options=("ros_setup", "nodes")),
    FactPart("packages", fkie.packages, 30, options=("packages",)),
    *FACTS,
    FactPart("folders", system.folders, 5, options=("folders",)),
    FactPart("ports", ports.holders, 15, options=("ports",)),
    FactPart("masters", masters, 60, options=("ports",)),
    FactPart("exports", shells.exports, 30),
    FactPart("sshd", shells.sshd, 10),
    FactPart("environment", shells.probe, 20),
)


def empty(name: str) -> typing.Dict[str, typing.Any]:
    """Return the keys of a part that cannot be looked at, with the values of the contract."""
    from ..._contract.machine import MachineFacts  # few runs need it

    values = MachineFacts().plain()
    return {key: values[key] for key in KEYS.get(name, (name,))}


def look(parameters: typing.Dict[str, typing.Any]) -> typing.Dict[str, typing.Any]:
    """Look at the wanted parts; one that cannot be looked at is a sentence in `problems` and an empty value.

    `parameters` are those of OPTIONS.
    """
    result: typing.Dict[str, typing.Any] = {"problems": []}
    for part in PARTS:
        if part.name not in parameters["parts"]:
            continue
        try:
            value = deadlines.call_within(part.limit, part.look, *[parameters[option] for option in part.options])
            found = value if part.name in KEYS else {part.name: value}
        except Exception as problem:  # whatever a strange machine makes of it: the other parts still count
            found = empty(part.name)
            result["problems"].append(
                f"The part {part.name} of the machine could not be read: {quote(str(problem).rstrip('.'), LINE)}."
            )
        result.update(found)
    return result


def wrong(parameters: typing.Dict[str, typing.Any]) -> str:
    """Name in one sentence the option that cannot be used; empty if all can."""
    ports_of_none = [str(entry["port"]) for entry in parameters["ports"] if not 1 <= entry["port"] <= 65535]
    return (
        f"The option ports has {', '.join(ports_of_none)}; expected numbers from 1 to 65535." if ports_of_none else ""
    )


NODE = {
    "package": {"type": "str", "required": True},
    "executable": {"type": "str", "required": True},
    "modules": {"type": "list", "elements": "str", "default": []},
    "programs": {"type": "list", "elements": "str", "default": []},
    "environment": {"type": "dict", "default": {}},
}
PORT = {
    "protocol": {"type": "str", "choices": ["tcp", "udp"], "required": True},
    "port": {"type": "int", "required": True},
}
# Those of roscore, of discovery and of synchronisation.
_USUAL_PORTS = [
    {"protocol": "tcp", "port": 11311},
    {"protocol": "udp", "port": 11511},
    {"protocol": "tcp", "port": 11611},
]
_NAMES = [part.name for part in PARTS]
OPTIONS: typing.Dict[str, typing.Any] = {
    "ros_setup": {"type": "str", "default": "auto"},
    "destinations": {"type": "list", "elements": "str", "default": []},
    "nodes": {"type": "list", "elements": "dict", "default": [], "options": NODE},
    "packages": {"type": "list", "elements": "str", "default": []},
    "folders": {"type": "list", "elements": "str", "default": []},
    "ports": {"type": "list", "elements": "dict", "default": _USUAL_PORTS, "options": PORT},
    "parts": {
        "type": "list",
        "elements": "str",
        "choices": _NAMES,
        "default": [name for name in _NAMES if name != "masters"],
    },
}
