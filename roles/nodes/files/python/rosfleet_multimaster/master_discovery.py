# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The node master_discovery: the other masters, and the state of the own roscore.

`python3 -m rosfleet_multimaster.master_discovery [--parameters FILE.json] [name:=value ...]`
"""

import urllib.parse
from typing import Any, Dict, List, Optional, Tuple

from .discovery.contacts import Contacts, ask_time
from .discovery.core import report
from .discovery.core.actions import Ask, MasterEvent, Say, Send
from .discovery.core.discovery import Discovery
from .discovery.core.health import Health, LinkList
from .discovery.core.outsiders import Outsider
from .discovery.core.peer import FAR, Contact, Key
from .discovery.datagrams import DatagramCallbacks, Datagrams
from .discovery.poller import Poller
from .discovery.rpc_methods import UNREAD, RpcMethods, ServedMaster
from .discovery.source import Source, StateFollower, start_source_thread
from .discovery.state_feed import StateFeed
from .discovery.udp import Datagram
from .edge import local_roscore, ros
from .edge.addresses import networks
from .edge.clock import monotonic, wall_clock
from .edge.display import Display
from .edge.loop import DirectRunner, RecurringJob, Workers
from .edge.process import memory, program
from .edge.process.systemd import notify
from .edge.roscore import Roscore
from .edge.rpc_server import callers, serve
from .protocol import metrics, parameters
from .protocol.differences import Stamps
from .protocol.filters import InvalidPattern, secret_names
from .protocol.graph import ExportPolicy, State
from .protocol.members import Members, Networks
from .protocol.messages import AnnouncedMaster, DiagnosticEntry
from .protocol.mirror import Mirror
from .protocol.parameters import Settings

LOOKS = {True: 30.0, False: 1.0}  # seconds between two looks at the addresses, if the kernel reports changes or not
#: seconds from a change of own nodes to its announcement, and of foreign nodes: changes come in bursts
SETTLE, SETTLE_OTHERS = 0.02, 5.0
LOOK_AGAIN = 0.1  # seconds between two looks at the addresses at least, however much changes


class MasterDiscovery:
    """The program: input of its parts goes to the core, and actions of the core to the parts."""

    def __init__(self, start: local_roscore.Start) -> None:
        values, self.loop, self.ended, self.roscore = start.values, start.loop, start.ended, start.roscore
        self.limited = program.LimitedLog()
        self.clock_questions = Workers(self.loop, 1)
        self.errors: Dict[str, str] = {}  # the answer of masterErrors
        self.node: Optional[ros.DiscoveryNode] = None
        self.masters: Tuple[AnnouncedMaster, ...] = ()
        self.outsiders: Tuple[Outsider, ...] = ()  # who is ignored
        self.listed: Dict[str, AnnouncedMaster] = {}
        self.status = ""
        self.looked = 0.0  # when the addresses were looked at
        self.shown: Optional[float] = None  # the local stamp with which the own master is shown,
        self.show_due: Optional[float] = None  # or will be then
        self.network_problem = ""
        self.malformed_requests = 0
        self.members = Members.from_parameters(values)
        self.own = _make_own_master(start)
        self.roscore.ask(("setParam", "/mastername", self.own.name))
        resolvers = Workers(self.loop, 2)
        heard = DatagramCallbacks(
            self._on_datagram, self._on_address_change, self._on_sockets_open, self._on_network_change
        )
        self.datagrams = Datagrams(values, self.loop, resolvers, self.limited, self.errors, heard)
        settings = {name: value for name, value in values.items() if name in Settings.__dataclass_fields__}
        self.core = Discovery(Settings(**settings), (), self.own.rpc_port, self.members)
        asking = (self.listed.__contains__, self.core.local.may_ask, self._on_contact)
        self.contacts = Contacts(self.loop, resolvers, self.limited, self.errors, *asking)
        self.address_looks = RecurringJob(
            DirectRunner(), lambda: LOOKS[self.datagrams.hears_of_changes], self._look_at_addresses
        )
        self.health = Health(self.own.uri, self.members)
        node, shown = (self.own.uri, self.own.node), (self._entries, self._samples)
        self.display = Display(values, *node, self.loop, self.limited, *shown)
        self.reports = RecurringJob(DirectRunner(), lambda: 1.0, self._report, early=0.5)
        self.identity = local_roscore.Identity()
        self.source = _source(start, self.own, self.identity)
        rules = callers(self.members, self.own.uri, self.core.local.is_own)
        self.changes = StateFeed(self.own.current, robot_at=rules.robot)
        self.served = self._make_served(values)
        self.datagrams.start()  # there may be no network yet
        self._look_at_networks()
        self.server = serve(
            values["rpc_addr"], self.own.rpc_port, self.served.methods(), self._on_malformed_request, rules
        )

    def _make_served(self, values: Dict[str, Any]) -> RpcMethods:
        return RpcMethods(
            self.own,
            ExportPolicy.from_parameters(values),
            self.errors,
            self.core.local.is_own,
            lambda: self.source.do_not_sync,
            ros.md5sum,
            lambda: self.outsiders,
            self.changes if values["differences"] else None,
        )

    def run(self) -> int:
        """Run until the end; the exit status."""
        program.on_signals(self.loop, self._end)
        start_source_thread(self.source, self.loop, self.ended, self._on_state, self._on_roscore_failure)
        self.loop.run(self._tick)
        return self._finish()

    # The loop

    def _tick(self, now: float) -> float:
        """One pass: do all that is due, and carry out whatever the core wants since the last pass."""
        seconds = [self.address_looks.tick(now), self.reports.tick(now)]
        self.datagrams.tick(now)
        if self.show_due is not None and now >= self.show_due:
            self._show_own(now)
        self.core.tick(now)
        self._carry_out()
        if self.datagrams.problem != self.network_problem:
            self.network_problem = self.datagrams.problem
            self._say_status()
        # Asked last: an action of this pass may have closed the sockets.
        due = [*seconds, self.core.next_tick(), self.datagrams.tick(now), self.show_due]
        return min(time for time in due if time is not None)

    def _carry_out(self) -> None:
        """Carry out the actions of the core. Nothing else does, and `_tick` runs after the callbacks of the loop.

        Callbacks that cannot wait for it call this themselves: before the sockets may close, and before READY.
        """
        events = False
        while self.core.actions:
            action = self.core.actions.popleft()
            if isinstance(action, Send):
                self.datagrams.send(action)
            elif isinstance(action, Ask):
                self.contacts.ask(action)
            elif isinstance(action, MasterEvent):
                if not events:  # before it is announced: who then asks for the list has it there
                    events, self.masters = True, tuple(self.core.view.masters())
                self._event(action)
            elif isinstance(action, Say):
                self.limited.say(action.level, action.topic, action.text)
        if events:
            self.loop.post(self._say_status)

    def _event(self, event: MasterEvent) -> None:
        master, before = event.master, self.listed.get(event.master.uri)
        self.listed[master.uri] = master
        self.health.take_event(event.change, before, master)
        self.display.mark_stale()
        if event.change == "removed":
            del self.listed[master.uri]
            self.errors.pop(master.uri, None)
        if event.change == "new":
            program.LOG.info(
                "%s is there: its master is %s, its discovery answers at %s",
                master.name,
                master.uri,
                master.monitor_uri,
            )
        elif event.change == "removed":
            program.LOG.info("%s is gone", master.name)
        elif before is not None and before.online != master.online:
            program.LOG.info("%s is %s", master.name, "online again" if master.online else "offline")
        if self.node is not None:
            self.node.publish_change(event.change, master)

    def _say_status(self) -> None:
        online = [master.name for master in self.masters if master.online]
        offline = [master.name for master in self.masters if not master.online]
        shown = f"{len(online)} master{'s' if len(online) != 1 else ''}: {', '.join(online)}" if online else "no master"
        away = f"offline: {', '.join(offline)}" if offline else ""
        text = "; ".join(filter(None, (shown, away, self.datagrams.problem)))
        if text != self.status:
            self.status = text
            notify(f"STATUS={text}")

    def _report(self) -> None:
        before, self.outsiders = self.outsiders, tuple(self.core.outsiders.list_ignored())
        if self.node is None:
            return
        self.node.links(self.own.name, lambda: self.core.view.links(monotonic()), wall_clock())
        asked = self.health.question(self.masters, monotonic()) if self.display.has_outputs else None
        if asked is not None:
            ask_time(asked, self.clock_questions, self.health)
        if self.outsiders != before:
            self.display.mark_stale()
        self.display.look()

    def _links(self) -> LinkList:
        return self.health.links(self.masters, self.core.view.links(monotonic()))

    def _entries(self) -> List[DiagnosticEntry]:
        """The entries of /diagnostics."""
        own = report.roscore(self.own.uri, self.own.away, self.source.refusal_counts)
        return [own, *report.links(self._links()), report.outsiders(self.outsiders)]

    def _samples(self) -> metrics.Samples:
        return {
            **metrics.scalar_samples(
                roscore_up=not self.own.away,
                strangers_ignored=len(self.outsiders),
                datagrams_sent_total=self.datagrams.sent,
                datagrams_received_total=self.datagrams.received,
                changes_sent_total=self.served.changes.value,
                sent_bytes_total=self.server.sent.value,
            ),
            "malformed_total": {
                ("datagram",): self.core.malformed,
                ("request",): self.malformed_requests,
            },
            **report.link_samples(self._links()),
        }

    def _look_at_addresses(self) -> None:
        self._carry_out()  # first: a look may close the sockets, and the datagrams to send would be lost
        self.datagrams.look_at_addresses()
        self._look_at_networks()
        self.looked = monotonic()

    def _look_at_networks(self) -> None:
        try:
            self.core.take_networks(Networks(networks()))
        except OSError:  # the kernel is busy: in a second again
            pass

    def _on_network_change(self) -> None:
        """Look soon, but not more often than the kernel can be asked without harm."""
        self.address_looks.due = min(self.address_looks.due, self.looked + LOOK_AGAIN)

    # Input of the parts

    def _on_datagram(self, datagram: Datagram, now: float) -> None:
        self.core.datagram(datagram.data, datagram.source, datagram.multicast, now)

    def _on_address_change(self) -> None:
        self.core.take_addresses(self.datagrams.own_addresses)
        self._carry_out()

    def _on_sockets_open(self, now: float) -> None:
        self._on_address_change()
        self.core.announcements.greet(now)
        self._show_own(now)

    def _on_contact(self, key: Key, contact: Optional[Contact], problem: str, gone: bool, fault: bool) -> bool:
        if contact is not None and contact.uri == self.own.uri:  # perhaps this node itself, at a new address
            self._look_at_addresses()
        return self.core.take_contact(key, contact, problem, monotonic(), gone=gone, fault=fault)

    def _on_state(self, state: State, do_not_sync: Any = None) -> None:
        if self.own.away and self.own.state is not None:
            program.LOG.info("the roscore answers again")
        self.own.state, self.own.away = state, ""
        try:
            secret_names(do_not_sync)
        except InvalidPattern as problem:
            self.limited.say(
                "warning", "do_not_sync", f"other robots get no announcements until this is corrected: {problem}"
            )
        self.changes.update(state, do_not_sync)
        if self.node is None or self.shown is None:
            self._show_own(monotonic())
        else:  # followers are served first: the rest can wait for further changes
            settle = SETTLE if state.local_stamp != self.shown else SETTLE_OTHERS
            self.show_due = min(self.show_due or FAR, monotonic() + settle)
        if self.node is None:
            self.node = ros.DiscoveryNode(
                lambda: self.masters, lambda: self.loop.post(lambda: self.core.refresh(monotonic()))
            )
            self.display.open(ros.Diagnostics)
            self.identity.service = self.node.service_uri()
            memory.freeze()
            notify("READY=1")
            self.loop.post(self._say_status)

    def _show_own(self, now: float) -> None:
        self.show_due = None
        master = self.own.announce(self.datagrams.place[0])
        self.shown = None if master is None else master.local_stamp
        if master is not None:
            self.core.take_own_state(master, now)
            self._carry_out()  # at once: who sees READY=1 or the node finds the own master

    def _on_roscore_failure(self, problem: str, since: float) -> None:
        """Nothing of a dead roscore is announced or served; but one that fails once is not dead."""
        if self.core.note_silent_roscore(since, monotonic()):
            if self.own.away in ("", UNREAD):  # once for each time that it does not answer
                program.LOG.error("the roscore at %s does not answer: %s", self.roscore.rpc.uri, problem)
                notify(f"STATUS=the roscore at {self.roscore.rpc.uri} does not answer")
                self.status = ""
            self.shown = None
            self.own.away = f"its roscore does not answer: {problem}"
            self.display.mark_stale()

    def _on_malformed_request(self, host: str, why: str) -> None:
        def count() -> None:
            self.malformed_requests += 1
            self.limited.say("warning", "malformed request", f"a request from {host} is ignored: {why}")

        self.loop.post(count)

    # The end

    def _end(self) -> None:
        notify("STOPPING=1", "STATUS=leaving")
        self.loop.stop()

    def _finish(self) -> int:
        self.ended.set()
        program.leave_after(5.0)
        self.server.stop()  # first: a node that still answers must not count as gone
        self.core.announcements.leave()
        self._carry_out()
        self.display.end()
        program.LOG.info("left")
        ros.stop("the service ends")
        return 0


def _make_own_master(start: local_roscore.Start) -> ServedMaster:
    port = start.values["rpc_port"] or (urllib.parse.urlsplit(start.roscore.rpc.uri).port or 11311) + 300
    return ServedMaster(start.uri, start.values["name"] or ros.master_name(start.uri), start.name, ros.hostname, port)


def _source(start: local_roscore.Start, own: ServedMaster, identity: local_roscore.Identity) -> Source:
    """The states of the own master, by connections of their own."""
    stamps, of, (uri, caller) = Stamps(), (own.uri, own.name), (start.roscore.rpc.uri, start.roscore.caller)
    poller = Poller(Roscore(uri, caller), State(*of), identity, ros.sync_info, stamps)
    period = 1.0 / start.values["rosmaster_hz"]
    return Source(poller, lambda: StateFollower(uri, caller, Mirror(*of), identity, stamps), period)


def main() -> int:
    """Start, run, end."""
    return MasterDiscovery(local_roscore.begin(ros, "master_discovery", parameters.DISCOVERY, __doc__ or "")).run()


if __name__ == "__main__":
    program.run(main)
