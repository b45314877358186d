# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Routes of ours: one run of the module, over the kernel's routes and what brings them back at boot.

The kernel comes first, then the boot part, so a manager that is told about a route finds it there. The record of what is
ours is on disk before either: whatever ends a run, the next one finds what it needs to mend it.
"""

import os
import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._changes import atomic
from ansible_collections.rosfleet.multimaster.plugins.module_utils._changes.difference import difference
from ansible_collections.rosfleet.multimaster.plugins.module_utils._changes.record import Record
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.problem import Problem, sentence
from ansible_collections.rosfleet.multimaster.plugins.module_utils._routes import plan
from ansible_collections.rosfleet.multimaster.plugins.module_utils._routes.kernel import (
    DEFAULTS,
    Kernel,
    Route,
    command,
)
from ansible_collections.rosfleet.multimaster.plugins.module_utils._routes.managers import contract
from ansible_collections.rosfleet.multimaster.plugins.module_utils._routes.managers.table import (
    BACKENDS,
    NONE,
    Boot,
    Choice,
)
from ansible_collections.rosfleet.multimaster.plugins.module_utils._routes.plan import Entry, name_of

RUN_TIME = "routes at run time"
# Protocols of routes that managers make from their configuration; a person's `ip route add` gives "boot".
_CONFIGURED = ("static", "dhcp", "ra")
# Routes that others than us bring back by themselves, if a manager has dropped them.
_RETURNING = ("kernel", "dhcp", "ra", "redirect")


class Run:
    """One run of the module: looks at the machine and plans, then applies the plan or says what stands against it."""

    def __init__(
        self, options: typing.Mapping[str, typing.Any], memory: typing.Optional[typing.Dict[str, typing.Any]] = None
    ) -> None:
        """`memory` is that of an earlier run that changed the run time alone. Changes nothing.

        Raises Problem for options, files or a record that cannot be used.
        """
        for option in ("root", "records"):
            if not os.path.isabs(options[option]):
                raise Problem("%s is %r, expected an absolute path." % (option, options[option]))
        self.machine = contract.machine(options["root"])
        self.overrides = _overrides(options["backends"] or {}, self.machine.interfaces)
        items = plan.items_of(options["routes"], self.machine.interfaces)
        self.record = Record("routes", options["records"])
        self.stored = self.record.load()
        self.recorded = self.stored if memory is None else memory
        try:
            self.entries = _entries(self.recorded.get("routes", []))
            boot = self.recorded.get("boot", {})
            for entry in boot.get("places", {}).values():
                dict.fromkeys((entry["backend"], *entry["texts"], *map(str, entry["routes"])))
        except (AttributeError, IndexError, KeyError, TypeError, ValueError) as problem:
            raise Problem(
                "The record %s does not hold what this version of the module writes (%s); restore it from a backup, or remove "
                "it and what it owned by hand." % (self.record.path, type(problem).__name__)
            ) from problem
        self.kernel = Kernel()
        self.keys = [item.route.key for item in items] + list(self.entries)
        self.current = self._read()
        plan.check_usable(items, self.machine.interfaces, self.current)
        self.routes = [item.route for item in items]
        replace = options["on_conflict"] == "replace"
        self.plan = plan.plan(self.routes, self.current, self.entries, replace, self.machine.interfaces)
        self.boot = Boot(self.machine, options["root"], self.recorded.get("boot", {}))
        self.boot_begun = False
        self.items = self._items([self._carried(item, items) for item in items])

    def _read(self) -> plan.Current:
        """Everything in the tables that we have to do with."""
        current: plan.Current = {}
        for version, table in sorted({(key[0], key[2]) for key in self.keys}):
            for held in self.kernel.read(version, table):
                current.setdefault(held.route.key, []).append(held)
        return current

    def _carried(self, item: plan.Item, items: typing.List[plan.Item]) -> plan.Item:
        """A route without a device comes back with that of another route of the list, else of the default route."""
        if item.carrier:
            return item
        held = [held.route for there in self.current.values() for held in there]
        devices = [other.carrier for other in items if other.backend != NONE]
        devices += [route.device for route in held if route.destination in DEFAULTS.values()]
        devices += sorted(name for name, link in self.machine.interfaces.items() if link.up and not link.loopback)
        return item._replace(carrier=next((device for device in devices if device), ""))

    def _items(self, items: typing.List[plan.Item]) -> typing.List[typing.Dict[str, typing.Any]]:
        """Plans the boot part; what the module returns per route."""
        chosen = [self.boot.backend_of(item, self.overrides) for item in items]
        choice: Choice = {}
        for item, name in zip(items, chosen):
            if name != NONE:
                choice.setdefault(name, {}).setdefault(item.carrier, []).append(item.route)
        self.boot.want(choice)

        found = []
        for item, name, result in zip(items, chosen, self.plan.results):
            place = self.boot.place(name, item.carrier)
            state, problem = result["state"], result["problem"]
            maker = self._maker(item.route) if name != NONE else None
            if maker:
                state, problem = "refused", maker
            elif state == "ok" and self.boot.is_new(name, place, item.route):
                state = "changed"
            found.append(
                {
                    "destination": name_of(item.route.destination),
                    "gateway": item.route.gateway or None,
                    "device": item.route.device or None,
                    "metric": item.route.metric,
                    "table": item.route.table,
                    "source": item.route.source or None,
                    "on_link": item.route.on_link,
                    "type": item.route.type,
                    "backend": name,
                    "before": result["before"],
                    "after": result["after"],
                    "boot_file": place,
                    "changed": state == "changed",
                    "state": state,
                    "problem": problem,
                }
            )
        return found

    def _maker(self, route: Route) -> typing.Optional[str]:
        """The sentence for somebody else's route that a manager would make again at boot, beside ours."""
        made = {other.way for other in self.entries.get(route.key, Entry((), ())).made}
        for held in self.current.get(route.key, []):
            if held.protocol in _CONFIGURED and held.route.way not in made | {route.way}:
                owner = self.boot.owner(held.route.device)
                if owner and not self.boot.ends[owner].has_last_word:
                    return (
                        "routes: %s: '%s' comes from %s, which would make it again at the next boot, beside this one: remove "
                        "it from the configuration of %s, or give this one another metric."
                        % (plan.text_of(route), held.text, owner, held.route.device)
                    )
        return None

    # What it comes to

    @property
    def refused(self) -> typing.List[str]:
        """One sentence per route that stands against others' routes."""
        return [item["problem"] for item in self.items if item["problem"]]

    @property
    def conflicts(self) -> typing.List[str]:
        """The sentences of the conflicts that on_conflict decides."""
        return [item["problem"] for item in self.items if item["state"] == "conflict"]

    @property
    def other_defaults(self) -> typing.List[typing.Dict[str, typing.Any]]:
        """Default routes of others that stay beside ours."""
        staying = [held for key, there in self.current.items() if key not in self.plan.after for held in there]
        return [
            {
                "destination": name_of(held.route.destination),
                "gateway": held.route.gateway or None,
                "device": held.route.device or None,
                "metric": held.route.metric,
                "table": held.route.table,
                "protocol": held.protocol,
                "text": held.text,
            }
            for held in plan.other_defaults(self.routes, staying)
        ]

    @property
    def runtime_changes(self) -> bool:
        """Whether the kernel's routes change."""
        return bool(self.plan.changes)

    @property
    def changed(self) -> bool:
        """Whether anything changes: routes, places of the boot part, or what an ended run has left undone."""
        return self.runtime_changes or bool(self.boot.changes)

    @property
    def difference(self) -> typing.List[typing.Dict[str, str]]:
        """The routes and the files that change, for `diff`; of the routes those that the kernel did not make."""
        before, after = [], []
        for key in set(self.current) | set(self.plan.after):
            texts = [held.text for held in self.current.get(key, []) if held.protocol != "kernel"]
            before += texts
            after += self.plan.after.get(key, texts)
        lines = [("".join(line + "\n" for line in sorted(texts))).encode("utf-8") for texts in (before, after)]
        routes = [difference(RUN_TIME, lines[0], lines[1])] if lines[0] != lines[1] else []
        return routes + self.boot.difference

    # How

    @property
    def memory(self) -> typing.Dict[str, typing.Any]:
        """What the run after `apply_runtime` has to know: the record as it has to be while the change is on its way."""
        return _data(self.plan.interim, self.recorded.get("boot", {}))

    def undo_commands(self) -> typing.List[typing.List[str]]:
        """Commands that bring the kernel's routes back to what they were when this run looked, also from half way."""
        return [plan.undo_command(change) for change in self.plan.undo]

    def undo_files(self) -> typing.List[typing.Tuple[str, typing.Optional[bytes]]]:
        """What goes with it: no file, since `apply_runtime` writes none."""
        return []

    def apply_runtime(self) -> None:
        """Change the kernel's routes alone. Raises Problem, with everything as it was before."""
        self._guarded(self._change_kernel)

    def apply(self) -> None:
        """Change what is not yet as planned, the kernel first. Raises Problem, with everything as it was before."""
        self._guarded(self._announce, self._change_kernel, self._change_boot)

    def _guarded(self, *steps: typing.Callable[[], None]) -> None:
        try:
            for step in steps:
                step()
        except (OSError, Problem) as problem:
            failures = self._take_back()
            end = "Not put back: %s." % ", ".join(failures) if failures else "Everything is as it was before."
            raise Problem("%s %s" % (sentence(problem), end)) from problem

    def _announce(self) -> None:
        """Have the record on disk before the first change."""
        if self.plan.changes:
            self._remember(self.memory)

    def _change_kernel(self) -> None:
        for change in self.plan.changes:
            self._do(change)
        if self.plan.changes:
            self._expect()
            self._look_for_given_back()

    def _look_for_given_back(self) -> None:
        """Whose gateway or interface is no longer there, cannot be given back, and keeps nothing from being removed."""
        restored = [item for item in self.plan.taken_back if item["state"] == "restored"]
        if not restored:
            return
        now = {held.text for there in self._read().values() for held in there}
        for item in restored:
            if item["after"] not in now:
                item.update(state="lost")

    def _change_boot(self) -> None:
        if self.boot.changes:
            self._remember(_data(self.plan.interim, self.boot.interim()))
            before = self._read()
            self.boot_begun = True
            self.boot.apply()
            self._settle(before)
        self._remember(_data(self.plan.final, self.boot.memory()))

    def _do(self, change: plan.Change) -> None:
        try:
            self.kernel.change(change.verb, change.version, change.words)
        except Problem:
            if not change.may_fail:
                raise

    def _settle(self, before: plan.Current) -> None:
        """Give back what a manager has dropped all the same when it was told."""
        after = self._read()
        for key, there in before.items():
            for held in there:
                if held.protocol not in _RETURNING and key not in after:
                    self._do(plan.Change("replace", key[0], held.words))
        self._expect()

    def _expect(self) -> None:
        """Raises Problem where the kernel does not hold what was planned."""
        now = self._read()
        for route, item in zip(self.routes, self.items):
            there = now.get(route.key, [])
            same = [held for held in there if held.route.way == route.way]
            if not same:
                raise Problem(
                    "routes: %s: the kernel holds %s afterwards, expected this route: something else changes it at the same "
                    "time." % (plan.text_of(route), " and ".join("'%s'" % held.text for held in there) or "nothing")
                )
            item["after"] = same[0].text
            for held in there:  # kernels differ in what replace leaves beside a route of IPv6
                if held not in same:
                    self._do(plan.remove(held))

    def _take_back(self) -> typing.List[str]:
        """Everything as it was when this run looked; returns what could not be put back."""
        failures = self.boot.undo() if self.boot_begun else []
        for change in self.plan.undo:
            try:
                self._do(change)
            except Problem:
                failures.append("'%s'" % " ".join(command(change.verb, change.version, change.words)))
        if not failures:  # else the record keeps what the next run needs to mend it
            try:
                self._remember(self.stored)
            except OSError as problem:
                failures.append("the record %s (%s)" % (self.record.path, problem.strerror))
        return failures

    def _remember(self, data: typing.Dict[str, typing.Any]) -> None:
        atomic.remove_leftovers(self.record.path)
        if data != self.record.load():
            self.record.save(data)


def _data(entries: typing.Dict[plan.Key, Entry], boot: typing.Dict[str, typing.Any]) -> typing.Dict[str, typing.Any]:
    """The record's object."""
    routes = [
        {"made": [dict(route._asdict()) for route in entry.made], "replaced": [list(words) for words in entry.replaced]}
        for key, entry in sorted(entries.items())
    ]
    return {name: value for name, value in (("routes", routes), ("boot", boot)) if value}


def _entries(listed: typing.Iterable[typing.Mapping[str, typing.Any]]) -> typing.Dict[plan.Key, Entry]:
    """The record's routes by key."""
    entries = {}
    for item in listed:
        made = tuple(Route(**fields) for fields in item["made"])
        entries[made[0].key] = Entry(made, tuple(tuple(words) for words in item["replaced"]))
    return entries


def _overrides(backends: typing.Mapping[str, str], interfaces: typing.Container[str]) -> typing.Mapping[str, str]:
    """The option backends. Raises Problem for what is no interface or no back end."""
    names = ["auto"] + list(BACKENDS) + [NONE]
    for interface, name in backends.items():
        if interface not in interfaces:
            raise Problem("backends: there is no interface %s: correct or remove it." % interface)
        if name not in names:
            raise Problem("backends: %s has %r, expected one of %s." % (interface, name, ", ".join(names)))
    return backends
