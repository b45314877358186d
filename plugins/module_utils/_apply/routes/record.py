# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The record of the module routes: the routes that it made, and the places that bring them back at boot."""

import typing

from .kernel import PATH, RouteSpec
from .plan import Entries, RouteEntry

Data = typing.Dict[str, typing.Any]  # JSON
_LATER = ("scope",) + PATH
SHAPE = {
    "routes": [{"made": [dict], "replaced": [[str]]}],
    "boot": {
        "places": {"*": {"backend": str, "texts": [str], "routes": [dict]}},
        "pending": {"*": [str]},
        "folders": [str],
    },
}


class PlaceRecord(typing.NamedTuple):
    """The record of one place of a back end, such as a file."""

    backend: str
    texts: typing.List[str]  # every text that a run may have left there: two after a killed run
    routes: typing.List[RouteSpec]


class RoutesRecord(typing.NamedTuple):
    """The whole record."""

    entries: Entries
    places: typing.Dict[str, PlaceRecord]
    pending: typing.Dict[str, typing.List[str]]  # back end -> places that its manager has not read yet
    folders: typing.List[str]  # those that we made, outermost first

    def to_json(self) -> Data:
        """The record as JSON holds it; empty parts are left out."""
        routes = [
            {
                "made": [_route_to_json(route) for route in entry.made],
                "replaced": [list(words) for words in entry.replaced],
            }
            for key, entry in sorted(self.entries.items())
        ]
        places = {
            name: dict(place._asdict(), routes=[_route_to_json(route) for route in place.routes])
            for name, place in self.places.items()
        }
        return _drop_empty(routes=routes, boot=_drop_empty(places=places, pending=self.pending, folders=self.folders))


def read_record(data: Data) -> RoutesRecord:
    """The record in the data of its file.

    Raises AttributeError, IndexError, KeyError, TypeError or ValueError if the data has another shape.
    """
    entries = [
        RouteEntry(
            made=tuple(RouteSpec(**fields) for fields in item["made"]),
            replaced=tuple(tuple(words) for words in item["replaced"]),
        )
        for item in data.get("routes", [])
    ]
    boot = data.get("boot", {})
    places = {
        name: PlaceRecord(place["backend"], place["texts"], [RouteSpec(**fields) for fields in place["routes"]])
        for name, place in boot.get("places", {}).items()
    }
    by_key = {entry.made[0].key: entry for entry in entries}
    return RoutesRecord(by_key, places, boot.get("pending", {}), boot.get("folders", []))


def _route_to_json(route: RouteSpec) -> Data:
    """The fields of a route; those that earlier versions did not have only if they are set."""
    return {name: value for name, value in route._asdict().items() if value or name not in _LATER}


def _drop_empty(**parts: typing.Any) -> Data:
    return {name: value for name, value in parts.items() if value}
