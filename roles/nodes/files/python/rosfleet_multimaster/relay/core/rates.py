# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""A rate of messages: at most so many a second leave, each the newest. A rate costs no message with unique content.

So it is for messages of which each replaces the one before. Of some types that is known, of other types the user says it; messages
of any other type count each.
"""

import struct
from typing import Collection, Dict, Iterator, Mapping, NamedTuple, Optional, Sequence, Tuple, Union

from .budget import Budget
from .frames import MD5SUM, STATIC

_SIZE = struct.Struct("<I")
_STAMP, _POSE = 12, 56  # bytes of seq and stamp before the frames of a transform, and of the fields behind them
MOST_FRAMES = 1000  # of one node, whose transforms have a rate each
MOST_HELD = 1 << 20  # bytes of transforms that wait
_FRAME = 400  # bytes of memory of a frame besides its name
#: types whose messages count each: a goal and its result, additions to earlier messages, and those named in the message
EACH = {
    *("actionlib_msgs/GoalID", "map_msgs/OccupancyGridUpdate", "map_msgs/PointCloud2Update", "rosgraph_msgs/Log"),
    *("theora_image_transport/Packet", "visualization_msgs/InteractiveMarkerUpdate"),
    *("visualization_msgs/Marker", "visualization_msgs/MarkerArray", "diagnostic_msgs/DiagnosticArray"),
}
EACH_ENDS = ("ActionGoal", "ActionResult")  # of the types of any action
#: types of which each message replaces the one before, and packages of such types
WHOLE = {
    *("actionlib_msgs/GoalStatusArray", "rosgraph_msgs/Clock", "map_msgs/ProjectedMap", "costmap_2d/VoxelGrid"),
    *("gazebo_msgs/ModelStates", "gazebo_msgs/LinkStates", "grid_map_msgs/GridMap", "octomap_msgs/Octomap"),
    *(
        "sensor_msgs/*",
        "geometry_msgs/*",
        "nav_msgs/*",
        "std_msgs/*",
        "stereo_msgs/*",
        "trajectory_msgs/*",
        "ackermann_msgs/*",
    ),
    *("tf/*", "tf2_msgs/*"),
}
WHOLE_END = "ActionFeedback"


class Rate(NamedTuple):
    """The rate of an entry."""

    hertz: float = 0.0  # messages a second; 0: all
    whole: Tuple[str, ...] = ()  # further types, and packages (x/*), of which each message replaces the one before


NO_RATE = Rate()


def is_known(kind: str) -> bool:
    """True for a type of which it is known whether each message counts."""
    return _is_listed(kind, WHOLE) or kind in EACH or kind.endswith((WHOLE_END, *EACH_ENDS))


def _is_listed(kind: str, types: Collection[str]) -> bool:
    return kind in types or f"{kind.partition('/')[0]}/*" in types


class RateLimit:
    """Lets a message a period pass, as soon as it comes. The newest of the others follows if no newer one comes in time.

    The periods follow on each other, so the mean is exact however messages come. A message passes in a period of its own.
    """

    __slots__ = ("_budget", "_came", "_free", "_pause", "_period", "_waiting", "dropped")

    def __init__(self, rate: float, budget: Optional[Budget] = None) -> None:
        """`rate`: messages a second; 0: all of them. `budget`: of waiting messages; None: another object counts them."""
        self._period = 1.0 / rate if rate else 0.0
        self._free = 0.0  # when the next period begins
        self._came, self._pause = 0.0, 0.0  # the last message, and the time from the one before
        self._waiting: Optional[bytes] = None
        self._budget = budget
        self.dropped = 0

    @property
    def size(self) -> int:
        """Bytes that wait."""
        return len(self._waiting or b"")

    def take(self, message: bytes, now: float) -> Optional[bytes]:
        """Return the message, if it may pass now; else it waits, in the place of the one that waited."""
        self._pause, self._came = now - self._came, now
        if self._waiting is not None:
            self.drop_all()
        if now < self._free:
            self._waiting = message
            if self._budget is not None:
                self._budget.hold(message)
            return None
        self._begin_period(now)
        return message

    @property
    def due(self) -> Optional[float]:
        """The time at which the waiting message is to pass; None if no message waits. A newer one is expected before."""
        return None if self._waiting is None else self._free + min(self._period, 2 * self._pause)

    def release(self, now: float) -> Optional[bytes]:
        """Return the message that waits, if it is to pass now."""
        if self.due is None or now < self.due:
            return None
        self._begin_period(now)
        return self._let_go()

    def drop_all(self) -> None:
        """Drop the message that waits."""
        if self._let_go() is not None:
            self.dropped += 1

    def close(self) -> None:
        """Hold nothing any more."""
        self._let_go()

    def _let_go(self) -> Optional[bytes]:
        message, self._waiting = self._waiting, None
        if message is not None and self._budget is not None:
            self._budget.release(message)
        return message

    def _begin_period(self, now: float) -> None:
        late = now - self._free
        self._free = self._free + self._period if late < self._period else now + self._period


class TreeThrottle:
    """The same for transforms of tf, each by its frame: a node sends those of several joints in turns."""

    def __init__(self, rate: float, budget: Optional[Budget] = None) -> None:
        """`budget`: of the waiting messages, and of the frames."""
        self._rate, self._budget, self._skipped, self._held = rate, budget, 0, 0
        self._known = self._counted = 0  # bytes of memory of the frames, and those that the budget has counted
        self._frames: Dict[bytes, RateLimit] = {}

    @property
    def dropped(self) -> int:
        """The number of transforms or messages that did not leave."""
        return self._skipped + sum(throttle.dropped for throttle in self._frames.values())

    @property
    def size(self) -> int:
        """Bytes of memory: of the waiting messages, and of the frames."""
        return self._held + self._known

    def take(self, message: bytes, now: float) -> Optional[bytes]:
        """Return a message of the transforms that may pass now; None if no transform may pass now."""
        try:
            transforms = list(_split(message))
        except (struct.error, ValueError):
            self._skipped += 1
            return None
        passed = []
        for frame, transform in transforms:
            if frame not in self._frames and len(self._frames) < MOST_FRAMES:
                self._frames[frame] = RateLimit(self._rate)
                self._known += _FRAME + len(frame)
            if frame not in self._frames or self._held + len(transform) > MOST_HELD:
                self._skipped += 1
                continue
            throttle = self._frames[frame]
            self._held -= throttle.size
            one = throttle.take(transform, now)
            self._held += throttle.size
            if one is not None:
                passed.append(one)
        self._count()
        return _join(passed)

    @property
    def due(self) -> Optional[float]:
        """The time at which a waiting transform is to pass; None if no transform waits."""
        return min(
            (due for due in (throttle.due for throttle in self._frames.values()) if due is not None), default=None
        )

    def release(self, now: float) -> Optional[bytes]:
        """Return a message of the transforms that are to pass now."""
        passed = [one for one in (throttle.release(now) for throttle in self._frames.values()) if one is not None]
        self._held -= sum(map(len, passed))
        self._count()
        return _join(passed)

    def drop_all(self) -> None:
        """Drop the waiting transforms, and forget the frames: the next transform of each passes."""
        for throttle in self._frames.values():
            throttle.drop_all()
        self.close()

    def close(self) -> None:
        """Hold nothing any more."""
        self._skipped = self.dropped
        self._frames, self._held, self._known = {}, 0, 0
        self._count()

    def _count(self) -> None:
        """Report the held bytes to the budget. It may have all of it dropped."""
        more, self._counted = self.size - self._counted, self.size
        if self._budget is not None:
            self._budget.change(more)


AnyThrottle = Union[RateLimit, TreeThrottle]


def make_throttle(rate: Rate, topic: str, header: Mapping[str, str], budget: Optional[Budget] = None) -> AnyThrottle:
    """Return the throttle for a publisher's messages, by its header: latched messages, and those of which each counts, have no rate."""
    kind, hertz = header.get("type", ""), rate.hertz
    if header.get("latching") == "1" or topic == STATIC:
        return RateLimit(0.0)
    if not _is_listed(kind, rate.whole) and not _is_listed(kind, WHOLE) and not kind.endswith(WHOLE_END):
        return RateLimit(0.0)
    return TreeThrottle(hertz, budget) if hertz and header.get("md5sum") == MD5SUM else RateLimit(hertz, budget)


def find_unknown(rate: Rate, topic: str, header: Mapping[str, str]) -> str:
    """Return the type of a publisher's messages that cross without their rate, since the relay cannot know if each of them counts; empty for any other."""
    kind = header.get("type", "")
    is_free = not rate.hertz or header.get("latching") == "1" or topic == STATIC
    return "" if is_free or is_known(kind) or _is_listed(kind, rate.whole) else kind


def _split(message: bytes) -> Iterator[Tuple[bytes, bytes]]:
    """Yield each transform of a message of tf, whose length is in front, with its frame. Raises struct.error or ValueError."""
    at = 2 * _SIZE.size
    for _number in range(_SIZE.unpack_from(message, _SIZE.size)[0]):
        begin, at, frame = at, at + _STAMP, b""
        for _text in ("frame_id", "child_frame_id"):
            (size,) = _SIZE.unpack_from(message, at)
            frame, at = message[at + _SIZE.size : at + _SIZE.size + size], at + _SIZE.size + size
        at += _POSE
        if at > len(message):
            raise ValueError("it is shorter than it says")
        yield frame, message[begin:at]


def _join(transforms: Sequence[bytes]) -> Optional[bytes]:
    """Return the message of tf with these transforms; None without any."""
    body = b"".join(transforms)
    return b"".join((_SIZE.pack(len(body) + _SIZE.size), _SIZE.pack(len(transforms)), body)) if transforms else None
