# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""A roscore that reports, remembers and guards: rosmaster in this process, and rosout as another one.

    python3 -m rosfleet_multimaster.roscore --port 11311 --store ~/.ros/roscore
    python3 -m rosfleet_multimaster.roscore --store ~/.ros/roscore --forget

It reports changes to local programs (rosfleetChanges). It keeps registrations, topic types and parameters in a store, and comes
back with them. No node of another robot takes a name from an own one. docs/understand/roscore.md says more.
"""

import argparse
import os
import sys
import uuid
from functools import partial
from typing import List, Optional

from ..edge import addresses, journal
from ..edge.loop import Loop, Workers, start_thread
from ..edge.process import memory, program, systemd
from ..protocol import imports
from ..protocol.plain_text import quote
from . import core_services, master, store
from .changes import Changes
from .core.bounds import refuse
from .core.registry import KEPT, Record, Registry
from .core.store_format import Content
from .refusals import Refusals
from .robots import Robots
from .survivors import THREADS, Survivors, find_alive

WATCHED = (imports.IMPORTS, "/do_not_sync")  # parameters whose changes are reported
SIM_TIME = "/use_sim_time"
SOCKET = "roscore"  # the name of the socket that systemd holds
BOOT_PATIENCE = 2.0  # seconds for nodes on other computers to answer after a boot of this one


class RoscoreProgram:
    """The wiring of the program."""

    def __init__(self, options: argparse.Namespace) -> None:
        self._options, self._loop = options, Loop()
        self._workers = Workers(self._loop, THREADS, 1 << 16)
        self._refusals = Refusals(self._report)
        callbacks = master.Callbacks(self._on_changes, self._look_after, self._wait)
        self._master = master.MasterMethods(WATCHED, callbacks, self._refusals)
        self._robots = Robots(options.members, self._master.set_robots)
        self._changes = Changes(
            uuid.uuid4().hex,
            self._master.ps_lock,
            lambda: [*self._master.records(), *self._master.parameters(), *self._refusals.records()],
            self._master.caller,
        )
        self._store: Optional[store.Store] = None
        self._rosout = core_services.Rosout(
            lambda name: str(self._master.call("lookupNode", core_services.CALLER, name)[2])
        )
        self._survivors = Survivors(self._workers, self._master)
        self._late: Optional[Registry] = None  # nodes of other computers, which may have survived a boot of this one
        self._uri, self._shown = "", ""
        self._settled = False

    def run(self) -> None:
        """Serve until a signal."""
        journal.quiet("rosmaster", "rosgraph", "xmlrpc")
        snapshot = store.read(self._options.store) if self._options.store else None
        before = self._restore(snapshot)
        memory.freeze()
        if self._options.store:
            self._store = store.Store(self._options.store, self._master.ps_lock, self._master.parts)
            self._store.start(snapshot)
        core_services.set_run_id(self._master.call)
        self._serve()
        if before is not None:
            self._master.notify_all()
            self._survivors.begin(before.exclude(self._master.guard.is_import))
        if self._late is not None:
            self._survivors.wait_for(self._late)
        start_thread("versions", partial(core_services.set_versions, self._master.call))
        program.on_signals(self._loop, self._end)
        program.on_request(partial(self._loop.post, self._forget))
        self._loop.run(self._tick)
        self._rosout.end()
        if self._store is not None:
            self._store.sync()

    def _tick(self, now: float) -> float:
        if self._master.done:  # by a call of `shutdown`
            self._end()
        if not self._settled and self._options.store:
            store.clear_starts(self._options.store)
        self._settled = True
        with self._master.ps_lock:  # the watchdog is to see a lock that is never given back
            pass
        self._say_status()
        self._refusals.tick(now)
        self._robots.look(now)
        return self._rosout.tick(now) if self._options.rosout else now + 0.5

    def _say_status(self) -> None:
        silent = self._survivors.silent
        text = f"serving at {self._uri}{f'; nodes from before that have not answered yet: {silent}' if silent else ''}"
        if text != self._shown:
            self._shown = text
            systemd.notify(f"STATUS={text}")

    def _look_after(self, name: str, uri: str) -> None:
        """Look after a node that has withdrawn everything. The survivors are made after the master."""
        self._survivors.look_after(name, uri)

    def _on_changes(self, records: List[Record]) -> None:
        """Hand on the changes of one call; the lock of the registrations is held."""
        if self._store is not None:
            self._store.add([record for record in records if record.kind in KEPT])
        self._changes.add(records)
        for record in records:
            if record.kind == "refused":
                text = f"the node {quote(record.name)} at {quote(record.uri)} is refused: {record.value}"
                self._refusals.say(f"{[record.name, record.uri]}", text)

    def _wait(self) -> None:
        if self._store is not None and not self._store.wait():
            raise refuse("under way", "the changes of now, with those of others,")

    def _report(self, records: List[Record]) -> None:
        """Send the followers something that is no change of the registrations."""
        with self._master.ps_lock:
            self._changes.add(records)

    # The start

    def _restore(self, snapshot: Optional[Content]) -> Optional[Registry]:
        """Give the master the knowledge of an earlier life that counts. Raises Fatal, and the next start knows nothing."""
        if snapshot is None:
            return None
        try:
            same_boot = snapshot.boot == store.read_boot_id()
            before = snapshot.registry if same_boot else self._find_survivors(snapshot.registry)
            if before is not None:
                self._master.restore(before)
        except Exception as problem:
            store.set_aside(self._options.store, "the roscore cannot come back with it")
            raise program.Fatal(f"the kept state cannot be used: {type(problem).__name__}: {problem}") from None
        return before

    def _find_survivors(self, registry: Registry) -> Optional[Registry]:
        """The nodes of other computers that live on after a boot of this one, with the other known ones; None without any.

        There may be no network yet: a node that answers later is registered again then.
        """
        claims = imports.read(registry.parameter(imports.IMPORTS)).claims
        here = addresses.local_uris(registry.values("node").values(), BOOT_PATIENCE)
        others = registry.exclude(lambda node, uri: (node, uri) in claims or uri in here)
        alive = find_alive(others, BOOT_PATIENCE)
        self._late = others.exclude(lambda node, uri: (node, uri) in alive)
        if not alive:
            program.LOG.info("this computer was started since: nothing from before counts")
            return None
        survivors = others.exclude(lambda node, uri: (node, uri) not in alive)
        for name in (SIM_TIME, imports.IMPORTS):
            survivors.apply(Record("delete", name))
        return survivors

    def _serve(self) -> None:
        sockets = systemd.restore_sockets(SOCKET)
        more = {"rosfleetChanges": self._changes.answer, **core_services.roslaunch_methods(self._rosout)}
        try:
            uri, listening = master.serve(self._master, self._options.port, sockets, more, self._robots.at)
        except (OSError, ValueError, OverflowError) as problem:  # also of a wrong ROS_IP, or of no port
            raise program.Fatal(f"the roscore cannot listen at port {self._options.port}: {problem}") from None
        if listening not in sockets:
            systemd.store_socket(SOCKET, listening)
        core_services.set_uri(self._master.call, uri)
        self._uri = uri
        systemd.notify("READY=1")
        self._say_status()
        program.LOG.info("the roscore serves at %s", uri)

    # The end

    def _end(self) -> None:
        systemd.notify("STOPPING=1")
        self._loop.stop()

    def _forget(self) -> None:
        """End, and know nothing afterwards."""
        program.LOG.info("everything is forgotten, as it was asked for: starting afresh")
        self._rosout.end()
        with self._master.ps_lock:  # nothing is added any more
            _forget_at_once(self._options.store)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        "roscore.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-p", "--port", type=int, default=11311)
    parser.add_argument("--store", metavar="FOLDER", default=os.environ.get("STATE_DIRECTORY", ""), help="kept there")
    parser.add_argument(
        "--members", metavar="FILE", default="", help="parameters of master_discovery: which robot has which computers"
    )
    parser.add_argument("--forget", action="store_true", help="remove the kept state, and end")
    parser.add_argument("--no-rosout", dest="rosout", action="store_false", help="another program starts rosout")
    return parser.parse_args([word for word in sys.argv[1:] if ":=" not in word])


def main() -> int:
    """Run the roscore; the exit status."""
    options = _options()
    if options.forget:
        try:
            there = bool(options.store) and store.forget(options.store)
            program.LOG.info("forgotten" if there else "nothing was kept")
        except OSError as problem:
            raise program.Fatal(f"the kept state in {options.store} cannot be removed: {problem}") from None
        return 0
    # Also until the loop runs: a store may be the reason that it never does.
    program.on_request(partial(_forget_at_once, options.store))
    RoscoreProgram(options).run()
    return 0


def _forget_at_once(folder: str) -> None:
    """End, and know nothing afterwards."""
    if folder:
        store.forget(folder)
    program.leave_process(0)


if __name__ == "__main__":
    program.run(main)
