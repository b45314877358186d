# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The back ends together: who owns which interface, and the boot part of all routes as one change."""

import collections
import os
import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._changes import atomic
from ansible_collections.rosfleet.multimaster.plugins.module_utils._changes.difference import difference
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.problem import Problem
from ansible_collections.rosfleet.multimaster.plugins.module_utils._routes.managers import (
    ifupdown,
    netplan,
    networkd,
    networkmanager,
)
from ansible_collections.rosfleet.multimaster.plugins.module_utils._routes.managers.contract import Machine
from ansible_collections.rosfleet.multimaster.plugins.module_utils._routes.plan import Item

# Whom to ask, in this order; the first that owns an interface has it. netplan comes before the managers it writes for.
BACKENDS = collections.OrderedDict(
    [
        ("netplan", netplan.BackEnd),
        ("networkd", networkd.BackEnd),
        ("networkmanager", networkmanager.BackEnd),
        ("ifupdown", ifupdown.BackEnd),
    ]
)
NONE = "none"

# backend name -> interface -> routes
Choice = typing.Dict[str, typing.Dict[str, typing.List[typing.Any]]]


class Boot:
    """What is at the places of the boot part now, and what shall be there."""

    def __init__(self, machine: Machine, root: str, record: typing.Dict[str, typing.Any]) -> None:
        """`record`: the part of the record that `memory` gives. Changes nothing. Raises Problem."""
        self.machine, self.root = machine, root
        self.recorded = record.get("places", {})
        self.pending = record.get("pending", {})
        self.folders = list(record.get("folders", []))  # those that we made, outermost first
        self.ends = collections.OrderedDict()
        for name, kind in BACKENDS.items():
            texts = {place: entry["texts"] for place, entry in self.recorded.items() if entry["backend"] == name}
            self.ends[name] = kind(machine, root, texts)
        self.before = {name: end.read() for name, end in self.ends.items()}
        self.owned: typing.Dict[str, typing.Set[str]] = {}
        self.wanted: typing.Dict[str, typing.Dict[str, typing.Optional[str]]] = {}
        self.routes: typing.Dict[str, typing.List[typing.Any]] = {}

    # Who

    def owner(self, interface: str) -> str:
        """The back end that owns an interface, "" for nobody."""
        for name, end in self.ends.items():
            if name not in self.owned:
                self.owned[name] = end.owns()
            if interface in self.owned[name]:
                return name
        return ""

    def backend_of(self, item: Item, overrides: typing.Mapping[str, str]) -> str:
        """The back end of a route: its own, else that of its interface, else the owner. Raises Problem."""
        name = item.backend if item.backend != "auto" else overrides.get(item.carrier, "auto")
        if name == "auto":
            name = self.owner(item.carrier) if item.carrier else ""
        if not name:
            raise Problem(
                "routes: %s: none of %s manages %s, so nothing would bring the route back at boot, expected one of them: let "
                "one manage the interface, or set backend to none for a route at run time only."
                % (item.route.destination, ", ".join(BACKENDS), item.carrier or "an interface that could carry it")
            )
        return name

    def place(self, backend: str, interface: str) -> typing.Optional[str]:
        """Where the routes of this interface are at boot, None for nowhere. Raises Problem."""
        return None if backend == NONE else self.ends[backend].place(interface)

    # What

    def want(self, choice: Choice) -> None:
        """Plan the places for these routes. Raises Problem where a manager's own tool refuses what changes."""
        for name, end in self.ends.items():
            listed = choice.get(name, {})
            wanted: typing.Dict[str, typing.Optional[str]] = dict.fromkeys(self.before[name])
            if listed or wanted:
                wanted.update(end.render(listed))
            self.wanted[name] = wanted
            for interface, routes in listed.items():
                self.routes.setdefault(end.place(interface), []).extend(dict(route._asdict()) for route in routes)
        for name in self.changes:
            self.ends[name].check(self.wanted[name])
        self.folders += [folder for folder in self._missing() if folder not in self.folders]

    @property
    def changes(self) -> typing.Dict[str, typing.List[str]]:
        """Back end -> its places that change, or that a killed run has not told its manager about."""
        changed = {}
        for name, wanted in self.wanted.items():
            differ = {
                place
                for place, text in wanted.items()
                if text != self.before[name].get(place) or (text is not None and self.ends[name].wrong_mode(place))
            }
            places = sorted(differ | set(self.pending.get(name, [])))
            if places:
                changed[name] = places
        return changed

    def is_new(self, backend: str, place: typing.Optional[str], route: typing.Any) -> bool:
        """Whether a route is new at its place, or its place has been altered."""
        if place is None or place not in self.changes.get(backend, []):
            return False
        recorded = self.recorded.get(place, {"texts": [], "routes": []})
        untouched = self.before[backend].get(place) in recorded["texts"]
        return not untouched or self.ends[backend].wrong_mode(place) or dict(route._asdict()) not in recorded["routes"]

    @property
    def difference(self) -> typing.List[typing.Dict[str, str]]:
        """The places that change, for `diff`."""

        def content(text: typing.Optional[str]) -> typing.Optional[bytes]:
            return None if text is None else text.encode("utf-8")

        return [
            difference(place, content(self.before[name].get(place)), content(self.wanted[name].get(place)))
            for name, places in self.changes.items()
            for place in places
        ]

    # How

    def interim(self) -> typing.Dict[str, typing.Any]:
        """The record before the change: both texts of every place, since a killed run leaves either."""
        places = dict(self.recorded)
        for name, changed in self.changes.items():
            for place in changed:
                entry = places.get(place, {"backend": name, "texts": [], "routes": []})
                texts = [self.before[name].get(place), self.wanted[name].get(place)]
                new = [text for text in texts if text is not None and text not in entry["texts"]]
                places[place] = dict(entry, texts=entry["texts"] + new)
        return _filled(places=places, pending=self.changes, folders=self.folders)

    def memory(self) -> typing.Dict[str, typing.Any]:
        """The record after the change."""
        places = {
            place: {"backend": name, "texts": [text], "routes": self.routes.get(place, [])}
            for name, wanted in self.wanted.items()
            for place, text in wanted.items()
            if text is not None
        }
        folders = [folder for folder in self.folders if any(place.startswith(folder + "/") for place in places)]
        return _filled(places=places, folders=folders)

    def _missing(self) -> typing.List[str]:
        """The folders that the files need and that are not there, outermost first."""
        missing = []
        for wanted in self.wanted.values():
            for place in (place for place, text in wanted.items() if text is not None and place.startswith("/")):
                folder, found = os.path.dirname(place), []
                while not os.path.isdir(self._path(folder)):
                    found.append(folder)
                    folder = os.path.dirname(folder)
                missing += [folder for folder in reversed(found) if folder not in missing]
        return missing

    def _path(self, place: str) -> str:
        return os.path.join(self.root, place.lstrip("/"))

    def apply(self) -> None:
        """Write and activate what changes. Raises Problem or OSError; `undo` takes it back."""
        self._write(self.wanted)

    def undo(self) -> typing.List[str]:
        """Bring the places back to what they were; returns what failed."""
        failures = []
        try:
            self._write(self.before)
        except (Problem, OSError) as problem:
            failures.append(str(problem))
        return failures

    def _write(self, texts: typing.Mapping[str, typing.Mapping[str, typing.Optional[str]]]) -> None:
        for name, places in self.changes.items():
            end = self.ends[name]
            for place in places:
                text = texts[name].get(place)
                if text is not None and place.startswith("/"):
                    atomic.make_folders(os.path.dirname(self._path(place)))
                end.write(place, text)
            self._tidy(name, texts)
            end.activate(places)

    def _tidy(self, name: str, texts: typing.Mapping[str, typing.Mapping[str, typing.Optional[str]]]) -> None:
        """Remove the folders that we made and that nothing of ours is in any more."""
        kept = [place for place, text in texts[name].items() if text is not None]
        for folder in reversed(self.folders):
            path = self._path(folder)
            if os.path.isdir(path) and not any(place.startswith(folder + "/") for place in kept):
                atomic.remove_folder_if_empty(path)


def _filled(**parts: typing.Any) -> typing.Dict[str, typing.Any]:
    return {name: value for name, value in parts.items() if value}
