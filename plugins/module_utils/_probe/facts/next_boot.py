# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The state of this computer after its next boot, as far as its files say it, compared with the plan. Only reads.

Small on purpose: every verification sends it to every computer. The modules that write these files have the whole rules.
"""

import os
import time
import typing

from ..._apply.hosts import cloud_init
from ..._apply.sysctl import boot
from ..._apply.transaction.record import RECORDS, Record
from ..._base import commands
from ..._machine import systemd

Row = typing.Dict[str, str]  # kind, name, expected, found, file, when
Options = typing.Mapping[str, typing.Any]

_DEFAULT = {"default": "0.0.0.0/0"}
_DISABLED = "/etc/cloud/cloud-init.disabled"  # cloud-init does nothing while it is there
# The part of the record of the routes that is read here.
_ROUTES = {"boot": {"places": {"*": {"backend": str, "texts": [str], "routes": [dict]}}}}
_PERMANENT = ("enabled", "static", "indirect", "alias", "generated")


def differences(services: typing.Sequence[str], planned: Options, root: str = "/") -> typing.List[Row]:
    """Compare the next boot with the plan: units of `services`, and its `settings`, `routes` and `hosts`. Raises Problem."""
    rows = (
        units([f"multimaster-{name}.service" for name in services])
        + settings(planned["settings"], root)
        + routes(planned["routes"], root)
        + (hosts(root) if planned["hosts"] else [])
    )
    return [
        dict(row, when=find_change(os.path.join(root, row["file"].partition(" line ")[0].lstrip("/")))) for row in rows
    ]


def find_change(path: str) -> str:
    """Return the time of the last change of a file; an empty text without the file."""
    try:
        when = os.stat(path) if os.path.isfile(path) else None
    except OSError:
        when = None
    return "" if when is None else time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime(when.st_mtime))


def _row(kind: str, name: str, expected: str, found: str, file: str = "") -> Row:
    return {"kind": kind, "name": name, "expected": expected, "found": found, "file": file}


def units(names: typing.Sequence[str]) -> typing.List[Row]:
    """The units that systemd knows and will not start."""
    rows = []
    states = systemd.show(names, ("Id", "LoadState", "UnitFileState", "FragmentPath")).units if names else []
    for unit in states:
        state, file = unit.get("UnitFileState", ""), unit.get("FragmentPath", "")
        if unit.get("LoadState") == "masked" or state.startswith("masked"):
            rows.append(_row("unit", unit["Id"], "enabled", "masked", file))
        elif state == "enabled-runtime" or (state in _PERMANENT and file.startswith("/run/")):
            rows.append(_row("unit", unit["Id"], "enabled", "enabled until the next boot only", file))
        elif state and state not in _PERMANENT:
            rows.append(_row("unit", unit["Id"], "enabled", state, file))
    return rows


def settings(planned: typing.Sequence[Options], root: str = "/") -> typing.List[Row]:
    """The kernel settings that another file decides, or no file. Raises Problem."""
    wanted = {boot.key_of(item["name"]): item for item in planned}
    rows = []
    for key, decides in boot.find_boot_assignments(boot.Tree(root), wanted).items():
        expected = boot.normal(str(wanted[key]["value"]))
        value = None if decides is None or decides.value is None else boot.read_value(decides.value, expected)
        if value == expected or value in wanted[key].get("enough", ()):
            continue
        where = "" if decides is None else decides.file + (f" line {decides.line}" if decides.line else "")
        source = f"{where} sets {value}" if value is not None else f"{where} keeps it from being set" if where else ""
        rows.append(_row("sysctl", boot.name_of(key), expected, source or "no file sets it", where))
    return rows


def routes(planned: typing.Sequence[Options], root: str = "/", records: str = RECORDS) -> typing.List[Row]:
    """The routes whose file is gone, or was changed. Places that are no files, as those of NetworkManager, are not read."""
    if not planned:
        return []
    remembered = Record("routes", os.path.join(root, records.lstrip("/")), _ROUTES).load()
    places = remembered.get("boot", {}).get("places", {})
    places_by_way = {
        (entry.get("destination"), entry.get("gateway")): name for name in places for entry in places[name]["routes"]
    }
    rows = []
    for route in planned:
        name = f"{route['destination']} by {route['gateway']}"
        place = places_by_way.get((_DEFAULT.get(route["destination"], route["destination"]), route["gateway"]))
        if place is None:
            rows.append(_row("route", name, "a file that makes it", "no record of one"))
        elif place.startswith("/"):
            path = os.path.join(root, place.lstrip("/"))
            if commands.text(path) not in places[place]["texts"]:
                change = "was changed" if os.path.lexists(path) else "is not there"
                rows.append(_row("route", name, f"{place} makes it", f"{place} {change}", place))
    return rows


def hosts(root: str = "/") -> typing.List[Row]:
    """The files that keep cloud-init from writing /etc/hosts, and are not as written."""
    if not os.path.isdir(root + cloud_init.INSTALLED) or os.path.lexists(root + _DISABLED):
        return []
    for path, content in sorted(cloud_init.FILES.items()):
        if commands.text(root + path) != content:
            change = "was changed" if os.path.lexists(root + path) else "is not there"
            expected = "cloud-init is kept from writing it"
            return [_row("names", "/etc/hosts", expected, f"{path} {change}", path)]
    return []
