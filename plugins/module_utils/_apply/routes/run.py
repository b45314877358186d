# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""One run of the module routes, over the kernel's routes and the places that bring them back at boot.

The kernel comes first and the boot part second, so a manager that reads a new route finds it in the kernel. The record is
on disk before both: after a killed run, the next run knows our routes and repairs them.
"""

import os
import typing

from ..._base.difference import difference_of_lines
from ..._base.plain_text import quote
from ..._base.problem import Problem
from ..._base.rights import may_change_network
from ..transaction import writable
from ..transaction.module import Concern, ModuleRun
from ..transaction.network import state as network_state
from ..transaction.record import RECORDS, Record, check_absolute
from ..transaction.transaction import Step, carry_out, intent, outcome
from . import kernel, plan, record
from . import options as route_options
from .boot import Boot, Choice
from .managers import contract
from .managers.table import CHOICES, NONE
from .tables import read_tables

RUN_TIME = "routes at run time"
# Protocols of routes that managers make from their configuration; a person's `ip route add` gives "boot".
_CONFIGURED = ("static", "dhcp", "ra")
# Protocols of routes that come back by themselves after a manager has dropped them.
_RETURNING = ("kernel", "dhcp", "ra", "redirect")

_TAKEN_BACK = {
    "removed": "{before} is removed.",
    "restored": "{after} is there again.",
    "lost": "{before} is removed; {after}, whose place it had, cannot be given back as the interfaces are now.",
    "gone": "The route to {destination} was no longer there.",
    "left": "{before} is left: it is foreign, and in the place of ours.",
}
_SECOND_DEFAULT = (
    "There is a second default route, {text}, in addition to the listed one: the lower metric decides which is taken. "
    "Turn it off at its source, or give the listed one a lower metric."
)

_DELAY = (
    "{manager} reads the routes at the next boot, and not now, since {reason}: it might delete foreign routes and rules. "
    "Until then, run this again if a link was down."
)

ROUTE = {
    "destination": {"type": "str", "required": True},
    "gateway": {"type": "str"},
    "device": {"type": "str"},
    "metric": {"type": "int"},
    "table": {"type": "str", "default": "254"},
    "source": {"type": "str"},
    "on_link": {"type": "bool", "default": False},
    "type": {"type": "str", "default": "unicast", "choices": ["unicast", *kernel.NO_WAY]},
    "scope": {"type": "str", "choices": ["global", "link", "host"]},
    "mtu": {"type": "int"},
    "advmss": {"type": "int"},
    "initcwnd": {"type": "int"},
    "backend": {"type": "str", "default": "auto", "choices": CHOICES},
}
OPTIONS = {
    "routes": {"type": "list", "elements": "dict", "required": True, "options": ROUTE},
    "backends": {"type": "dict", "default": {}},
    "on_conflict": {"type": "str", "default": "fail", "choices": ["fail", "replace"]},
    "root": {"type": "path", "default": "/"},
    "records": {"type": "path", "default": RECORDS},
}

Options = typing.Mapping[str, typing.Any]
Data = typing.Dict[str, typing.Any]  # JSON


class RoutesRun(ModuleRun):
    """One run of the module: reads the machine and plans, then applies the plan or reports the obstacle."""

    def __init__(self, options: Options, memory: typing.Optional[Data] = None) -> None:
        """Read and plan; changes nothing. `memory`: that of an earlier run that changed only the run time.

        Raises Problem for options, files or a record that cannot be used.
        """
        check_absolute(options, "root", "records")
        self.machine = contract.read_machine(options["root"])
        self.overrides = _check_overrides(options["backends"] or {}, self.machine.interfaces)
        self.tables = read_tables(options["root"])
        requests = route_options.parse_routes(options["routes"], self.machine.interfaces, self.tables, _read_main_table)
        self.routes = [item.route for item in requests]
        self.record = Record("routes", options["records"], record.SHAPE)
        self.stored = self.record.load()
        self.recorded = self.record.parse(record.read_record, self.stored if memory is None else memory)
        self.keys = [route.key for route in self.routes] + list(self.recorded.entries)
        self.current = self._read_kernel()
        route_options.check_usable(requests, self.machine.interfaces, self._list_near_routes())
        replace = options["on_conflict"] == "replace"
        self.plan = plan.plan_routes(self.routes, self.current, self.recorded.entries, replace, self.machine.interfaces)
        self.taken_back = self.plan.taken_back
        self.boot = Boot(self.machine, self.recorded)
        self.items = self._plan_boot([self._choose_boot_device(item, requests) for item in requests])
        self.runtime_changes = bool(self.plan.changes)
        self.changed = self.runtime_changes or bool(self.boot.changes)
        self.watch = network_state.StateWatch(self._is_planned_to_go)
        # The record as it must be while the change of the kernel is on its way.
        self.memory = self.recorded._replace(entries=self.plan.interim).to_json()

    def _list_near_routes(self) -> typing.List[kernel.RouteSpec]:
        """The kernel's routes that may lead to a gateway: those of our tables, and of main for the other tables."""
        versions = {route.version for route in self.routes if route.gateway and route.table != kernel.MAIN}
        return [kernel_route.route for kernel_route in _flatten(self.current)] + [
            route for version in sorted(versions) for route in _read_main_table(version)
        ]

    def _read_kernel(self) -> plan.Current:
        """The kernel's routes in the tables of our keys."""
        current: plan.Current = {}
        for version, table in sorted({(key[0], key[2]) for key in self.keys}):
            for kernel_route in kernel.read_routes(version, table):
                current.setdefault(kernel_route.route.key, []).append(kernel_route)
        return current

    # The boot part and the result per route

    def _choose_boot_device(
        self, item: route_options.RouteRequest, items: typing.List[route_options.RouteRequest]
    ) -> route_options.RouteRequest:
        """The request with an interface for the boot: that of another listed route, else that of the default route."""
        if item.boot_device:
            return item
        interfaces = self.machine.interfaces.values()
        devices = [other.boot_device for other in items if other.backend != NONE]
        devices += [
            kernel_route.route.device
            for kernel_route in _flatten(self.current)
            if kernel_route.route.destination in kernel.DEFAULTS.values()
        ]
        devices += sorted(link.name for link in interfaces if link.up and not link.loopback)
        return item._replace(boot_device=next((device for device in devices if device), ""))

    def _plan_boot(self, items: typing.List[route_options.RouteRequest]) -> typing.List[Data]:
        """The results per route, with the boot part planned."""
        names = [self.boot.choose_backend(item, self.overrides) for item in items]
        choice: Choice = {}
        for item, name in zip(items, names):
            if name != NONE:
                choice.setdefault(name, {}).setdefault(item.boot_device, []).append(item.route)
        self.boot.plan(choice)
        return [self._describe_route(*row) for row in zip(items, names, self.plan.results)]

    def _describe_route(self, item: route_options.RouteRequest, backend: str, runtime: plan.RouteResult) -> Data:
        place = None if backend == NONE else self.boot.backends[backend].find_place(item.boot_device)
        state, problem = runtime.state, runtime.problem
        conflict = self._find_boot_conflict(item.route) if backend != NONE else None
        if conflict:
            state, problem = "refused", conflict
        elif state == "ok" and self.boot.is_new(backend, place, item.route):
            state = "changed"
        return {
            **item.route.describe(),
            "source": item.route.source or None,
            "on_link": item.route.on_link,
            "type": item.route.type,
            "scope": item.route.scope or None,
            **{name: getattr(item.route, name) or None for name in kernel.PATH},
            "backend": backend,
            "before": runtime.before,
            "after": runtime.after,
            "boot_file": place,
            "changed": state == "changed",
            "state": state,
            "problem": problem,
        }

    def _find_boot_conflict(self, route: kernel.RouteSpec) -> typing.Optional[str]:
        """The sentence if a manager would make a foreign route again at boot, in addition to ours."""
        entry = self.recorded.entries.get(route.key)
        ours = {other.way for other in entry.made} if entry else set()
        for kernel_route in self.current.get(route.key, []):
            if (
                kernel_route.protocol in _CONFIGURED
                and kernel_route.route.way not in ours
                and not route.fits(kernel_route.route)
            ):
                owner = self.boot.find_owner(kernel_route.route.device)
                if owner and not self.boot.backends[owner].takes_precedence:
                    return (
                        f"routes: {kernel.format_route(route)}: {quote(kernel_route.text)} comes from {owner}, which would make it again at the next "
                        f"boot, in addition to this one: remove it from the configuration of {quote(kernel_route.route.device)}, or give this one "
                        "another metric."
                    )
        return None

    # For the shell of the modules

    @property
    def refusals(self) -> typing.List[str]:
        """One sentence for each route that conflicts with foreign routes, and one if the right to change routes is missing."""
        problems = [item["problem"] for item in self.items if item["problem"]]
        files = [place for places in self.boot.changes.values() for place in places if place.startswith("/")]
        locked = writable.obstacles([*map(self.machine.path, files), self.record.path]) if self.changed else []
        if not locked and self.plan.changes and not may_change_network():
            locked.append(
                f"routes: user {os.geteuid()} may not change the kernel's routes, expected root: run as root (become: true), in a "
                "container with the capability NET_ADMIN."
            )
        return problems + locked

    @property
    def warnings(self) -> typing.List[str]:
        """The sentences about other default routes, managers that have not read their routes yet, and routes that were not taken back as planned."""
        sentences = [_SECOND_DEFAULT.format(text=quote(other["text"])) for other in self.foreign_defaults]
        sentences += [_DELAY.format(manager=name, reason=reason) for name, reason in self.boot.delays.items()]
        return sentences + [_write_sentence(item) for item in self.taken_back if item["state"] in ("left", "lost")]

    @property
    def difference(self) -> typing.List[typing.Dict[str, str]]:
        """The routes and the files that change, for `diff`; without the routes that the kernel itself makes."""
        before, after = [], []
        for key in set(self.current) | set(self.plan.after):
            texts = [
                kernel_route.text for kernel_route in self.current.get(key, []) if kernel_route.protocol != "kernel"
            ]
            before += texts
            after += self.plan.after.get(key, texts)
        return difference_of_lines(RUN_TIME, sorted(before), sorted(after)) + self.boot.difference

    def result(self) -> Data:
        """The return values of the module."""
        return {
            "routes": self.items,
            "conflicts": [item["problem"] for item in self.items if item["state"] == "conflict"],
            "taken_back": self.taken_back,
            "other_defaults": self.foreign_defaults,
        }

    def summary(self, check_mode: bool) -> str:
        """The sentences of `msg`."""
        changed = sum(item["changed"] for item in self.items)
        sentences = [f"{changed} of {len(self.items)} routes changed."] if self.items else []
        sentences += [_write_sentence(item) for item in self.taken_back]
        if self.changed and not changed and not self.taken_back:
            places = sorted(place for changed_places in self.boot.changes.values() for place in changed_places)
            sentences.append(f"{', '.join(places)} is brought up to date.")
        return " ".join(sentences) or "No routes are ours."

    @property
    def foreign_defaults(self) -> typing.List[Data]:
        """The foreign default routes that stay in addition to ours."""
        staying = _flatten(
            {key: kernel_routes for key, kernel_routes in self.current.items() if key not in self.plan.after}
        )
        return [
            dict(kernel_route.route.describe(), protocol=kernel_route.protocol, text=kernel_route.text)
            for kernel_route in plan.find_other_defaults(self.routes, staying)
        ]

    # For the dead-man's switch

    def undo_steps(self) -> typing.List[typing.List[str]]:
        """The commands that restore the kernel's routes as this run found them, also from half way."""
        return [plan.build_undo_command(change) for change in self.plan.undo]

    def apply_runtime(self) -> None:
        """Change only the kernel's routes. Raises Problem, which lists routes that are not as they were before."""
        carry_out([*self.watch_steps(), self._kernel_step()])

    # The change

    def apply(self) -> None:
        """Make everything as planned. Raises Problem, which lists routes that are not as they were before."""
        # If something is left of a change of the kernel, the next run needs the record of the change to repair it.
        planned = self.memory if self.plan.changes else self.stored
        steps = self.watch_steps() if self.changed else []
        steps += [intent(self.record, planned, self.stored, "the record {what} ({reason})"), self._kernel_step()]
        if self.boot.changes:
            before: plan.Current = {}
            steps += [
                outcome(self.record, self.boot.interim_record(self.plan.interim).to_json()),
                Step(RUN_TIME, do=lambda: before.update(self._read_kernel())),
                Step("the boot part", do=lambda: self._change_boot(before), undo=self.boot.undo),
            ]
        carry_out([*steps, outcome(self.record, self.boot.final_record(self.plan.final).to_json())])

    def _is_planned_to_go(self, item: network_state.NetworkItem) -> bool:
        """True for a route of a key that this run changes."""
        if item.kind != "route":
            return False
        table = network_state.find_word(item.text.split(), "table")
        number = int(table) if table.isdigit() else self.tables.get(table, kernel.MAIN)
        return kernel.parse_route(item.text, item.version, number).route.key in self.plan.after

    def _kernel_step(self) -> Step:
        return Step(RUN_TIME, do=self._change_kernel, undo=self._restore_kernel)

    def _change_kernel(self) -> None:
        for change in self.plan.changes:
            kernel.change_route(change.command, change.may_fail)
        if self.plan.changes:
            self._check_kernel()
            self._check_taken_back()

    def _restore_kernel(self) -> typing.List[str]:
        """Undo the changes of the kernel's routes; returns the commands that failed."""
        failures = []
        for change in self.plan.undo:
            try:
                kernel.change_route(change.command, change.may_fail)
            except Problem:
                failures.append(f"'{' '.join(change.command)}'")
        return failures

    def _check_kernel(self) -> None:
        """Raises Problem if the kernel's routes differ from the plan."""
        now = self._read_kernel()
        for route, item in zip(self.routes, self.items):
            kernel_routes = now.get(route.key, [])
            same = [kernel_route for kernel_route in kernel_routes if route.fits(kernel_route.route)]
            if not same:
                texts = " and ".join(quote(kernel_route.text) for kernel_route in kernel_routes) or "nothing"
                raise Problem(
                    f"routes: {kernel.format_route(route)}: the kernel holds {texts} afterwards, expected this route: something else "
                    "changes it at the same time."
                )
            item["after"] = same[0].text
            for (
                kernel_route
            ) in kernel_routes:  # kernels differ in the routes that `replace` leaves next to a route of IPv6
                if kernel_route not in same:
                    surplus = plan.remove(kernel_route)
                    kernel.change_route(surplus.command, surplus.may_fail)

    def _check_taken_back(self) -> None:
        """Mark the routes that could not be restored, because their gateway or interface is no longer there.

        Raises Problem if a route of ours is still there.
        """
        now = {kernel_route.text for kernel_route in _flatten(self._read_kernel())} if self.taken_back else set()
        for item in self.taken_back:
            if item["state"] == "restored" and item["after"] not in now:
                item.update(state="lost")
            if item["state"] in ("removed", "lost") and item["before"] in now:
                raise Problem(
                    f"routes: the kernel still holds {quote(item['before'])} afterwards, expected it to be removed: find the program that "
                    f"'ip route del {item['before']}' says."
                )

    def _change_boot(self, before: plan.Current) -> None:
        """Change the boot part, and restore the routes that a manager has dropped when it read the changed places."""
        self.boot.apply()
        after = self._read_kernel()
        for key, kernel_routes in before.items():
            for kernel_route in kernel_routes:
                if kernel_route.protocol not in _RETURNING and key not in after:
                    kernel.change_route(plan.RouteChange("replace", key, kernel_route.words).command)
        self._check_kernel()


def _read_main_table(version: int) -> typing.List[kernel.RouteSpec]:
    return [kernel_route.route for kernel_route in kernel.read_routes(version, kernel.MAIN)]


def _flatten(current: plan.Current) -> typing.List[kernel.KernelRoute]:
    return [kernel_route for kernel_routes in current.values() for kernel_route in kernel_routes]


def _write_sentence(item: Data) -> str:
    return _TAKEN_BACK[item["state"]].format(
        destination=item["destination"], **{when: quote(item[when] or "") for when in ("before", "after")}
    )


def _check_overrides(backends: typing.Mapping[str, str], interfaces: typing.Container[str]) -> typing.Mapping[str, str]:
    """The option backends. Raises Problem for names that are no interface or no back end."""
    for interface, name in backends.items():
        if interface not in interfaces:
            raise Problem(f"backends: there is no interface {interface}: correct or remove it.")
        if name not in CHOICES:
            raise Problem(f"backends: {interface} has {name!r}, expected one of {', '.join(CHOICES)}.")
    return backends


CONCERN = Concern("routes", OPTIONS, lambda module, memory: RoutesRun(module.params, memory), "routes")
