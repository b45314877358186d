# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The record of the module sysctl: the values from before its settings, its drop-ins and its folders."""

import typing

from .kernel import changes_others_first

Data = typing.Dict[str, typing.Any]  # JSON
SHAPE = {
    "drop_ins": [str],
    "folders": [str],
    "order": [str],
    "settings": {"*": {"key": str, "before": (str, type(None)), "set": [str], "beside": {"*": str}}},
}


class Entry(typing.NamedTuple):
    """The record of one setting of ours."""

    key: str
    before: typing.Optional[str]  # the value before our first run
    set: typing.Sequence[str] = ()  # the values that we have set: two after a killed run
    beside: typing.Mapping[str, str] = {}  # the values before, of the keys that did not follow this key


class SettingsRecord(typing.NamedTuple):
    """The whole record."""

    drop_ins: typing.Sequence[str] = ()  # those that we may have written: two after a killed run with a new name
    folders: typing.Sequence[str] = ()  # those that we made for the drop-in, outermost first
    settings: typing.Mapping[str, Entry] = {}  # the kernel's variable -> entry, in the order of the list that set them

    def plain(self) -> Data:
        """The record as JSON holds it; an empty record holds nothing."""
        if not any(self):
            return {}
        settings = {variable: dict(entry._asdict()) for variable, entry in self.settings.items()}
        data = {"drop_ins": list(self.drop_ins), "folders": list(self.folders), "settings": settings}
        order = list(self.settings)
        return data if order == _usual(order) else {**data, "order": order}


def _usual(variables: typing.Iterable[str]) -> typing.List[str]:
    """The order that a record has if it names no order."""
    return changes_others_first(sorted(variables))


def read(data: Data) -> SettingsRecord:
    """The record in the data of its file. Raises LookupError if something is missing."""
    stored = data.get("settings", {})
    order = data.get("order") or _usual(stored)
    settings = {
        variable: Entry(entry["key"], entry["before"], entry["set"], entry["beside"])
        for variable in [*order, *sorted(set(stored) - set(order))]
        for entry in [stored[variable]]
    }
    if not all(entry.set for entry in settings.values()):
        raise IndexError("no value was set")
    return SettingsRecord(data.get("drop_ins", []), data.get("folders", []), settings)
