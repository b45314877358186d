# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The source of the own master's state: its roscore reports changes, or is polled.

The managed roscore reports changes: system.listMethods names rosfleetChanges(caller, epoch, revision, wait). Any other one
is polled (poller.py). After each failure, the roscore is asked again for its methods: it may be the other kind.
"""

from typing import Any, Callable, Optional
from xmlrpc.client import Fault

from ..edge.clock import monotonic, wall_clock
from ..edge.local_roscore import Identity
from ..edge.loop import EndFlag, Loop, start_thread
from ..edge.process import program
from ..edge.roscore import KNOWN
from ..edge.rpc_client import Rpc
from ..protocol import imports
from ..protocol.differences import Stamps
from ..protocol.graph import LOCAL, InvalidDocument, State
from ..protocol.mirror import CHANGES, REFUSED, Mirror
from ..protocol.plain_text import quote
from ..protocol.xml_rpc import STATE
from .core.pace import PollPace
from .poller import GET_SYNC_INFO, Poller

WAIT, TIMEOUT = 50.0, 10.0  # seconds that the roscore may wait for news, and seconds more for the answer
RETRY = 0.1  # seconds until a roscore that does not answer is asked again
AGAIN = 10.0  # the same after PollInstead: at its start, master_sync looks like another implementation


class PollInstead(Exception):
    """The answers of the roscore are not enough."""


class StateFollower:
    """The state, from the changes that the roscore reports."""

    def __init__(self, uri: str, caller: str, mirror: Mirror, identity: Identity, stamps: Stamps) -> None:
        self._rpc, self._caller = Rpc(uri, WAIT + TIMEOUT, STATE, own=True), caller
        self._mirror, self._identity, self._stamps = mirror, identity, stamps
        self.parameters = mirror.parameters  # those that the roscore reports

    def next(self) -> State:
        """The next state. Raises as Poller.poll, and PollInstead."""
        service = self._identity.service
        self._mirror.take_answer(self._rpc.call(CHANGES, self._caller, *self._mirror.position, WAIT, True))
        self._identity.check_service(service, self._mirror.service_uris.get(service[0]))
        record = imports.read(self.parameters.get(imports.IMPORTS))
        self._mirror.belong(record.claims)
        self._refuse_foreign(record)
        return self._stamps.stamp(self._mirror.state, wall_clock())

    def _refuse_foreign(self, record: imports.ImportRecord) -> None:
        """Leave other implementations of master_sync to the poller, which asks for their registrations."""
        ours = record.node if self._mirror.node_uris.get(record.node, "") == record.uri else None
        state = self._mirror.state
        for service, users in state.services.items():
            if service.endswith(GET_SYNC_INFO) and users[0] != ours and state.nodes[users[0]].locality == LOCAL:
                raise PollInstead(f"{quote(users[0])} synchronises, too")

    def close(self) -> None:
        """Close the connection."""
        self._rpc.close()


class Source:
    """The states of the own master, one after the other."""

    def __init__(self, poller: Poller, follower: Callable[[], StateFollower], period: float) -> None:
        """`period`: seconds between two polls at least."""
        self._poller, self._make, self._pace = poller, follower, PollPace(period)
        self._local_stamp = 0.0  # of the last state that was polled
        self._follower: Optional[StateFollower] = None
        self._known_until = 0.0  # until then the roscore is not asked if it reports changes
        self.pause = 0.0  # seconds until `next` is to be called again
        # Of the last state, also while the roscore does not answer: that state is served for a moment.
        self.do_not_sync: Any = None  # the parameter /do_not_sync
        self.refusal_counts: Any = None  # reason -> requests that the roscore refused; None if it does not report them

    def next(self) -> State:
        """The state, as soon as it is new, or after a while. Raises as Poller.poll."""
        self.pause = 0.0
        try:
            if self._follower is None and monotonic() >= self._known_until:
                self._follower = self._make() if self._poller.roscore.has(CHANGES) else None
                self._known_until = monotonic() + KNOWN
            if self._follower is not None:
                state = self._follower.next()
                self.do_not_sync, self.refusal_counts = map(self._follower.parameters.get, ("/do_not_sync", REFUSED))
                return state
        except (PollInstead, InvalidDocument, Fault) as problem:
            uri = self._poller.roscore.rpc.uri
            program.LOG.info("the roscore at %s is read instead of listened to: %s", uri, problem)
            self._drop()
            self._known_until = monotonic() + AGAIN
        except Exception:
            self._drop()
            self._known_until = 0.0  # the next roscore may be of the other kind
            raise
        return self._poll()

    def _poll(self) -> State:
        began, changed = monotonic(), False
        try:
            state = self._poller.poll()
            self.do_not_sync, self.refusal_counts = self._poller.do_not_sync, None
            before, self._local_stamp = self._local_stamp, state.local_stamp
            changed = before != state.local_stamp
            return state
        except Exception:
            self._known_until = 0.0
            raise
        finally:
            now = monotonic()
            self.pause = self._pace.pause(now, now - began, changed)

    def _drop(self) -> None:
        if self._follower is not None:
            self._follower.close()
        self._follower = None


def start_source_thread(
    source: Source,
    loop: Loop,
    ended: EndFlag,
    on_state: Callable[[State, Any], None],
    on_failure: Callable[[str, float], None],
) -> None:
    """Hand on states until `ended`, in a thread of its own. The callbacks are called in the loop.

    `on_state(state, do_not_sync)`; `on_failure(why, since)`: no answer of the roscore since then. A new roscore ends the program.
    """

    def follow() -> None:
        failing: Optional[float] = None
        before: Any = None
        secret: Any = None
        while not ended:
            started = monotonic()
            try:
                state = source.next()
                if state is not before or source.do_not_sync != secret or failing is not None:
                    before, secret = state, source.do_not_sync
                    loop.post(on_state, state, secret)
                failing = None
            except program.Fatal as problem:
                loop.post(program.give_up, str(problem))
                return
            except Exception as problem:  # no answer of the roscore, or nonsense
                if not isinstance(problem, program.FAILURES):
                    program.LOG.debug("the roscore's state cannot be read", exc_info=True)
                failing = (started if source.pause else monotonic()) if failing is None else failing
                loop.post(on_failure, str(problem) or type(problem).__name__, failing)
            ended.wait(RETRY if failing is not None else source.pause)

    start_thread("source", follow)
