# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The face of a node: entries on /diagnostics, and metrics in a file."""

from typing import Any, Callable, List, Mapping, Optional

from ..protocol import metrics
from ..protocol.members import Members
from ..protocol.messages import DiagnosticEntry
from . import rpc_client
from .clock import monotonic, wall_clock
from .loop import DirectRunner, Loop, RecurringJob
from .process import program, textfile

#: seconds between two messages to a subscriber: diagnostic_aggregator calls an entry stale after five
PUBLISH = 2.0
WRITE = 15.0  # seconds between two files: Prometheus asks about as often
EARLY = 0.5  # a look comes so much early, if the loop is awake


class Display:
    """Publishes and writes if it is due. The content is worked out only then."""

    def __init__(
        self,
        values: Mapping[str, Any],
        of: str,
        node: str,
        loop: Loop,
        limited: program.LimitedLog,
        entries: Callable[[], List[DiagnosticEntry]],
        samples: Callable[[], metrics.Samples],
    ) -> None:
        """`values` are the parameters of the node, `of` is the URI of the own master, `node` the name of the node."""
        self.diagnoses, self._path = values["diagnostics"], values["metrics"]
        own = Members.from_parameters(values).master(of)
        self._robot = "" if own is None else own.robot
        self._node, self._loop, self._limited = node, loop, limited
        self._entries, self._samples = entries, samples
        self._stale = True  # something has changed since it was published
        self._publish_due = self._write_due = 0.0
        self._topic: Optional[Any] = None
        self._looks = RecurringJob(DirectRunner(), lambda: PUBLISH, self.look, wanted=lambda: self.has_outputs)

    def open(self, make_topic: Callable[[], Any]) -> None:
        """Publish from now on, if people want it. `make_topic()`: a publisher of /diagnostics."""
        if self.diagnoses:
            self._topic = make_topic()

    def tick(self, now: float) -> Optional[float]:
        """Look if that is due; the time of the next look."""
        return self._looks.tick(now)

    @property
    def has_outputs(self) -> bool:
        """True if there is an output."""
        return bool(self.diagnoses or self._path)

    def mark_stale(self) -> None:
        """Publish with the next look."""
        self._stale = True

    def look(self) -> None:
        """Show all that is due."""
        now, topic = monotonic(), self._topic
        due = now >= self._publish_due
        if topic is not None and (self._stale or (due and topic.has_listeners())):
            self._stale, self._publish_due = False, now + PUBLISH - EARLY
            topic.publish(self._entries(), wall_clock(), self._robot)
        if self._path and now >= self._write_due:
            self._write_due = now + WRITE - EARLY
            self._write()

    def _write(self) -> None:
        common = metrics.node_samples(self._node, wall_clock(), self._loop.queue_length, rpc_client.RECEIVED.value)
        try:
            textfile.write(self._path, metrics.text({**common, **self._samples()}))
        except OSError as problem:
            self._limited.say("warning", "metrics", f"the metrics cannot be written to {self._path}: {problem}")

    def end(self) -> None:
        """Take the file back: old values are worse than missing ones."""
        if self._path:
            textfile.remove(self._path)
