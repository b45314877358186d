# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Conversion between dataclasses and plain data, as Ansible's variables and JSON have it.

The type of a field decides: a dataclass is a dictionary, a tuple is a list, an address or a network is its text, an enum is its
value.
If a field may be None, plain data has an empty text or an empty dictionary. `notation` names the exceptions.
"""

from __future__ import annotations

import dataclasses
import enum
import functools
from collections.abc import Callable, Mapping
from ipaddress import IPv4Address, IPv4Network
from typing import Any, NamedTuple, TypeVar, get_args, get_origin, get_type_hints

T = TypeVar("T")

_NOTATION = "spelling"
#: the types that plain data has too, with the types of Python that are taken for each
_SCALARS: Mapping[Any, tuple[str, tuple[type, ...]]] = {
    str: ("a text", (str,)),
    int: ("a whole number", (int,)),
    float: ("a number", (int, float)),
    bool: ("true or false", (bool,)),
}
#: the types that are a text in plain data
_TEXTS: Mapping[Any, str] = {IPv4Address: "an IPv4 address", IPv4Network: "an IPv4 network"}


class Mismatch(ValueError):
    """Plain data does not fit its type; the text has the place, the found value and the expected one."""


def notation(
    key: str = "",
    words: tuple[tuple[Any, str], ...] = (),
    left_out: bool = False,
    among: Callable[[], Mapping[str, type]] | None = None,
) -> dict[str, Any]:
    """Metadata for a field of a dataclass.

    `key` is its key in plain data if that is no Python name, such as `from`. `words` are values with a text of their
    own, such as (0.0.0.0/0, "default"). With `left_out` the key is missing while the field is None. A field that is a mapping
    has its keys among those of the other fields with `among`, which lists its possible keys, and the type of each.
    """
    return {_NOTATION: (key, words, left_out, among)}


class _Field(NamedTuple):
    """A field of a dataclass: its names in Python and in plain data, its type without None, and its notation."""

    name: str
    key: str
    kind: Any
    optional: bool
    required: bool
    words: tuple[tuple[Any, str], ...]
    left_out: bool
    among: Callable[[], Mapping[str, type]] | None

    @property
    def empty(self) -> Any:
        """Plain data for None. Each caller gets an empty dictionary of its own, since callers may change plain data."""
        return {} if dataclasses.is_dataclass(self.kind) else None if get_origin(self.kind) else ""


@functools.cache
def _fields(kind: Any) -> tuple[_Field, ...]:
    hints, fields = get_type_hints(kind), []
    for field in dataclasses.fields(kind):
        key, words, left_out, among = field.metadata.get(_NOTATION, ("", (), False, None))
        required = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        hint, parts = hints[field.name], get_args(hints[field.name])
        optional = type(None) in parts
        inner = parts[0] if optional else hint
        fields.append(_Field(field.name, key or field.name, inner, optional, required, words, left_out, among))
    return tuple(fields)


def to_plain(value: Any) -> Any:
    """Return a dataclass as a dictionary of plain data. The keys have the order of the fields."""
    if dataclasses.is_dataclass(value):
        kind: Any = type(value)
        data: dict[str, Any] = {}
        for field in _fields(kind):
            content = getattr(value, field.name)
            if field.among:
                data.update(to_plain(content))
            elif not (field.left_out and content is None):
                data[field.key] = _write_field(field, content)
        return data
    if isinstance(value, (list, tuple)):
        return [to_plain(each) for each in value]
    if isinstance(value, Mapping):
        return {key: to_plain(each) for key, each in value.items()}
    if isinstance(value, enum.Enum):
        return value.value
    return str(value) if type(value) in _TEXTS else value


def _write_field(field: _Field, content: Any) -> Any:
    if content is None:
        return field.empty
    return next((word for special, word in field.words if special == content), None) or to_plain(content)


def from_plain(kind: type[T], data: Any) -> T:
    """Return plain data as an object of the dataclass `kind`. Unknown keys are ignored. Raises Mismatch."""
    read: T = _read(kind, data, "")
    return read


def _read(kind: Any, data: Any, path: str) -> Any:
    """Return plain data as a value of this type. `path` is its place, for the text of an error."""
    if kind in _SCALARS:
        expected, taken = _SCALARS[kind]
        if not isinstance(data, taken) or (isinstance(data, bool) and kind is not bool):
            raise Mismatch(f"{path} is {data!r}; expected {expected}.")
        return data
    if dataclasses.is_dataclass(kind):
        return _read_record(kind, data, path)
    arguments = get_args(kind)
    if get_origin(kind) is tuple:
        if not isinstance(data, (list, tuple)):
            raise Mismatch(f"{path} is {data!r}; expected a list.")
        return tuple(_read(arguments[0], each, f"{path}[{number}]") for number, each in enumerate(data))
    if arguments:
        if not isinstance(data, Mapping):
            raise Mismatch(f"{path} is {data!r}; expected a mapping.")
        return {str(key): _read(arguments[1], each, f"{path}.{key}") for key, each in data.items()}
    try:
        return data if kind is Any else kind(str(data))
    except ValueError:
        raise Mismatch(f"{path} is {data!r}; expected {_TEXTS.get(kind) or f'a word of {kind.__name__}'}.") from None


def _read_among(kinds: Mapping[str, type], data: Mapping[str, Any], begin: str) -> dict[str, Any]:
    """Return the values of those keys that are there, among the other keys of a record."""
    given = {key: data[key] for key in kinds if data.get(key) not in (None, {}, "")}
    return {key: _read(kinds[key], content, begin + key) for key, content in given.items()}


def _read_record(kind: Any, data: Any, path: str) -> Any:
    if not isinstance(data, Mapping):
        raise Mismatch(f"{path or kind.__name__} is {data!r}; expected a mapping.")
    begin = f"{path}." if path else ""
    values: dict[str, Any] = {}
    for field in _fields(kind):
        if field.among:
            values[field.name] = _read_among(field.among(), data, begin)
        elif field.key in data:
            content = data[field.key]
            if field.optional and (content is None or content == field.empty):
                values[field.name] = None
                continue
            special = [value for value, word in field.words if word == content]
            values[field.name] = special[0] if special else _read(field.kind, content, begin + field.key)
        elif field.required:
            raise Mismatch(f"{begin}{field.key} is missing.")
    return kind(**values)
