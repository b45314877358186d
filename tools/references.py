# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Write the tables of the references into their pages, out of the code's own tables.

Names, order, values, defaults, ports, paths and limits are the code's. Words for people that no program reads have their one place on
the page: such cells stay as they are there. With `--check` nothing is written.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import yaml
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.firewall.backends import nftables
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.hosts import cloud_init
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.hosts import run as hosts
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes.managers import (
    ifupdown,
    netplan,
    networkd,
)
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.sysctl import run as sysctl
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction import record, service_bundle
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.sentences import UnexpectedValue
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._features.clock import plan as clock
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._features.multicast_routing import files as smcroute
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._features.tunnel import files as tunnel
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory import (
    exports,
    flows,
    kinds,
    rows,
    variables,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import environment, units
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.table import CHECKS

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "roles/nodes/files/python")]

from rosfleet_multimaster.protocol import metrics, parameters  # noqa: E402
from rosfleet_multimaster.roscore.core.bounds import BOUNDS, MIB  # noqa: E402

from tools.marks import Table, write  # noqa: E402

#: the cells of a row; None: its words stand on the page, under the first cell
Row = Sequence[str | None]
MISSING = "?"  # the words of a new row, until somebody writes them
#: variables whose values have keys: how they are called, and the keys
KEYS: Mapping[str, tuple[str, Iterable[str]]] = {
    "multimaster_filters": ("lists of patterns by", kinds.FILTERS),
    "multimaster_exports": ("a list of entries with", (*exports.KINDS, "to", *exports.OF_RELAY)),
}
CELL = 25  # words that a reader takes in at a glance
SCOPES = {"fleet": variables.OF_FLEET, "robot": variables.OF_ROBOT, "computer": variables.OF_COMPUTER}


def lay_out(columns: str, rows: Iterable[Row], old: str) -> str:
    """Return a table. `columns` are their titles, with `|` between them; `old` is the table as the page has it."""
    titles, before = columns.split("|"), read_table(old)
    lines = [write_row(titles), f"|{'---|' * len(titles)}"]
    for row in rows:
        kept = before.get(str(row[0]), {})
        lines.append(
            write_row(
                kept.get(title, MISSING) if cell is None else cell for title, cell in zip(titles, row, strict=True)
            )
        )
    return "\n".join(lines) + "\n"


def write_row(cells: Iterable[str]) -> str:
    """Return a line of a table."""
    return f"|{'|'.join(f' {cell} ' if cell else ' ' for cell in cells)}|"


def read_table(text: str) -> Mapping[str, Mapping[str, str]]:
    """Return the rows of the former table: first cell -> column -> cell."""
    lines = [split_row(line) for line in text.splitlines() if line.startswith("|")]
    return {cells[0]: dict(zip(lines[0], cells, strict=True)) for cells in lines[2:]}


def split_row(line: str) -> list[str]:
    """Return the cells of a line."""
    return [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]


def quote(value: Any) -> str:
    """Return a value as code, as YAML has it; nothing for None."""
    text = str(value).lower() if isinstance(value, bool) else str(value)
    return "" if value is None else f"`{text}`" if text else '`""`'


def join(words: Iterable[str]) -> str:
    """Return words as code, with commas."""
    return ", ".join(f"`{word}`" for word in words)


# The variables of the fleet


def list_variables(_old: str) -> Iterator[Row]:
    """Yield the rows of the variables."""
    for entry in variables.VARIABLES:
        (scope,) = (word for word, entries in SCOPES.items() if entry in entries)
        default = "required" if entry.example else quote(entry.default)
        yield f"`{entry.name}`", scope, describe_value(entry), default, None, None


def describe_value(entry: rows.Variable) -> str:
    """Return the values that a variable accepts, in the words of the sentence about a wrong one, without its examples."""
    if entry.name in KEYS:
        return f"{KEYS[entry.name][0]} {join(KEYS[entry.name][1])}"
    try:
        entry.read(object())
    except UnexpectedValue as expected:
        words = str(expected)
        if words.startswith("one of "):
            return join(words.removeprefix("one of ").split(", "))
        return drop_examples(words)
    raise AssertionError(f"{entry.name} accepts anything")


def drop_examples(words: str) -> str:
    """Return a sentence without `such as ...`."""
    return re.sub(r",? (?:such )?as (?:in )?(?:\{.*?\}|\[.*?\]|[^ ,]+)", "", words)


# The nodes


def list_parameters(table: parameters.Table, old: str) -> Iterator[Row]:
    """Yield the rows of the parameters of a node. Those of one row on the page stay together if they are of one kind."""
    together = {name: names for names in map(find_names, read_table(old)) for name in names}
    done: set[str] = set()
    for name, entry in table.items():
        if name in done:
            continue
        names = [one for one in together.get(name, [name]) if table.get(one) == entry]
        done.update(names)
        default = quote(entry.default) if entry.default not in ("", None) else None  # worked out at the start: in words
        yield join(names), entry.kind, default, None


def list_kinds(_old: str) -> Iterator[Row]:
    """Yield the rows of the kinds of parameters."""
    yield from ((f"`{kind}`", drop_examples(expected)) for kind, (expected, _accepts) in parameters.KINDS.items())


def find_names(cell: str) -> list[str]:
    """Return the names in a cell."""
    return re.findall(r"`(\w+)`", cell)


def list_own(table: parameters.Table) -> parameters.Table:
    """Return the parameters of a node without those of all nodes."""
    return {name: entry for name, entry in table.items() if name not in parameters.COMMON}


def list_channel_keys(old: str) -> Iterator[Row]:
    """Yield the rows of the keys of a channel of the relay."""
    table = {name: parameters.Parameter(None, kind) for name, kind in parameters.CHANNEL.items()}
    yield from ((name, kind, meaning) for name, kind, _default, meaning in list_parameters(table, old))


def list_metrics(_old: str) -> Iterator[Row]:
    """Yield the rows of the metrics."""
    for name, family in metrics.FAMILIES.items():
        yield f"`{metrics.PREFIX}{name}`", family.kind, join(family.labels), family.help


def list_bounds(_old: str) -> Iterator[Row]:
    """Yield the rows of what a roscore takes; the shares of robots are on the page."""
    for name, (most, text) in BOUNDS.items():
        limit = f"{most // MIB} MiB" if most >= MIB and most % MIB == 0 else f"{most:,}"
        yield name, limit, text.partition(";")[0]


def list_checks(_old: str) -> Iterator[Row]:
    """Yield the rows of the checks."""
    yield from ((f"`{check.id}`", None, None, None) for check in CHECKS)


# The playbooks

#: playbook -> the roles whose options it takes
ROLES: Mapping[str, Sequence[str]] = {
    "site": ("hosts", "sysctl", "routes", "firewall", "tunnel", "services"),
    "verify": ("verify",),
}


def list_options(playbook: str, _old: str) -> Iterator[Row]:
    """Yield the rows of a playbook's options: those with a default that does not come from the plan."""
    shared: dict[tuple[str, str, str], list[str]] = {}
    for role in ROLES[playbook]:
        defaults = read_yaml(f"roles/{role}/defaults/main.yml")
        options = read_yaml(f"roles/{role}/meta/argument_specs.yml")["argument_specs"]["main"]["options"]
        for name, option in options.items():
            default = option.get("default", defaults.get(name))
            if re.search(r"{{ (?!inventory_dir|verify_)", str(default)) or "Deprecated" in str(option["description"]):
                continue
            value = join(option["choices"]) if "choices" in option else option["type"]
            text = describe_option(option["description"])
            shared.setdefault((value, show_default(default), text), []).append(name)
    for cells, names in shared.items():
        yield join(names), *cells


def show_default(default: Any) -> str:
    """Return a default; that of a template is the one that it ends with, or its text."""
    filled = re.search(r"\| default\((.*)\) }}", str(default))
    return quote(
        filled[1] if filled else re.sub(r"{{ (\w+) }}", r"<\1>", str(default)) if isinstance(default, str) else default
    )


def describe_option(description: str | Sequence[str]) -> str:
    """Return the first sentences about an option, as many as a cell takes, as Markdown without examples."""
    first = description if isinstance(description, str) else description[0]
    sentence, *others = re.split(r"(?<=\.) (?=[A-Z])", re.sub(r", for example V\([^)]*\)", "", first))
    for other in others:
        if len(f"{sentence} {other}".split()) > CELL:
            break
        sentence += f" {other}"
    return re.sub(r"\b[VOCMP]\((?:rosfleet\.multimaster\.)?([^)#]*)[^)]*\)", r"`\1`", sentence).replace("|", "\\|")


def list_extra(playbook: str, _old: str) -> Iterator[Row]:
    """Yield the rows of a playbook that has its options itself."""
    text = (ROOT / f"playbooks/{playbook}.yml").read_text(encoding="utf-8")
    for play in yaml.safe_load(text):
        for name, value in play.get("vars", {}).items():
            yield f"`{name}`", quote(", ".join(f"{each['protocol']}/{each['port']}" for each in value)), None
    for name, default in dict(re.findall(r"\b(\w+) \| default\(([^)]*)\)", text)).items():
        yield f"`{name}`", None if default in ("none", "{}") else quote(default.strip("'")), None


def read_yaml(path: str) -> Any:
    """Read a file of the tree."""
    return yaml.safe_load((ROOT / path).read_text(encoding="utf-8"))


# A robot: ports, units and files


def list_ports(_old: str) -> Iterator[Row]:
    """Yield the rows of the ports."""
    by_name = variables.BY_NAME
    roscore = by_name["multimaster_roscore_port"].default
    for name, protocol, port, variable in (
        ("roscore", "TCP", str(roscore), "multimaster_roscore_port"),
        ("discovery, its state", "TCP", f"{roscore + flows.RPC_PORT} (roscore + {flows.RPC_PORT})", "multimaster_rpc_port"),
        ("discovery, its datagrams", "UDP", str(by_name["multimaster_multicast_port"].default), "multimaster_multicast_port"),
        ("relay", "TCP", f"{roscore + flows.RELAY_PORT} (roscore + {flows.RELAY_PORT})", ""),
        ("tunnel", "UDP", str(by_name["multimaster_tunnel_port"].default), "multimaster_tunnel_port"),
        ("each node, and data of the relay", "TCP", "a free one from 1024 up", ""),
    ):  # fmt: skip
        yield name, protocol, port, join(filter(None, [variable])), None


LIMITS = ("CapabilityBoundingSet", "MemoryMax", "TasksMax")


def list_units(_old: str) -> Iterator[Row]:
    """Yield the rows of the units that run as long as the computer does."""
    programs = units.render_programs("bundled", units.SYSTEM_PYTHON, {}, 11311)
    made = units.render_services(
        ["roscore", *units.NODES, *(name for name in units.OTHERS if name != "roscore")],
        robot="robot", address="192.168.1.1", roscore_command="", roscore_port=11311, programs=programs,
        environment_digest="", files={}, metrics_folder="/var/lib/metrics",
    )  # fmt: skip
    made.append(smcroute.render_router("robot", "239.255.11.11", ["eth0", "eth1"], "/usr/sbin/smcrouted", ""))
    for unit in made:
        lines = dict(re.findall(r"^(\w+)=(.*)$", unit["content"], re.MULTILINE))
        user = "dynamic" if lines.get("DynamicUser") == "yes" else "root"
        capabilities, memory, tasks = (lines.get(name, "") for name in LIMITS)
        name = unit["name"].removeprefix("multimaster-").removesuffix(".service")
        limits = f"{memory}, {tasks}" if memory else ""
        yield f"`{name}`", user, join(capabilities.split()), None, limits, None


def list_files(_old: str) -> Iterator[Row]:
    """Yield the rows of the files and folders."""
    drop_in = read_yaml("roles/sysctl/defaults/main.yml")["sysctl_drop_in"]
    networks = f"{networkd.FOLDER}/<file>.d/{networkd.DROP_IN}"
    for content, paths in {
        "names and addresses of all computers, in marked lines": [hosts.SYSTEM],
        "kernel settings; those of kernel modules": [drop_in, sysctl.RULES],
        "routes at boot, by the program that manages the interface": [ifupdown.HOOK, networks, netplan.FILE],
        "environment of services, parameters of nodes": [f"{units.CONFIGURATION}/"],
        "environment of shells, desktops and ssh": [
            environment.PROFILE, environment.DESKTOP, environment.GENERATOR, environment.SSHD,
        ],
        "environment of a prefix of ROS": ["<prefix>/etc/catkin/profile.d/"],
        "nodes and messages": [f"{units.LIBRARY}/"],
        "units": [f"{service_bundle.USUAL_FOLDER}/multimaster-*.service"],
        "registrations of the bundled roscore": ["/var/lib/multimaster-roscore/"],
        "the clock, with `multimaster_clock`": [clock.CONFIGURATION, clock.DROP_IN],
        "the tunnel, with `multimaster_tunnel`": [tunnel.CONFIGURATION, tunnel.KEY],
        "multicast routing of a gateway": [smcroute.ROUTER_FILE],
        "the packet filter of nftables, with `multimaster_firewall`": [nftables.RULES_FILE, nftables.DROP_IN],
        "a computer with cloud-init, so that it leaves `/etc/hosts` alone": [cloud_init.CONFIGURATION],
        "the state from before": [f"{record.RECORDS}/"],
    }.items():  # fmt: skip
        yield content, join(paths)


def list_tables() -> Iterator[Table]:
    """List the tables of the references."""

    def table(page: str, name: str, source: str, columns: str, rows: Callable[[str], Iterator[Row]]) -> Table:
        return Table(f"docs/{page}.md", name, source, lambda old: lay_out(columns, rows(old), old))

    yield table(
        *("operate/variables", "variables", "plugins/plugin_utils/_inventory/variables.py"),
        *("variable|set for|value|default|meaning|example", list_variables),
    )
    page, source = "operate/node_parameters", "rosfleet_multimaster/protocol/parameters.py"
    of_nodes = {
        "all nodes": parameters.COMMON,
        "master_discovery": list_own(parameters.DISCOVERY),
        "master_sync": list_own(parameters.SYNC),
        "master_relay": list_own(parameters.RELAY),
    }
    for name, of_node in of_nodes.items():
        yield table(page, name, source, "name|kind|default|meaning", partial(list_parameters, of_node))
    yield table(page, "channels", source, "key of a channel|kind|meaning", list_channel_keys)
    yield table(page, "kinds", source, "kind|value", list_kinds)
    yield table(
        *("operate/metrics", "metrics", "rosfleet_multimaster/protocol/metrics.py"),
        *("metric|kind|labels|meaning", list_metrics),
    )
    yield table(
        *("understand/roscore", "bounds", "rosfleet_multimaster/roscore/core/bounds.py"),
        *("bound|at most|of what", list_bounds),
    )
    yield table(
        *("operate/checks", "checks", "plugins/plugin_utils/_verify/checks"),
        *("check|for|expected|report", list_checks),
    )
    page, columns = "start/playbooks", "option|value|default|meaning"
    for playbook in ROLES:
        yield table(page, playbook, "argument_specs of roles", columns, partial(list_options, playbook))
    for playbook, at in {"adopt": page, "report": page, "router_config": "start/router"}.items():
        source = f"playbooks/{playbook}.yml"
        yield table(at, playbook, source, "option|default|meaning", partial(list_extra, playbook))
    page = "operate/on_a_robot"
    yield table(
        page, "ports", "plugins/plugin_utils/_inventory", "port of|protocol|default|variable|used by", list_ports
    )
    columns = "unit `multimaster-...`|user|capabilities|other rights|memory, tasks|rating"
    yield table(page, "units", "plugins/plugin_utils/_plan/units.py", columns, list_units)
    yield table(page, "files", "plugins", "content|path", list_files)


if __name__ == "__main__":
    sys.exit(write(list_tables(), "references"))
