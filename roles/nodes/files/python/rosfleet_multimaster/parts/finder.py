# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The discovery node of the own roscore: found by its topic and service, and asked for its list of masters."""

from typing import Callable, List, Optional, Tuple

from ..core.sync import Announced, Claims
from ..edge.clock import monotonic
from ..edge.loop import Recurring, Workers
from ..edge.roscore import Roscore
from ..edge.systemd import notify
from . import program

CHANGES_TYPE = "MasterState"  # the topic of discovery is known by the end of its type,
LIST_MASTERS = "list_masters"  # and its service by the end of its name
FIND = 30.0  # seconds between two looks for the discovery node, once it was found
LIST_FIRST, LIST = 0.5, 10.0  # seconds between two looks at list_masters, until the first answer and then


class Finder:
    """Looks for the discovery node, and lists its masters regularly."""

    def __init__(
        self,
        roscore: Roscore,
        roscore_calls: Workers,
        rospy_calls: Workers,
        limited: program.Limited,
        claims: Callable[[], Claims],
        list_masters: Callable[[str], List[Announced]],
        subscribe: Callable[[str], None],
        listed: Callable[[List[Announced], bool], None],
    ) -> None:
        """`subscribe(topic)` and `listed(masters, first)` are called in the loop; `list_masters(service)` in a worker."""
        self.listed_once = False
        self._roscore, self._limited, self._claims = roscore, limited, claims
        self._subscribe, self._on_list = subscribe, listed
        self._service = ""
        self._finds = Recurring(roscore_calls, lambda: FIND if self._service else LIST_FIRST, self._find, self._found)
        self._lists = Recurring(
            rospy_calls,
            lambda: LIST if self.listed_once else LIST_FIRST,
            lambda: list_masters(self._service),
            self._listed,
            lambda: bool(self._service),
        )

    def tick(self, now: float) -> List[Optional[float]]:
        """Do what is due; the times of the next calls."""
        return [self._finds.tick(now), self._lists.tick(now)]

    def _find(self) -> Tuple[str, str]:
        """The topic and the service of the discovery node of this roscore."""
        types, system = self._roscore.ask(("getTopicTypes",), ("getSystemState",))
        if types is None or system is None:
            raise OSError("the roscore does not tell its state")
        foreign = {node for node, _uri in self._claims()}
        publishers, _subscribers, services = system
        own_topics = {topic for topic, nodes in publishers if set(nodes) - foreign}
        topics = sorted(topic for topic, kind in types if kind.endswith(CHANGES_TYPE) and topic in own_topics)
        found = sorted(name for name, nodes in services if name.endswith(LIST_MASTERS) and set(nodes) - foreign)
        return (topics[0] if topics else ""), (found[0] if found else "")

    def _found(self, found: Optional[Tuple[str, str]], problem: Optional[Exception]) -> None:
        topic, service = found or ("", "")
        if topic:
            self._subscribe(topic)
        if problem is not None:
            self._finds.due = monotonic() + LIST_FIRST
        if service and service != self._service:
            self._lists.due = 0.0
        if service:
            self._service = service
        elif problem is None:
            text = f"no master_discovery on the roscore at {self._roscore.rpc.uri}: waiting for it"
            self._limited.say("warning", "discovery", text)
            if not self.listed_once:
                notify(f"STATUS={text}")

    def _listed(self, masters: Optional[List[Announced]], problem: Optional[Exception]) -> None:
        if masters is None:
            self._finds.due = monotonic() + LIST_FIRST
            self._service = ""
            self._limited.say("warning", "list", f"master_discovery does not list the masters: {problem}")
            return
        first, self.listed_once = not self.listed_once, True
        self._on_list(masters, first)
