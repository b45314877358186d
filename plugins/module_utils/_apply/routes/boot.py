# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The boot part of all routes as one change: the back end of each route, the places that change, and their record."""

import os
import typing

from ..._base.difference import difference, mode_difference
from ..._base.problem import Problem, sentence
from ..transaction import atomic
from .kernel import RouteSpec, format_route
from .managers.contract import MachineContext, PlannedTexts, RoutesByInterface
from .managers.table import AUTO, BACKENDS
from .options import RouteRequest
from .plan import Entries
from .record import PlaceRecord, RoutesRecord


def _check_expressible(name: str, inexpressible: typing.Tuple[str, ...], routes: typing.List[RouteSpec]) -> None:
    """Raises Problem for fields that a back end has no word for."""
    for route in routes:
        fields = [field for field in inexpressible if getattr(route, field)]
        if fields:
            raise Problem(
                f"routes: {format_route(route)}: the backend {name} has no word for {', '.join(fields)}, so the route would come back without "
                "it at boot: remove it, or set backend to none for this route."
            )


# back end -> interface -> its routes, one at least
Choice = typing.Dict[str, RoutesByInterface]


class Boot:
    """The places of the boot part: their contents now, and their wanted contents."""

    def __init__(self, machine: MachineContext, record: RoutesRecord) -> None:
        """Read the places; changes nothing. Raises Problem if something in a place of ours is not ours."""
        self.machine = machine
        self.recorded = record
        self.folders = list(record.folders)
        self.backends = {name: kind(machine, self._list_texts(name)) for name, kind in BACKENDS.items()}
        self.texts = {name: backend.read() for name, backend in self.backends.items()}
        self.before = {place: text for texts in self.texts.values() for place, text in texts.items()}
        self.wanted: PlannedTexts = {}
        self.modes: typing.Dict[str, int] = {}  # of our files whose mode was changed by hand
        #: back end -> its places that change, or that a killed run has written before its manager read them
        self.changes: typing.Dict[str, typing.List[str]] = {}
        self.places: typing.Dict[str, PlaceRecord] = {}  # the record of the places after the change

    def _list_texts(self, backend: str) -> typing.Dict[str, typing.List[str]]:
        return {name: place.texts for name, place in self.recorded.places.items() if place.backend == backend}

    # The back end of a route

    def find_owner(self, interface: str) -> str:
        """The back end that owns an interface, "" if no back end owns it."""
        return next((name for name, backend in self.backends.items() if interface in backend.list_interfaces()), "")

    def choose_backend(self, item: RouteRequest, overrides: typing.Mapping[str, str]) -> str:
        """The back end of a route: its own, else that of its interface (`overrides`), else the owner.

        Raises Problem if nothing manages the interface.
        """
        name = item.backend if item.backend != AUTO else overrides.get(item.boot_device, AUTO)
        if name == AUTO:
            name = self.find_owner(item.boot_device) if item.boot_device else ""
        if not name:
            raise Problem(
                f"routes: {item.route.destination}: none of {', '.join(BACKENDS)} manages "
                f"{item.boot_device or 'an interface that could carry it'}, so nothing would bring the route back at boot, "
                "expected one of them: let one manage the interface, or set backend to none for a route at run time only."
            )
        return name

    # The plan

    def plan(self, choice: Choice) -> None:
        """Plan the places for these routes. Raises Problem if a manager's own tool refuses a change."""
        for name, backend in self.backends.items():
            routes: typing.Dict[str, RoutesByInterface] = {}
            for interface, interface_routes in sorted(choice.get(name, {}).items()):
                _check_expressible(name, backend.inexpressible, interface_routes)
                routes.setdefault(backend.find_place(interface), {})[interface] = interface_routes
            wanted: PlannedTexts = dict.fromkeys(self.texts[name])
            wanted.update({place: backend.render(place, by_interface) for place, by_interface in routes.items()})
            differing = set(self.recorded.pending.get(name, []))
            for place, text in wanted.items():
                mode = None if text is None else backend.find_wrong_mode(place)
                if mode is not None:
                    self.modes[place] = mode
                if mode is not None or text != self.before.get(place):
                    differing.add(place)
                if text is not None:
                    all_routes = [route for interface_routes in routes[place].values() for route in interface_routes]
                    self.places[place] = PlaceRecord(name, [text], all_routes)
            if differing:
                backend.check(wanted)
                self.changes[name] = sorted(differing)
            self.wanted.update(wanted)
        self.folders += [folder for folder in self._find_missing_folders() if folder not in self.folders]

    def is_new(self, backend: str, place: typing.Optional[str], route: RouteSpec) -> bool:
        """True if a route is new at its place, or the place was changed by hand."""
        if place is None or place not in self.changes.get(backend, []):
            return False
        recorded = self.recorded.places.get(place, PlaceRecord(backend, [], []))
        untouched = self.before.get(place) in recorded.texts
        return not untouched or place in self.modes or route not in recorded.routes

    @property
    def difference(self) -> typing.List[typing.Dict[str, str]]:
        """The places whose text or mode changes, for `diff`."""
        differences = []
        for name, place in [(name, place) for name, places in self.changes.items() for place in places]:
            before, after = self.before.get(place), self.wanted.get(place)
            if before != after:
                differences.append(difference(place, before, after))
            elif place in self.modes:
                differences.append(mode_difference(place, self.modes[place], self.backends[name].mode))
        return differences

    @property
    def delays(self) -> typing.Dict[str, str]:
        """The managers that do not hear of changed places before the next boot: back end -> the reason."""
        reasons = {name: self.backends[name].explain_delay() for name in self.changes}
        return {name: reason for name, reason in reasons.items() if reason}

    def _find_missing_folders(self) -> typing.List[str]:
        """The missing folders of the wanted files, as the machine sees them, each outermost first."""
        files = [place for place in self.places if place.startswith("/")]
        missing = [
            path for place in files for path in atomic.find_missing_folders(os.path.dirname(self.machine.path(place)))
        ]
        return ["/" + os.path.relpath(path, self.machine.root) for path in dict.fromkeys(missing)]

    # The record

    def interim_record(self, entries: Entries) -> RoutesRecord:
        """The record before the change. It has both texts of every place, since a killed run leaves either."""
        places = dict(self.recorded.places)
        for name, changed in self.changes.items():
            for place in changed:
                entry = places.get(place, PlaceRecord(name, [], []))
                texts = [self.before.get(place), self.wanted.get(place)]
                new = [text for text in texts if text is not None and text not in entry.texts]
                places[place] = entry._replace(texts=entry.texts + new)
        return RoutesRecord(entries, places, self.changes, self.folders)

    def final_record(self, entries: Entries) -> RoutesRecord:
        """The record after the change."""
        folders = [folder for folder in self.folders if any(place.startswith(folder + "/") for place in self.places)]
        return RoutesRecord(entries, self.places, {}, folders)

    # The change

    def apply(self) -> None:
        """Write the changed places and notify their managers. Raises Problem or OSError; `undo` takes it back."""
        self._write(self.wanted)

    def undo(self) -> typing.List[str]:
        """Restore the places; returns a sentence per failure."""
        try:
            self._write(self.before)
        except (Problem, OSError) as problem:
            return [sentence(problem)]
        return []

    def _write(self, texts: typing.Mapping[str, typing.Optional[str]]) -> None:
        """Write the changed places, and remove the folders of ours that are empty then."""
        kept = [place for place, text in texts.items() if text is not None]
        for name, places in self.changes.items():
            for place in places:
                if place in kept and place.startswith("/"):
                    atomic.make_folders(os.path.dirname(self.machine.path(place)))
                self.backends[name].write(place, texts.get(place))
            for folder in reversed(self.folders):
                path = self.machine.path(folder)
                if os.path.isdir(path) and not any(place.startswith(folder + "/") for place in kept):
                    atomic.remove_folder_if_empty(path)
            self.backends[name].activate(places)
