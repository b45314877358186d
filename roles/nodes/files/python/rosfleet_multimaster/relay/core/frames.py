# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames of tf in messages that cross: with the robot's prefix on the way out, without it on the way in.

The robot's own frames have no prefix: base_link is kobuki1/base_link for the others. `world` is a frame of all, below which
the root of the robot's tree is, at the same place.
"""

import struct
from typing import Callable, Dict, List, NamedTuple, Optional, Tuple

from ...protocol.plain_text import LONGEST, quote
from .definition import DefinitionError, Skip, Text, TypePlan, make_plan, weigh

#: Types, texts and numbers of elements in a message: so many, and one for each byte. A text has four bytes and may be in
#: types in each other, so a small message could cost as much as a large one. No message has more than the last number.
FREE_STEPS, MOST_STEPS = 256, 30_000
STATIC, STATIC_TYPE, MD5SUM = "/tf_static", "tf2_msgs/TFMessage", "94810edda583a504dfda3829e70d7eec"
EMPTY = "d41d8cd98f00b204e9800998ecf8427e"  # the md5sum of a type without fields
_LINE = "=" * 80
DEFINITION = f"""geometry_msgs/TransformStamped[] transforms
{_LINE}
MSG: geometry_msgs/TransformStamped
Header header
string child_frame_id
Transform transform
{_LINE}
MSG: std_msgs/Header
uint32 seq
time stamp
string frame_id
{_LINE}
MSG: geometry_msgs/Transform
Vector3 translation
Quaternion rotation
{_LINE}
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
{_LINE}
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
"""
_SIZE = struct.Struct("<I")

Change = Callable[[bytes], Optional[bytes]]  # a frame to its other name; None: it is a foreign frame


class Rewrite:
    """Changes the frames of a publisher's messages."""

    def __init__(self, plan: TypePlan, change: Change) -> None:
        self._plan, self._change = plan, change
        self.size = weigh(plan)  # bytes of memory

    def __call__(self, message: bytes) -> bytes:
        """Return a message with its frames changed, both with their length in front; empty if no transform of it is left. Raises FramesError."""
        return _FrameWalk(message, self._change).rewrite(self._plan)


class FramesError(ValueError):
    """A message cannot cross; the text says why."""


class Frames(NamedTuple):
    """The frames of a robot as the others have them."""

    prefix: bytes
    world: bytes = b""  # empty: something else says how the trees hang together
    root: bytes = b""  # of the robot's own tree

    def add(self, frame: bytes) -> Optional[bytes]:
        """Return the others' name of a frame of the robot."""
        return self.prefix + frame.lstrip(b"/") if frame else frame

    def take_off(self, frame: bytes) -> Optional[bytes]:
        """Return the robot's name of a frame of the others; None for one that the robot does not have."""
        name = frame.lstrip(b"/")
        if name.startswith(self.prefix):
            return name[len(self.prefix) :]
        if not frame:
            return frame
        return self.root if self.world and name == self.world else None

    def make_root(self) -> Tuple[Dict[str, str], bytes]:
        """Return the transform from the world to the robot's root, as /tf_static has it: header and message."""
        texts = b"".join(_SIZE.pack(len(text)) + text for text in (self.world, self.prefix + self.root))
        body = struct.pack("<4I", 1, 0, 0, 0) + texts + struct.pack("<7d", 0, 0, 0, 0, 0, 0, 1)
        return {"type": STATIC_TYPE, "md5sum": MD5SUM, "message_definition": DEFINITION}, _SIZE.pack(len(body)) + body


def make_rewrite(header: Dict[str, str], change: Change) -> Optional[Rewrite]:
    """Return the function that changes the frames of a publisher's messages; None if they have none. Raises DefinitionError."""
    definition = header.get("message_definition", "")
    if not definition.strip() and header.get("md5sum") != EMPTY:
        raise DefinitionError(f"the publisher of {quote(header.get('type'))} sends none")
    plan = make_plan(header.get("type", ""), definition)
    return Rewrite(plan, change) if plan.has_frames else None


class _FrameWalk:
    """One message on its way through the steps of its type."""

    def __init__(self, message: bytes, change: Change) -> None:
        """`message`: its length is in front."""
        self._message, self._change = memoryview(message), change
        self._at = self._copied = _SIZE.size
        self._out = bytearray()  # of the new message, without its length
        self._frames: List[bytes] = []  # of the transform that is being read
        self._foreign: Optional[bytes] = None
        self._steps = self._left_out = self._kept = 0
        self._most = min(MOST_STEPS, FREE_STEPS + len(message))

    def rewrite(self, plan: TypePlan) -> bytes:
        """Return the message with its frames changed; empty if no transform of it is left. Raises FramesError."""
        self._walk(plan)
        if self._foreign is not None:
            frame = quote(self._foreign[:LONGEST].decode("utf-8", "replace"))
            raise FramesError(f"its frame {frame} does not belong to this robot")
        if self._at != len(self._message):
            raise FramesError("it is longer than its definition says")
        if self._left_out and not self._kept:
            return b""
        rest = self._message[self._copied :]
        return b"".join((_SIZE.pack(len(self._out) + len(rest)), self._out, rest))

    def _walk(self, plan: TypePlan) -> None:
        self._count_step()
        for step in plan.steps:
            if isinstance(step, Skip):
                self._at += step.size
            elif isinstance(step, Text):
                self._pass_text(step.is_frame)
            else:
                count = self._read_number() if step.times is None else step.times
                if step.plan.size is not None:
                    self._at += count * step.plan.size
                elif step.plan.is_transform and step.times is None:
                    self._sort_out(step.plan, count)
                else:
                    for _number in range(count):
                        self._walk(step.plan)
            if self._at > len(self._message):
                raise FramesError("it is shorter than its definition says")

    def _count_step(self) -> None:
        self._steps += 1
        if self._steps > self._most:
            raise FramesError(f"it has more than {self._most} texts and types in {len(self._message)} bytes")

    def _read_number(self) -> int:
        self._count_step()
        if self._at + _SIZE.size > len(self._message):
            raise FramesError("it is shorter than its definition says")
        (number,) = _SIZE.unpack_from(self._message, self._at)
        self._at += _SIZE.size
        return int(number)

    def _pass_text(self, is_frame: bool) -> None:
        begin, size = self._at, self._read_number()
        self._at += size
        if is_frame and self._at <= len(self._message):
            text = bytes(self._message[begin + _SIZE.size : self._at])
            changed = self._change(text)
            if changed is None:
                self._foreign = text
            elif changed != text:
                self._out += self._message[self._copied : begin]
                self._out += _SIZE.pack(len(changed)) + changed
                self._copied = self._at
            self._frames.append(changed or b"")

    def _sort_out(self, plan: TypePlan, count: int) -> None:
        """Keep the transforms between two frames of the robot; their number is in front."""
        self._out += self._message[self._copied : self._at]
        place, kept, before_it = len(self._out) - _SIZE.size, 0, self._foreign
        self._copied, self._foreign = self._at, None
        for _number in range(count):
            before = len(self._out)
            self._frames = []
            self._walk(plan)
            if self._foreign is None and len(set(self._frames)) == len(self._frames):
                self._out += self._message[self._copied : self._at]
                kept += 1
            else:
                del self._out[before:]
                self._left_out += 1
            self._foreign, self._copied = None, self._at
        self._foreign = before_it
        _SIZE.pack_into(self._out, place, kept)
        self._kept += kept
