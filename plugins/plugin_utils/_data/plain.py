# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Conversion between dataclasses and plain data, as Ansible's variables and JSON have it.

The type of a field decides: a dataclass is a dictionary, a tuple is a list, an address or a network is its text, an enum is its
value.
Where a field may be None, plain data has an empty text or an empty dictionary. `notation` names the exceptions.
"""

from __future__ import annotations

import copy
import dataclasses
import enum
import functools
import types
from collections.abc import Callable, Mapping, Sequence
from ipaddress import IPv4Address, IPv4Network
from typing import Any, NamedTuple, TypeVar, Union, get_args, get_origin, get_type_hints

T = TypeVar("T")

_NOTATION = "spelling"


class Mismatch(ValueError):
    """Plain data does not fit its type; the text says where, what was found and what was expected."""


def notation(key: str = "", words: tuple[tuple[Any, str], ...] = (), left_out: bool = False) -> dict[str, Any]:
    """Metadata for a field of a dataclass.

    `key` is its key in plain data where that is no Python name, such as `from`. `words` are values with a text of their
    own, such as (0.0.0.0/0, "default"). With `left_out` the key is missing while the field is None.
    """
    return {_NOTATION: (key, words, left_out)}


def to_plain(value: Any) -> Any:
    """Return a dataclass as a dictionary of plain data. The keys have the order of the fields."""
    return _converter(type(value)).write(value)


def from_plain(kind: type[T], data: Any) -> T:
    """Return plain data as an object of the dataclass `kind`. Unknown keys are ignored. Raises Mismatch."""
    read: T = _converter(kind).read(data, "")
    return read


class Converter(NamedTuple):
    """The two directions for one type; `read` also takes the path of the data, for the text of an error."""

    write: Callable[[Any], Any]
    read: Callable[[Any, str], Any]
    nothing: Any = ""  # plain data for None


def _make_converter(kind: Any) -> Converter:
    origin, arguments = get_origin(kind), get_args(kind)
    if dataclasses.is_dataclass(kind):
        return _record(kind)
    if origin in (types.UnionType, Union):
        return _optional(_converter(next(argument for argument in arguments if argument is not type(None))))
    if origin is tuple:
        return _list(_converter(arguments[0]))
    if isinstance(kind, type) and issubclass(kind, enum.Enum):
        return Converter(lambda value: value.value, _convert_text(kind, f"a word of {kind.__name__}").read)
    if origin is not None:
        return _dictionary(_converter(arguments[1]))
    return _SCALARS[kind]


_converter: Callable[[Any], Converter] = functools.cache(_make_converter)  # made once for each type


def _pass_on(value: Any) -> Any:
    return value


def _check_type(kind: type | tuple[type, ...], expected: str) -> Converter:
    def read(data: Any, path: str) -> Any:
        if not isinstance(data, kind) or (isinstance(data, bool) and kind is not bool):
            raise Mismatch(f"{path} is {data!r}; expected {expected}.")
        return data

    return Converter(_pass_on, read)


def _convert_text(kind: Callable[[str], Any], expected: str) -> Converter:
    def read(data: Any, path: str) -> Any:
        try:
            return kind(str(data))
        except ValueError:
            raise Mismatch(f"{path} is {data!r}; expected {expected}.") from None

    return Converter(str, read)


_SCALARS: Mapping[Any, Converter] = {
    Any: Converter(_pass_on, lambda data, path: data),
    str: _check_type(str, "a text"),
    int: _check_type(int, "a whole number"),
    float: _check_type((int, float), "a number"),
    bool: _check_type(bool, "true or false"),
    IPv4Address: _convert_text(IPv4Address, "an IPv4 address"),
    IPv4Network: _convert_text(IPv4Network, "an IPv4 network"),
}


def _optional(inner: Converter) -> Converter:
    def read(data: Any, path: str) -> Any:
        return None if data is None or data == inner.nothing else inner.read(data, path)

    # Each caller gets an empty dictionary of its own, since callers may change plain data.
    return Converter(
        lambda value: copy.copy(inner.nothing) if value is None else inner.write(value), read, inner.nothing
    )


def _list(item: Converter) -> Converter:
    def read(data: Any, path: str) -> tuple[Any, ...]:
        if not isinstance(data, (list, tuple)):
            raise Mismatch(f"{path} is {data!r}; expected a list.")
        return tuple(item.read(each, f"{path}[{number}]") for number, each in enumerate(data))

    return Converter(lambda value: [item.write(each) for each in value], read, None)


def _dictionary(item: Converter) -> Converter:
    def read(data: Any, path: str) -> dict[str, Any]:
        if not isinstance(data, Mapping):
            raise Mismatch(f"{path} is {data!r}; expected a mapping.")
        return {str(key): item.read(each, f"{path}.{key}") for key, each in data.items()}

    return Converter(lambda value: {key: item.write(each) for key, each in value.items()}, read, None)


class _Field(NamedTuple):
    """A field of a dataclass with its key in plain data."""

    name: str
    key: str
    converter: Converter
    required: bool
    left_out: bool


def _record(kind: Any) -> Converter:
    hints = get_type_hints(kind)
    fields = [_describe_field(field, _converter(hints[field.name])) for field in dataclasses.fields(kind)]
    return Converter(functools.partial(_write_record, fields), functools.partial(_read_record, kind, fields), {})


def _describe_field(field: dataclasses.Field[Any], converter: Converter) -> _Field:
    key, words, left_out = field.metadata.get(_NOTATION, ("", (), False))
    required = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
    return _Field(
        field.name, key or field.name, _add_words(converter, words) if words else converter, required, left_out
    )


def _add_words(inner: Converter, words: Sequence[tuple[Any, str]]) -> Converter:
    """Return the converter for a field some of whose values have a text of their own."""
    by_value, by_word = dict(words), {word: value for value, word in words}
    return Converter(
        lambda value: by_value[value] if value in by_value else inner.write(value),
        lambda data, path: by_word[data] if isinstance(data, str) and data in by_word else inner.read(data, path),
    )


def _write_record(fields: Sequence[_Field], value: Any) -> dict[str, Any]:
    contents = ((field, getattr(value, field.name)) for field in fields)
    return {
        field.key: field.converter.write(content)
        for field, content in contents
        if not (field.left_out and content is None)
    }


def _read_record(kind: Any, fields: Sequence[_Field], data: Any, path: str) -> Any:
    if not isinstance(data, Mapping):
        raise Mismatch(f"{path or kind.__name__} is {data!r}; expected a mapping.")
    begin = f"{path}." if path else ""
    missing = [field.key for field in fields if field.required and field.key not in data]
    if missing:
        raise Mismatch(f"{begin}{missing[0]} is missing.")
    present = [field for field in fields if field.key in data]
    return kind(**{field.name: field.converter.read(data[field.key], begin + field.key) for field in present})
