# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The definition of messages, which a publisher sends in its header (wiki.ros.org/msg), read into steps through their bytes.

Other types follow the main one, each below a line of "=" and a line "MSG: package/Type". It is another node's text.
"""

import re
from typing import Dict, List, NamedTuple, Optional, Set, Tuple, Union

from ...protocol.plain_text import quote

MOST_LINES, MOST_FIELDS, DEEPEST = 10_000, 2000, 30  # of a definition; types in each other
_STEP, _PLAN = 300, 400  # bytes of memory, not less than they take
SIZES = {
    **dict.fromkeys(("bool", "int8", "uint8", "byte", "char"), 1),
    **{"int16": 2, "uint16": 2},
    **dict.fromkeys(("int32", "uint32", "float32"), 4),
    **dict.fromkeys(("int64", "uint64", "float64", "time", "duration"), 8),
}
#: Texts that name a frame of tf: those of std_msgs/Header, and the one that a transform or an odometry leads to.
FRAMES = ("frame_id", "child_frame_id")
TRANSFORM = "geometry_msgs/TransformStamped"
_LINE = re.compile(r"([A-Za-z][A-Za-z0-9_/]*)((?:\[\d{0,9}\])?)\s+([A-Za-z][A-Za-z0-9_]*)\s*(=?)")
_SEPARATOR = re.compile(r"^={3,}\s*$", re.MULTILINE)


class DefinitionError(ValueError):
    """The definition cannot be read; the text names the type and the field."""


class Skip(NamedTuple):
    """Bytes of which the number is known."""

    size: int


class Text(NamedTuple):
    """A text, its length in front."""

    is_frame: bool


class Repeat(NamedTuple):
    """A type, once or several times."""

    plan: "TypePlan"
    times: Optional[int]  # None: the number is in front


Step = Union[Skip, Text, Repeat]


class TypePlan(NamedTuple):
    """The steps through the bytes of a type."""

    steps: Tuple[Step, ...]
    size: Optional[int]  # bytes, if it is always the same
    has_frames: bool
    is_transform: bool = False


def make_plan(type_name: str, definition: str) -> TypePlan:
    """Read the definition of a type: 'package/Type', and the text in a publisher's header. Raises DefinitionError."""
    main, *others = _SEPARATOR.split(definition)
    texts = {type_name: main}
    for text in others:
        title, _newline, body = text.strip().partition("\n")
        texts[title.partition("MSG:")[2].strip()] = body
    return _DefinitionReader(texts).read(type_name)


def weigh(plan: TypePlan) -> int:
    """Return the bytes of memory of a plan, and of those in it, each once."""
    seen, left = {id(plan)}, [plan]
    size = 0
    while left:
        one = left.pop()
        size += _PLAN + _STEP * len(one.steps)
        for step in one.steps:
            if isinstance(step, Repeat) and id(step.plan) not in seen:
                seen.add(id(step.plan))
                left.append(step.plan)
    return size


class _DefinitionReader:
    """Reads each type once."""

    def __init__(self, texts: Dict[str, str]) -> None:
        self._texts = texts
        self._plans: Dict[str, TypePlan] = {}
        self._open: Set[str] = set()
        self._lines = self._fields = 0

    def read(self, name: str) -> TypePlan:
        if name not in self._plans:
            if name in self._open or len(self._open) == DEEPEST:
                raise DefinitionError(f"{quote(name)} is in itself, or more than {DEEPEST} types are in each other")
            self._open.add(name)
            steps = [self._read_field(name, line) for line in self._texts[name].split("\n")]
            self._open.discard(name)
            self._plans[name] = _merge_steps([step for step in steps if step is not None], name == TRANSFORM)
        return self._plans[name]

    def _read_field(self, name: str, line: str) -> Optional[Step]:
        line = line.partition("#")[0].strip()
        found = _LINE.match(line)
        self._lines += 1
        self._fields += found is not None
        if line and found is None:
            raise DefinitionError(f"{quote(name)} has a line that is no field: {quote(line[:80])}")
        if self._lines > MOST_LINES or self._fields > MOST_FIELDS:
            raise DefinitionError(
                f"{quote(name)} has, with all that is in it, more than {MOST_FIELDS} fields or {MOST_LINES} lines"
            )
        if found is None or found[4]:  # a comment, or a constant, which is in no message
            return None
        kind, array, field = found[1], found[2], found[3]
        once = self._read_type(name, kind, field)
        if not array:
            return once
        plan = once.plan if isinstance(once, Repeat) else _merge_steps([once], False)
        return _repeat(plan, int(array[1:-1]) if array != "[]" else None)

    def _read_type(self, name: str, kind: str, field: str) -> Step:
        if kind == "string":
            return Text(field in FRAMES)
        if kind in SIZES:
            return Skip(SIZES[kind])
        package = name.partition("/")[0]
        full = "std_msgs/Header" if kind == "Header" else kind if "/" in kind else f"{package}/{kind}"
        if full not in self._texts:
            raise DefinitionError(f"{quote(name)} has the field {quote(field)} of {quote(full)}, which is not defined")
        return _repeat(self.read(full), 1)


def _repeat(plan: TypePlan, times: Optional[int]) -> Step:
    return Repeat(plan, times) if plan.size is None or times is None else Skip(plan.size * times)


def _merge_steps(steps: List[Step], is_transform: bool) -> TypePlan:
    """Make the plan of a type; fields of a known size become one step."""
    merged: List[Step] = []
    for step in steps:
        if isinstance(step, Repeat) and step.times == 0:
            continue
        if isinstance(step, Skip) and merged and isinstance(merged[-1], Skip):
            merged[-1] = Skip(merged[-1].size + step.size)
        else:
            merged.append(step)
    fixed = all(isinstance(step, Skip) for step in merged)
    size = sum(step.size for step in merged if isinstance(step, Skip)) if fixed else None
    frames = any(
        step.is_frame if isinstance(step, Text) else isinstance(step, Repeat) and step.plan.has_frames
        for step in merged
    )
    return TypePlan(tuple(merged), size, frames, is_transform)
