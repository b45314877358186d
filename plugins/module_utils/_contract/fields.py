# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The form of the contract: a class for each part of an answer, with a type, a sentence and an example for each field.

No dataclasses: Python 3.6 has none, and on a robot they would cost a hundred times as much. The controller makes them of these classes.
"""

import enum
import typing

T = typing.TypeVar("T")

if typing.TYPE_CHECKING:
    from typing_extensions import dataclass_transform
else:

    def dataclass_transform(**_options):
        """Return a decorator that does nothing."""
        return lambda kind: kind


class Field(typing.NamedTuple):
    """A field: its type, the default value, and its documentation."""

    kind: (
        typing.Any
    )  # str, int, float, bool, Outcome, a Struct, Tuple[kind, ...], Dict[str, kind], Any, or Optional of these
    text: str  # a sentence, as Ansible's documentation marks it up
    sample: typing.Any  # plain data
    default: typing.Any
    needed: bool  # there is no default
    returned: str  # when; "always" and "success" are promises
    kept: bool  # the controller's checks read it
    added: str  # the version of the collection that brought it, empty for that of the module


def field(
    text: str,
    sample: typing.Any = None,
    *,
    default: typing.Any = ...,
    needed: bool = False,
    returned: str = "",
    kept: bool = True,
    added: str = "",
) -> typing.Any:
    """Describe a field of a Struct.

    The `sample` of a Struct, or of a list of them, is made of their fields if it is left out. The default value is the empty
    one of the type: null if that is allowed, else an empty text, list or Struct, false, 0, or the first word.
    With `kept=False` it is for people, and for modules that call this one.
    """
    return Field(None, text, sample, default, needed, returned, kept, added)


def list_arguments(kind: typing.Any) -> typing.Tuple[typing.Any, ...]:
    """Return X of Optional[X], of Tuple[X, ...], or of Dict[str, X]; nothing for any other type."""
    arguments = getattr(kind, "__args__", None) or ()
    return tuple(one for one in arguments if one not in (type(None), Ellipsis)) if is_generic(kind) else ()


def is_generic(kind: typing.Any) -> bool:
    """Return True for Optional[X], Tuple[X, ...] and Dict[str, X]."""
    return getattr(kind, "__origin__", None) is not None


def is_optional(kind: typing.Any) -> bool:
    """Return True if the value may be null."""
    return getattr(kind, "__origin__", None) is typing.Union


def strip_optional(kind: typing.Any) -> typing.Any:
    """Return X of Optional[X], else the type itself."""
    return list_arguments(kind)[0] if is_optional(kind) else kind


def is_list(kind: typing.Any) -> bool:
    """Return True for Tuple[X, ...]: a list in plain data."""
    return getattr(kind, "__origin__", None) in (tuple, typing.Tuple)


def is_struct(kind: typing.Any) -> bool:
    """Return True for a Struct."""
    return isinstance(kind, type) and issubclass(kind, Struct)


def _find_default(kind: typing.Any) -> typing.Any:
    if is_optional(kind) or kind is typing.Any:
        return None
    if is_list(kind):
        return ()
    if is_generic(kind):
        return {}
    return next(iter(kind)) if issubclass(kind, enum.Enum) else kind()


def find_struct(kind: typing.Any) -> typing.Optional[typing.Type["Struct"]]:
    """Return the Struct of a value or of each entry of a list; None for anything else."""
    kind = strip_optional(kind)
    each = list_arguments(kind)[0] if is_list(kind) else kind
    return each if is_struct(each) else None


def make_sample(entry: Field) -> typing.Any:
    """Return an example of a field as plain data; None if the field has no example."""
    struct = find_struct(entry.kind)
    if entry.sample is not None or struct is None:
        return entry.sample
    return [struct.make_sample()] if is_list(strip_optional(entry.kind)) else struct.make_sample()


@dataclass_transform(frozen_default=True)
class Struct:
    """A part of an answer. `FIELDS` has its fields by name, in their order."""

    FIELDS: typing.ClassVar[typing.Dict[str, Field]] = {}

    if typing.TYPE_CHECKING:
        __dataclass_fields__: typing.ClassVar[typing.Dict[str, typing.Any]]

    def __init_subclass__(cls, returned: str = "always") -> None:
        """Read the fields; `returned` is of those that do not say it themselves."""
        super().__init_subclass__()
        cls.FIELDS = {}
        for name, kind in cls.__annotations__.items():
            entry = cls.__dict__[name]
            default = _find_default(kind) if entry.default is ... and not entry.needed else entry.default
            cls.FIELDS[name] = entry._replace(kind=kind, default=default, returned=entry.returned or returned)
            if entry.needed:
                delattr(cls, name)
            else:
                setattr(cls, name, default)

    if not typing.TYPE_CHECKING:

        def __init__(self, *values, **named) -> None:
            named.update(zip(self.FIELDS, values))
            strange = sorted(set(named) - set(self.FIELDS))
            missing = [name for name, entry in self.FIELDS.items() if entry.needed and name not in named]
            if strange or missing:
                raise TypeError(f"{type(self).__name__} has no {strange}, and needs {missing}")
            self.__dict__.update(named)

    @classmethod
    def make_sample(cls) -> typing.Dict[str, typing.Any]:
        """Return an example as plain data."""
        return {name: make_sample(entry) for name, entry in cls.FIELDS.items()}

    def plain(self) -> typing.Dict[str, typing.Any]:
        """Return plain data, as a module answers it."""
        return {name: _plain(getattr(self, name)) for name in self.FIELDS}


def _plain(value: typing.Any) -> typing.Any:
    if isinstance(value, Struct):
        return value.plain()
    if isinstance(value, (list, tuple)):
        return [_plain(each) for each in value]
    return value.value if isinstance(value, enum.Enum) else value
