# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Records of the files and settings of the modules on a machine: one JSON file per module and purpose."""

import contextlib
import glob
import json
import os
import typing

from ..._base.problem import Problem, remedy
from . import atomic

RECORDS = "/var/lib/rosfleet-multimaster"
T = typing.TypeVar("T")
#: The form of a record: a type or several, [form] for a list, {"*": form} for an object, {"key": form} if each key
#: may be missing. Other keys are not checked here.
Shape = typing.Any


class Record:
    """The record of one module on this machine: a JSON object in a file of its own, absent while empty."""

    def __init__(self, name: str, folder: str = RECORDS, shape: Shape = dict) -> None:
        self.path = os.path.join(folder, name + ".json")
        self.shape = shape

    def load(self) -> typing.Dict[str, typing.Any]:
        """The saved object, or an empty one. Raises Problem if the file cannot be read, or has another shape than the record."""
        try:
            content = atomic.read_bytes(self.path)
        except OSError as problem:
            raise Problem(
                f"The record {self.path} cannot be read ({problem.strerror}); expected a file that this module wrote: "
                f"{remedy(problem)}."
            ) from problem
        if content is None:
            return {}
        try:
            data = json.loads(content.decode("utf-8"))
        except (ValueError, RecursionError) as problem:
            raise Problem(
                f"The record {self.path} is not readable as JSON ({problem}); expected the text of this module: "
                "restore it from a backup, or remove it and its files by hand."
            ) from problem
        if not isinstance(data, dict):
            raise Problem(f"The record {self.path} holds no JSON object; remove it to start without a memory.")
        wrong = misfit(data, self.shape)
        if wrong:
            raise self._describe_misfit(wrong)
        return data

    def parse(
        self, parser: typing.Callable[[typing.Dict[str, typing.Any]], T], data: typing.Dict[str, typing.Any]
    ) -> T:
        """The content of the record as the type of its module. Raises Problem if `parser` fails on it."""
        try:
            return parser(data)
        except (AttributeError, IndexError, KeyError, TypeError, ValueError) as problem:
            raise self._describe_misfit(type(problem).__name__) from problem

    def _describe_misfit(self, why: str) -> Problem:
        return Problem(
            f"The record {self.path} has not the form of this version of the module ({why}); "
            "restore it from a backup, or remove it and its files by hand."
        )

    def save(self, data: typing.Dict[str, typing.Any]) -> None:
        """Save an object unless it is saved already.

        One that says nothing removes the file, and the folder with the last file. A run that only removes things works
        on a full disk, too. Raises OSError.
        """
        data = data if any(data.values()) else {}
        if data and atomic.read_bytes(self.path) == _encode(data):
            atomic.remove_leftovers(self.path)
        elif data:
            atomic.make_folders(os.path.dirname(self.path))
            atomic.write_by_rename(self.path, _encode(data), mode=0o600)
        elif os.path.lexists(self.path):
            atomic.remove_leftovers(self.path)
            atomic.remove_for_good(self.path)
            atomic.remove_folder_if_empty(os.path.dirname(self.path))
        else:
            self.tidy()

    def tidy(self) -> None:
        """Remove the remains of an empty record of a killed run. A file that stays is no failure."""
        with contextlib.suppress(OSError):  # a read-only root, or a folder of another user
            atomic.remove_leftovers(self.path)
            atomic.remove_folder_if_empty(os.path.dirname(self.path))


def check_absolute(options: typing.Mapping[str, typing.Any], *names: str) -> None:
    """Raise Problem if one of these options is no absolute path."""
    for name in names:
        if not os.path.isabs(options[name]):
            raise Problem(f"{name} is {options[name]!r}, expected an absolute path.")


def misfit(data: typing.Any, shape: Shape, place: str = "") -> str:
    """Return the place at which data differs from a shape; empty if it has that shape."""
    if isinstance(shape, list) and isinstance(data, list):
        parts = [(f"{place}[{index}]", value, shape[0]) for index, value in enumerate(data)]
    elif isinstance(shape, dict) and isinstance(data, dict):
        parts = [(f"{place}.{key}".lstrip("."), value, shape.get(key, shape.get("*"))) for key, value in data.items()]
        parts += [(f"a key of {place or 'the object'}", key, str) for key in data]
    else:
        known = not isinstance(shape, (list, dict)) and isinstance(data, shape)
        return "" if known and not (isinstance(data, str) and _unfit(data)) else f"{place} is {data!r:.80}"
    return next(filter(None, (misfit(value, form, where) for where, value, form in parts if form is not None)), "")


def _unfit(text: str) -> bool:
    """True for a text that is no path: with a NUL, or with half of a character."""
    try:
        return b"\0" in text.encode("utf-8", "surrogateescape")
    except UnicodeEncodeError:
        return True


def _encode(data: typing.Dict[str, typing.Any]) -> bytes:
    return (json.dumps(data, indent=2, sort_keys=True) + "\n").encode("utf-8")


def records(folder: str = RECORDS) -> typing.List[str]:
    """The names of the records on this machine, sorted."""
    return sorted(os.path.basename(path)[:-5] for path in glob.glob(os.path.join(glob.escape(folder), "*.json")))
