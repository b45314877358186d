# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""A roscore that tells, remembers and guards: rosmaster in this process, and rosout beside it.

    python3 -m rosfleet_multimaster.roscore --port 11311 --store ~/.ros/roscore
    python3 -m rosfleet_multimaster.roscore --store ~/.ros/roscore --forget

It tells local programs what changed (rosfleetChanges), keeps registrations, topic types and parameters in a store, comes
back with them, and lets no node of another robot take a name from an own one. docs/understand/roscore.md says more.
"""

import argparse
import os
import sys
import uuid
from functools import partial
from typing import Any, List, Optional

from ..edge import addresses, journal
from ..edge.loop import Loop, Workers, start_thread
from ..edge.process import memory, program, systemd
from ..protocol import imports
from ..protocol.plain_text import quote
from . import core_services, master, store
from .changes import Changes
from .core.bounds import Refusal, refuse
from .core.registry import Record, Registry
from .refusals import Refusals
from .survivors import THREADS, Survivors, alive_of

WATCHED = (imports.IMPORTS, "/do_not_sync")  # parameters whose changes are told
SIM_TIME = "/use_sim_time"
SOCKET = "roscore"  # the name of the socket that systemd holds
BOOT_PATIENCE = 2.0  # seconds for nodes on other computers to answer after a boot of this one


class Roscore:
    """The wiring of the program."""

    def __init__(self, options: argparse.Namespace) -> None:
        self._options, self._loop = options, Loop()
        self._workers = Workers(self._loop, THREADS, 1 << 16)
        heard = master.Callbacks(self._hand_on, self._left, self._refused, self._not_ended, self._wait)
        self._master = master.Master(WATCHED, imports.IMPORTS, imports.claims_of, heard)
        self._changes = Changes(
            uuid.uuid4().hex,
            self._master.ps_lock,
            lambda: [*self._master.registered(), *self._master.parameters(), *self._refusals.records()],
            self._master.caller,
        )
        self._store: Optional[store.Store] = None
        self._rosout = core_services.Rosout(lambda name: str(self._call("lookupNode", core_services.CALLER, name)[2]))
        self._survivors = Survivors(self._workers, self._master)
        self._late: Optional[Registry] = None  # nodes of other computers, which may have survived a boot of this one
        self._status, self._uri, self._said = 0, "", ""
        self._settled = False
        self._refusals = Refusals(self._tell)

    def run(self) -> int:
        """Serve until a signal; the exit status."""
        journal.quiet("rosmaster", "rosgraph", "xmlrpc")
        found = store.read(self._options.store) if self._options.store else None
        before = self._restored(found)
        memory.freeze()
        self._keep_from_now_on(found)
        core_services.run_id(self._call)
        self._serve()
        if before is not None:
            self._master.tell_all()
            self._survivors.begin(before.exclude(self._is_import))
        if self._late is not None:
            self._survivors.wait_for(self._late)
        start_thread("versions", partial(core_services.versions, self._call))
        program.on_signals(self._loop, self._end)
        program.on_request(self._loop, self._forget)
        self._loop.run(self._tick)
        self._rosout.end()
        if self._store is not None:
            self._store.sync()
        return self._status

    def _tick(self, now: float) -> float:
        if self._master.done:  # somebody called `shutdown`
            self._end()
        if not self._settled and self._options.store:
            store.settled(self._options.store)
        self._settled = True
        with self._master.ps_lock:  # a lock that nobody gives back is what the watchdog is to see
            pass
        self._say_status()
        self._refusals.tick(now)
        return self._rosout.tick(now) if self._options.rosout else now + 0.5

    def _say_status(self) -> None:
        silent = self._survivors.silent
        text = f"serving at {self._uri}{f'; nodes from before that have not answered yet: {silent}' if silent else ''}"
        if text != self._said:
            self._said = text
            systemd.notify(f"STATUS={text}")

    def _call(self, method: str, *arguments: Any) -> Any:
        return self._master.call(method, *arguments)

    def _hand_on(self, records: List[Record]) -> None:
        """Hand on the changes of one call; the lock of the registrations is held."""
        if self._store is not None:
            self._store.add([record for record in records if record[0] not in ("refused", "parameter")])
        self._changes.add(records)
        for record in records:
            if record[0] == "refused":
                text = f"the node {quote(record[1])} at {quote(record[2])} is refused: {record[3]}"
                self._refusals.say(f"{record[1:3]}", text)

    def _left(self, name: str, uri: str) -> None:
        self._survivors.look_after(name, uri)

    def _refused(self, problem: Refusal) -> None:
        self._refusals.add(problem.bound, str(problem))

    def _wait(self) -> None:
        if self._store is not None and not self._store.wait():
            raise refuse("under way", "what is changed now, with what others change,")

    def _not_ended(self, name: str, uri: str) -> None:
        text = f"{quote(name)} at {quote(uri)} is not told to end: neither it nor its successor was registered from its computer"
        self._refusals.say("end", text)

    def _tell(self, records: List[Record]) -> None:
        """Tell who follows something that is no change of the registrations."""
        with self._master.ps_lock:
            self._changes.add(records)

    # The start

    def _restored(self, found: Optional[store.Found]) -> Optional[Registry]:
        """The knowledge of an earlier life, which the master has again. Raises Fatal where it cannot: the next start is afresh."""
        try:
            before = self._before(found)
            if before is not None:
                self._master.restore(before)
        except Exception as problem:
            store.give_up(self._options.store, "the roscore cannot come back with it")
            raise program.Fatal(f"what is kept cannot be used: {type(problem).__name__}: {problem}") from None
        return before

    def _before(self, found: Optional[store.Found]) -> Optional[Registry]:
        """The knowledge of an earlier life, as far as it counts."""
        if found is None:
            return None
        if not found.another_boot:
            return found.registry
        return self._after_boot(found.registry)

    def _after_boot(self, registry: Registry) -> Optional[Registry]:
        """Nodes of this computer are dead. If some of another one live on, what they know counts, and else nothing does.

        There may be no network yet: who answers later is registered again then.
        """
        claims = imports.claims_of(registry.parameter(imports.IMPORTS))
        here = addresses.local_uris(registry.nodes.values(), BOOT_PATIENCE)
        others = registry.exclude(lambda node, uri: (node, uri) in claims or uri in here)
        alive = alive_of(others, BOOT_PATIENCE)
        self._late = others.exclude(lambda node, uri: (node, uri) in alive)
        if not alive:
            program.LOG.info("this computer was started since: nothing from before counts")
            return None
        left = others.exclude(lambda node, uri: (node, uri) not in alive)
        for name in (SIM_TIME, imports.IMPORTS):
            left.apply(["delete", name])
        return left

    def _keep_from_now_on(self, found: Optional[store.Found]) -> None:
        if self._options.store:
            self._store = store.Store(self._options.store, self._master.ps_lock, self._master.parts)
            self._store.start(found)

    def _serve(self) -> None:
        held = systemd.restore_sockets(SOCKET)
        more = {"rosfleetChanges": self._changes.answer, **core_services.roslaunch_methods(self._rosout)}
        try:
            uri, listening = master.serve(self._master, self._options.port, held, more)
        except OSError as problem:
            raise program.Fatal(f"the roscore cannot listen at port {self._options.port}: {problem}") from None
        if listening not in held:
            systemd.store_socket(SOCKET, listening)
        core_services.parameters(self._call, uri)
        self._uri = uri
        systemd.notify("READY=1")
        self._say_status()
        program.LOG.info("the roscore serves at %s", uri)

    def _is_import(self, node: str, uri: str) -> bool:
        return bool(self._master.guard.is_import(node, uri))

    # The end

    def _end(self) -> None:
        systemd.notify("STOPPING=1")
        self._loop.stop()

    def _forget(self) -> None:
        """End, and know nothing afterwards."""
        program.LOG.info("everything is forgotten, as it was asked for: starting afresh")
        self._rosout.end()
        with self._master.ps_lock:  # nothing is added any more
            if self._options.store:
                store.forget(self._options.store)
            program.leave_process(0)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        "roscore.py", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("-p", "--port", type=int, default=11311)
    parser.add_argument("--store", metavar="FOLDER", default=os.environ.get("STATE_DIRECTORY", ""), help="kept there")
    parser.add_argument("--forget", action="store_true", help="remove what is kept, and end")
    parser.add_argument("--no-rosout", dest="rosout", action="store_false", help="somebody else starts rosout")
    return parser.parse_args([word for word in sys.argv[1:] if ":=" not in word])


def main() -> int:
    """Run the roscore; the exit status."""
    options = _options()
    if options.forget:
        try:
            there = bool(options.store) and store.forget(options.store)
            program.LOG.info("forgotten" if there else "nothing was kept")
        except OSError as problem:
            raise program.Fatal(f"what is kept in {options.store} cannot be removed: {problem}") from None
        return 0
    # Until the loop runs, too: what is kept may be why it never does.
    program.on_request_at_once(partial(_forget_at_once, options.store))
    memory.give_back()
    return Roscore(options).run()


def _forget_at_once(folder: str) -> None:
    """End, and know nothing afterwards."""
    if folder:
        store.forget(folder)
    program.leave_process(0)


if __name__ == "__main__":
    program.run(main)
