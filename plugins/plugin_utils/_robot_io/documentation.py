# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The answer that a module documents, as types: by the contract of the modules that measure, and by RETURN of all others.

Pure: the text of a module in.
"""

from __future__ import annotations

import enum
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import yaml

from ...module_utils._contract.answers import ANSWERS
from ...module_utils._contract.fields import Struct, is_generic, is_list, is_struct, list_arguments, strip_optional
from .._base.features import FEATURES

SECTION = re.compile(r'^RETURN = r"""\n(.*?)^"""', re.MULTILINE | re.DOTALL)


@dataclass(frozen=True)
class ValueType:
    """The type of a value, in the words of Ansible's documentation."""

    type: str  # str, int, float, bool, list, dict or raw
    parts: Mapping[str, ValueType] | None = None  # of a mapping, or of each mapping of a list; None: any keys
    each: ValueType | None = (
        None  # of each entry of a list, and of each value of a mapping with any keys; None: any value
    )
    returned: str = ""  # when, as the documentation says it; "always" and "success" are promises


TEXT, YES_NO = ValueType("str"), ValueType("bool")
DIFFERENCE = ValueType("dict", dict.fromkeys(("before", "after", "before_header", "after_header", "prepared"), TEXT))
DIFFERENCES = ValueType("list", each=DIFFERENCE)

#: the keys of Ansible's own part of a module
COMMON: Mapping[str, ValueType] = {**dict.fromkeys(("changed", "failed", "skipped"), YES_NO), "msg": TEXT}
#: module -> key of its answer that another module documents -> that module, and the key there (all of its keys if it is empty)
ELSEWHERE: Mapping[str, Mapping[str, tuple[str, str]]] = {
    "multimaster_verify": {"machine": ("multimaster_info", ""), "multicast": ("multicast_verify", "")},
    "multimaster_computer": {"shells": ("multimaster_info", "environment")},
}
#: the modules whose runs multimaster_computer answers in `concerns`
RUNS = (
    *("sysctl", "routes", "firewall", *(feature.guarded for feature in FEATURES if feature.guarded)),
    *("hosts_entries", "multimaster_packages", "managed_files", "managed_services"),
)

Answer = Mapping[str, ValueType]


def read_documentation(module: str, text_of: Callable[[str], str]) -> Answer:
    """Return the kinds of the keys that a module answers.

    `text_of(module)` returns its source. Raises KeyError if the module documents no answer.
    """
    own = _read_contract(module) if module in ANSWERS else _read_section(text_of(module))
    for key, (other, part) in ELSEWHERE.get(module, {}).items():
        answer = read_documentation(other, text_of)
        own[key] = answer[part] if part else ValueType("dict", answer)
    if module == "multimaster_computer":
        runs = {name: ValueType("dict", read_documentation(name, text_of)) for name in RUNS}
        own["concerns"] = ValueType("dict", {name: ValueType("list", each=run) for name, run in runs.items()})
    own.pop("diff", None)  # in any module as Ansible has it
    return {**COMMON, **own}


_SCALARS = {str: "str", int: "int", float: "float", bool: "bool", Any: "raw"}


def _read_contract(module: str) -> dict[str, ValueType]:
    return {name: kind for part in ANSWERS[module] for name, kind in _make_parts(part).items()}


def _make_parts(struct: type[Struct]) -> dict[str, ValueType]:
    return {name: replace(make_kind(entry.kind), returned=entry.returned) for name, entry in struct.FIELDS.items()}


def make_kind(hint: Any) -> ValueType:
    """Return the type of a field of the contract as the type of a value."""
    hint = strip_optional(hint)
    if is_struct(hint):
        return ValueType("dict", _make_parts(hint))
    if is_list(hint):
        return ValueType("list", each=make_kind(list_arguments(hint)[0]))
    if is_generic(hint):
        each = list_arguments(hint)[1]
        return ValueType("dict", each=None if each is Any else make_kind(each))
    return TEXT if isinstance(hint, type) and issubclass(hint, enum.Enum) else ValueType(_SCALARS[hint])


def _read_section(text: str) -> dict[str, ValueType]:
    section = SECTION.search(text)
    if section is None:
        raise KeyError("RETURN")
    return _kinds(yaml.load(section[1], _LOADER) or {})


_LOADER: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


def _kinds(entries: Mapping[str, Any]) -> dict[str, ValueType]:
    return {str(name): _kind(entry) for name, entry in entries.items()}


def _kind(entry: Mapping[str, Any]) -> ValueType:
    kind, contains, elements = str(entry.get("type", "raw")), entry.get("contains"), entry.get("elements")
    parts, returned = _kinds(contains) if contains else None, str(entry.get("returned", ""))
    if kind == "list":
        return ValueType(
            kind, None, ValueType("dict", parts) if parts is not None else ValueType(str(elements or "raw")), returned
        )
    return ValueType(kind, parts, ValueType(str(elements)) if elements else None, returned)
