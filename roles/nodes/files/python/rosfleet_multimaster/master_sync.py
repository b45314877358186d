# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The node master_sync: registers the topics and services of other masters in the own roscore, and withdraws them again.

`python3 -m rosfleet_multimaster.master_sync [--parameters FILE.json] [name:=value ...]`
"""

from collections import Counter
from typing import Dict, List, Optional, Set

from .edge import local_roscore, ros
from .edge.clock import monotonic
from .edge.display import Display
from .edge.loop import DirectRunner, RecurringJob, Workers
from .edge.process import memory, program
from .edge.process.systemd import notify
from .edge.roscore import RoscoreGraph
from .protocol import metrics, parameters
from .protocol.filters import Filters
from .protocol.members import Members
from .protocol.messages import AnnouncedMaster, DiagnosticEntry, Registration
from .protocol.plain_text import LINE
from .sync.copies import Copies
from .sync.core import report
from .sync.core.limits import limit_refusals
from .sync.core.sync import NEVER, RegistrationConflict, Sync
from .sync.disconnector import Disconnector
from .sync.fetcher import Fetcher
from .sync.finder import Finder
from .sync.rounds import ROUND, RoundCallbacks, Rounds
from .sync.type_questions import TypeQuestions

LINES = 50  # log lines about refusals at once
STATUS = 1.0  # seconds between two lines of status
OWN_SHARE, OWN_SLOWEST = 4, 2.0  # times as long as a round took, and seconds, it waits after a change of own nodes


class MasterSync:
    """The program: input of its parts goes to the core, and a change is followed by a round."""

    def __init__(self, start: local_roscore.Start) -> None:
        values, loop, self.limited = start.values, start.loop, program.LimitedLog()
        self.loop, self.ended = loop, start.ended
        self.uri, self.node_name = start.uri, start.name
        self.refusals: List[RegistrationConflict] = []  # in force
        self.refused_total: Counter[str] = Counter()  # kind -> how many since the start
        self.ready = False
        self.status, self.status_stale = "", False
        self.own_local_stamp = 0.0
        self.news: Dict[str, float] = {}  # URI of a master -> when discovery announced it, since the last list
        roscore_calls = Workers(loop, 1)  # everything that is asked of the own roscore, one after the other
        updaters = Workers(loop, 8)
        self.core = _core(start)
        online, graph, limited = self._online, RoscoreGraph(start.roscore), self.limited
        ending, members = values["end_lost_connections"], self.core.members
        self.disconnector = Disconnector(loop, updaters, limited, ending, members, online)
        questions = TypeQuestions(loop, self._monitor_of, ros.md5sum, self._request_round)
        node = (start.name, start.node_uri)
        callbacks = RoundCallbacks(lambda: self.finder.listed_once, self._round_over)
        self.rounds = Rounds(
            graph, node, self.core, questions, self.disconnector, roscore_calls, updaters, limited, callbacks
        )
        self.rounds.take_over()  # before the service says that this node synchronises
        planned, changed = values["sync_parameters"], self._on_parameters
        self.copies = Copies(loop, start.roscore, self.core, roscore_calls, limited, planned, changed)
        self.copies.take_over()
        self.node = ros.SyncNode(lambda: self.rounds.held)
        identity = local_roscore.Identity()
        identity.service = self.node.service_uri()
        self.health = local_roscore.RoscoreCheck(loop, start.roscore, identity, roscore_calls, self._request_round)
        masters = ros.ListMasters()
        self.finder = Finder(
            loop, graph, roscore_calls, limited, lambda: self.rounds.claims, masters, self._subscribe, self._on_list
        )
        self.fetcher = Fetcher(loop, self.core, limited, self._on_fetch, self._on_touch, values["differences"])
        self.states = RecurringJob(DirectRunner(), lambda: STATUS, self._say_status, wanted=lambda: self.status_stale)
        self.display = Display(values, self.uri, self.node_name, loop, limited, self._entries, self._samples)
        self.display.open(ros.Diagnostics)

    def run(self) -> int:
        """Run until the end; the exit status."""
        program.on_signals(self.loop, self._end)
        notify("STATUS=looking for master_discovery")
        self.loop.run(self._tick)
        ros.stop("the service ends")
        return 0

    # The loop

    def _tick(self, now: float) -> float:
        """One pass: do all that is due. The end of each action under way wakes the loop."""
        if self.ended:
            return now + 1.0
        due = [
            self.health.tick(now),
            *self.finder.tick(now),
            self.fetcher.tick(now),
            self.disconnector.tick(now),
            self.rounds.tick(now),
            self.copies.tick(now),
            self.states.tick(now),
            self.display.tick(now),
        ]
        return min([now + ROUND, *(time for time in due if time is not None)])

    def _request_round(self) -> None:
        """Have a round, since something has changed."""
        self.rounds.soon(monotonic())

    # Discovery

    def _subscribe(self, topic: str) -> None:
        self.node.subscribe(topic, lambda change, master: self.loop.post(self._on_announcement, change, master))

    def _on_list(self, masters: List[AnnouncedMaster], first: bool, asked: float) -> None:
        now, before = monotonic(), self._online()
        self.news = {uri: at for uri, at in self.news.items() if at >= asked}
        self.core.take_list(masters, now, self.news.keys())
        self.disconnector.look(now)
        self.copies.look_soon()
        after = self._online()
        if first or any(uri not in after or online > after[uri] for uri, online in before.items()):
            self._request_round()  # a new master needs no round: its state is looked at when it is fetched

    def _on_announcement(self, change: str, master: AnnouncedMaster) -> None:
        """A message of `~changes`."""
        self.news[master.uri] = monotonic()
        if change == "removed":
            self.rounds.met.add(master.uri)
            self.core.remove(master.uri)
            self.copies.look_soon()
            self._request_round()
            return
        now, known = monotonic(), self.core.remotes.get(master.uri)
        was_online = known.announced.online if known is not None else None
        self.core.take_announcement(master, now)
        if was_online is not master.online:
            self.status_stale = True
            self.disconnector.look(now)
            self.copies.look_soon()
        own_changed = master.uri == self.uri and master.local_stamp != self.own_local_stamp
        if not master.online:
            self._request_round()
        if own_changed:  # a name that was taken may be free now, and one that was free be taken
            self.own_local_stamp = master.local_stamp
            self.rounds.soon(now + min(self.rounds.took * OWN_SHARE, OWN_SLOWEST))

    def _on_fetch(self, uri: str, items: Set[Registration]) -> None:
        self.status_stale = True
        self.rounds.touch_all(uri, items)
        self._report()

    def _on_touch(self, uri: str, items: Set[Registration]) -> None:
        self.rounds.met.add(uri)
        self.rounds.touch(items)
        self._report()

    def _online(self) -> Dict[str, bool]:
        """URI of a master -> whether it is online."""
        return {uri: remote.announced.online for uri, remote in self.core.remotes.items()}

    def _monitor_of(self, uri: str) -> str:
        remote = self.core.remotes.get(uri)
        return remote.announced.monitor_uri if remote is not None else ""

    # The view for people

    def _on_parameters(self) -> None:
        """Parameters have come or gone, or others are refused."""
        self.status_stale = True
        self._report()

    def _report(self) -> None:
        """Report refusals that are new or over."""
        places, many = self.core.place_refusals(), limit_refusals(self.core.remotes)
        refused = [*self.rounds.refused, *places, *many, *self.copies.refused]
        before, self.refusals = set(self.refusals), refused
        new = [item for item in refused if item not in before]
        for item in new[:LINES]:
            program.LOG.warning("%s", report.describe_refusal(item))
        if len(new) > LINES:
            program.LOG.warning("... and %d more refusals, see /diagnostics", len(new) - LINES)
        for item in before.difference(refused):
            program.LOG.info("%s", report.describe_refusal_end(item))
        self.refused_total.update(item.kind for item in new)
        if before != set(refused):
            self.display.mark_stale()
            self.display.look()

    def _entries(self) -> List[DiagnosticEntry]:
        """The entries of /diagnostics."""
        return report.diagnoses(self.refusals)

    def _samples(self) -> metrics.Samples:
        names = {uri: remote.announced.name for uri, remote in self.core.remotes.items() if uri != self.uri}
        rounds, fetcher = self.rounds, self.fetcher
        return {
            **metrics.scalar_samples(
                changes_received_total=fetcher.changes,
                states_received_total=fetcher.states,
                round_seconds=rounds.took,
                round_failures_total=rounds.failures,
            ),
            "registration_changes_total": {(what,): rounds.made[what] for what in metrics.CHANGES},
            **report.refusal_samples(set(self.refusals), self.refused_total),
            **report.parameter_samples(self.copies.masters(), [mine.master for mine in self.copies.record.values()]),
            **report.registration_samples(names, dict(rounds.held)),
        }

    def _round_over(self, problem: Optional[Exception]) -> None:
        self._report()
        if problem is None and self.finder.listed_once and not self.ready:
            self.ready = True
            memory.freeze()
            notify("READY=1")
        self.status_stale = True

    def _say_status(self) -> None:
        """Report the registrations to systemd. It takes a look at all of it, so not after each change of a busy fleet."""
        if not self.finder.listed_once:
            return
        self.status_stale = False
        topics: Dict[str, Set[str]] = {}
        services: Counter[str] = Counter()
        for item, master in self.rounds.held.items():
            if item.kind == "service":
                services[master] += 1
            else:
                topics.setdefault(master, set()).add(item.name)
        remotes = sorted(self.core.remotes.items(), key=lambda item: item[1].announced.name)
        shares = (
            f"{remote.announced.name}{'' if remote.announced.online else ' (offline)'}: {len(topics.get(uri, ()))} topics,"
            f" {services[uri]} services{self.copies.describe(remote.announced.name)}"
            for uri, remote in remotes
        )
        text = "; ".join(shares) or "no other master"
        text += report.describe_status(self.refusals, LINE - len(text))
        if text != self.status:
            self.status = text
            notify(f"STATUS={text}")

    # The end

    def _end(self) -> None:
        """Withdraw everything, but not for ever."""
        if self.ended:
            return
        self.ended.set()
        notify("STOPPING=1", "STATUS=withdrawing the registrations of other masters")
        program.leave_after(8.0)
        self.copies.withdraw(lambda: self.rounds.withdraw(self._on_withdrawal))

    def _on_withdrawal(self, farewell: str) -> None:
        self._report()
        self.display.end()
        program.LOG.info("%s", farewell)
        self.loop.stop()


def _core(start: local_roscore.Start) -> Sync:
    values = start.values
    keep = values["resync_on_reconnect_timeout"] if values["resync_on_reconnect"] else NEVER
    remote, on_demand = values["sync_remote_nodes"], values["sync_topics_on_demand"]
    return Sync(Filters(values), start.uri, start.name, remote, on_demand, keep, Members.from_parameters(values))


def main() -> int:
    """Start, run, end."""
    return MasterSync(local_roscore.begin(ros, "master_sync", parameters.SYNC, __doc__ or "")).run()


if __name__ == "__main__":
    program.run(main)
