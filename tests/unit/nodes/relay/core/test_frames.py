# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Frames in messages of any type: types and messages are drawn by a seed, with the bytes that they are to become."""

import random
import struct
import time

import pytest
from rosfleet_multimaster.relay.core import frames
from rosfleet_multimaster.relay.core.definition import DefinitionError, make_plan
from rosfleet_multimaster.relay.core.frames import DEFINITION, STATIC_TYPE, Frames, FramesError, make_rewrite

from tests.unit.nodes.relay.ends import DEEP, message, text, tree

ROBOT = Frames(b"kobuki1/", b"world", b"map")
FIXED = {"bool": 1, "int16": 2, "uint32": 4, "float64": 8, "time": 8, "duration": 8, "byte": 1, "char": 1}
LINE = "=" * 80


def rewrite(type_name, definition, body, change):
    changed = make_rewrite({"type": type_name, "message_definition": definition}, change)(message(body))
    assert changed == b"" or len(changed) == 4 + struct.unpack("<I", changed[:4])[0]
    return changed[4:] if changed else None


class Drawn:
    """Types in each other, and messages of them before and after."""

    def __init__(self, seed):
        self.draw = random.Random(seed)
        self.types = {"std_msgs/Header": ["uint32 seq", "time stamp", "string frame_id"]}
        self.main = self.type(0)

    def type(self, depth):
        name = f"drawn_msgs/T{len(self.types)}"
        self.types[name] = []
        for number in range(self.draw.randint(0 if depth else 2, 5)):
            kinds = [*FIXED, "string", "string", "Header"] + ["nested"] * (3 if depth < 3 else 0)
            kind = self.draw.choice(kinds)
            if kind == "nested":
                kind = self.type(depth + 1)
                kind = self.draw.choice((kind, kind.partition("/")[2]))
            field = (
                self.draw.choice(("frame_id", "child_frame_id"))
                if kind == "string" and self.draw.random() < 0.5
                else f"f{number}"
            )
            array = self.draw.choice(("", "", "[]", "[0]", "[3]"))
            self.types[name].append(f"{kind}{array} {field}{self.draw.choice(('', '  # said'))}")
        return name

    def definition(self):
        extra = ["string NAME=frame_id # not a comment", "", "# a comment", "int32 A = 3"]
        sections = ["\n".join([*extra, *self.types[self.main]])]
        sections += [f"MSG: {name}\n" + "\n".join(lines) for name, lines in self.types.items() if name != self.main]
        return f"\n{LINE}\n".join(sections)

    def message(self, name):
        before, after = b"", b""
        for line in self.types[name]:
            kind, field = line.partition("#")[0].split()
            kind, _bracket, count = kind.partition("[")
            number = 1
            if count:
                number = self.draw.randint(0, 3) if count == "]" else int(count[:-1])
                before, after = (
                    (part + struct.pack("<I", number)) if count == "]" else part for part in (before, after)
                )
            for _number in range(number):
                one, other = self.value(kind, field)
                before, after = before + one, after + other
        return before, after

    def value(self, kind, field):
        if kind in FIXED:
            return (bytes(self.draw.choices(range(256), k=FIXED[kind])),) * 2
        if kind == "string":
            value = self.draw.choice((b"", b"base", b"/odom", b"\xff\xfe", b"a/b"))
            return text(value), text(ROBOT.add(value) if field in ("frame_id", "child_frame_id") else value)
        name = {"Header": "std_msgs/Header"}.get(kind, kind if "/" in kind else f"drawn_msgs/{kind}")
        return self.message(name)


@pytest.mark.parametrize("seed", range(150))
def test_drawn_messages_get_the_prefix_and_nothing_else(seed):
    drawn = Drawn(seed)
    definition = drawn.definition()
    if not make_plan(drawn.main, definition).has_frames:
        assert make_rewrite({"type": drawn.main, "message_definition": definition}, ROBOT.add) is None
        return
    for _message in range(5):
        before, after = drawn.message(drawn.main)
        assert rewrite(drawn.main, definition, before, ROBOT.add) == after
        for end in range(0, len(before), 1 + len(before) // 10):
            with pytest.raises(FramesError, match="shorter"):
                rewrite(drawn.main, definition, before[:end], ROBOT.add)
        with pytest.raises(FramesError, match="longer"):
            rewrite(drawn.main, definition, before + b"x", ROBOT.add)


def rename_tree(body, change):
    return rewrite(STATIC_TYPE, DEFINITION, body, change)


def test_a_tree_crosses_and_comes_back():
    own = tree((b"odom", b"base"), (b"/base", b"/laser"))
    theirs = tree((b"kobuki1/odom", b"kobuki1/base"), (b"kobuki1/base", b"kobuki1/laser"))
    assert rename_tree(own, ROBOT.add) == theirs
    assert rename_tree(theirs, ROBOT.take_off) == tree((b"odom", b"base"), (b"base", b"laser"))


def test_transforms_of_others_do_not_come_into_a_robot():
    mixed = tree((b"kobuki2/odom", b"kobuki2/base"), (b"kobuki1/map", b"kobuki1/odom"), (b"world", b"kobuki2/map"))
    assert rename_tree(mixed, ROBOT.take_off) == tree((b"map", b"odom"))
    assert rename_tree(tree((b"kobuki2/odom", b"kobuki2/base")), ROBOT.take_off) is None
    assert rename_tree(tree((b"world", b"kobuki1/map")), ROBOT.take_off) is None, "it would be below itself"
    assert rename_tree(tree(), ROBOT.take_off) == tree()


HEADER = "MSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id"
POSE = f"Header header\nfloat64 x\n{LINE}\n{HEADER}"


def pose(frame):
    return struct.pack("<3I", 1, 2, 3) + text(frame) + struct.pack("<d", 0.5)


@pytest.mark.parametrize(
    ("theirs", "own"), [(b"kobuki1/base", b"base"), (b"world", b"map"), (b"/world", b"map"), (b"", b"")]
)
def test_a_message_for_a_robot_has_the_robot_s_frames(theirs, own):
    assert rewrite("some/Pose", POSE, pose(theirs), ROBOT.take_off) == pose(own)


def test_a_message_in_a_frame_of_another_stays_away():
    for frame in (b"map", b"kobuki2/base", b"kobuki1", b"worlds"):
        with pytest.raises(FramesError, match="its frame .* does not belong to this robot"):
            rewrite("some/Pose", POSE, pose(frame), ROBOT.take_off)
    with pytest.raises(FramesError):
        rewrite("some/Pose", POSE, pose(b"world"), Frames(b"kobuki1/").take_off)


def test_a_foreign_frame_before_a_tree_keeps_all_away():
    definition = f"string frame_id\ntf2_msgs/TFMessage tree\n{LINE}\nMSG: tf2_msgs/TFMessage\n{DEFINITION}"
    both = text(b"kobuki1/base") + tree((b"kobuki1/odom", b"kobuki1/base"), (b"other", b"another"))
    assert rewrite("some/Both", definition, both, ROBOT.take_off) == text(b"base") + tree((b"odom", b"base"))
    with pytest.raises(FramesError):
        rewrite("some/Both", definition, text(b"other") + tree((b"kobuki1/odom", b"kobuki1/base")), ROBOT.take_off)


def test_the_root_is_a_transform_of_the_world():
    header, root = ROBOT.make_root()
    assert header["type"] == STATIC_TYPE
    body = root[4:]
    assert rewrite(STATIC_TYPE, header["message_definition"], body, lambda frame: frame) == body
    assert text(b"world") + text(b"kobuki1/map") + struct.pack("<7d", 0, 0, 0, 0, 0, 0, 1) in body


def test_too_much_in_a_message_ends_soon():
    definition = f"string[] names\nstring frame_id\n{LINE}\nMSG: some/Empty\n"
    many = struct.pack("<I", 1 << 22) + b"\0" * (1 << 24)
    began = time.process_time()
    with pytest.raises(FramesError, match=f"more than {frames.MOST_STEPS}"):
        rewrite("some/Names", definition, many, ROBOT.add)
    deep = f"\n{LINE}\n".join(
        ["D1[] all"] + [f"MSG: some/D{n}\nD{n + 1} a" for n in range(1, 27)] + ["MSG: some/D27\nstring frame_id"]
    )
    with pytest.raises(FramesError, match=f"more than {frames.MOST_STEPS}"):
        rewrite("some/Deep", deep, struct.pack("<I", 100000) + text(b"a") * 100000, ROBOT.add)
    assert time.process_time() - began < 3
    for length in (1 << 31, (1 << 32) - 1):
        with pytest.raises(FramesError, match="shorter"):
            rewrite("some/Pose", POSE, struct.pack("<3I", 1, 2, 3) + struct.pack("<I", length), ROBOT.add)
    empty = f"Empty[] nothing\nEmpty[999999999] more\nstring frame_id\n{LINE}\nMSG: some/Empty\n"
    assert rewrite("some/Much", empty, struct.pack("<I", (1 << 32) - 1) + text(b"a"), ROBOT.add).endswith(b"kobuki1/a")


def test_steps_are_bounded_by_bytes():
    """A text has four bytes at least, and may be many steps: types in each other. So few bytes never cost much."""
    for texts in (1, 100, 1000, 5000):
        body = struct.pack("<I", texts) + text(b"") * texts
        plan = {"type": "x/Y", "message_definition": DEEP}
        walk = frames._FrameWalk(message(body), ROBOT.add)
        try:
            assert walk.rewrite(make_plan(*plan.values()))
        except FramesError as problem:
            assert f"in {len(message(body))} bytes" in str(problem)
        assert walk._steps <= min(frames.FREE_STEPS + len(message(body)), frames.MOST_STEPS) + 1


def test_a_message_of_empty_texts_is_within_its_steps():
    """Nothing that nodes send has more steps for its bytes: three for an entry of two texts, which may be empty."""
    definition = (
        f"Header header\nKeyValue[] values\n{LINE}\nMSG: x/KeyValue\nstring key\nstring value\n{LINE}\n{HEADER}"
    )
    for count in (0, 1, 100, 9000):
        body = struct.pack("<3I", 1, 2, 3) + text(b"base") + struct.pack("<I", count) + text(b"") * (2 * count)
        assert rewrite("x/Values", definition, body, ROBOT.add) is not None


NESTED = (
    f"\n{LINE}\n".join(f"MSG: some/T{n}\nT{n + 1} a\nT{n + 1}[9] b" for n in range(1, 25))
    + f"\n{LINE}\nMSG: some/T25\n"
)


def test_a_line_ends_where_ros_ends_it():
    """Other ends of lines, as in a comment, are text."""
    definition = "int8 a # one\x0cint32 b\u2028int32 c\x85int32 d\r\nstring frame_id\r\n"
    assert rewrite("some/Odd", definition, b"\1" + text(b"base"), ROBOT.add) == b"\1" + text(b"kobuki1/base")


def test_frames_that_nobody_defines_stay_away():
    for definition in ("", " \n"):
        with pytest.raises(DefinitionError, match="the publisher of some/Pose sends none"):
            make_rewrite({"type": "some/Pose", "md5sum": "a" * 32, "message_definition": definition}, ROBOT.add)
    assert make_rewrite({"type": "std_msgs/Empty", "md5sum": frames.EMPTY}, ROBOT.add) is None


@pytest.mark.parametrize(
    ("definition", "why"),
    [
        ("Other other", 'the field "other" of some/Other, which is not defined'),
        ("Main again", "some/Main is in itself"),
        (f"A a\n{LINE}\nMSG: some/A\nB b\n{LINE}\nMSG: some/B\nA a", "some/A is in itself"),
        ("string frame_id\nstring", "some/Main has a line that is no field"),
        (f'None a\n{LINE}\nMSG: some/None\nall = well; "PASSED"', r"field: \"all = well; 'PASSED'\"$"),
        ("uint8[12345678901] data", "a line that is no field"),
        ("\n".join(f"uint8 f{number}" for number in range(2001)), "more than 2000 fields or 10000 lines"),
        ("# a line\n" * 10001, "more than 2000 fields or 10000 lines"),
        (f"\n{LINE}\n".join(["T1 a"] + [f"MSG: some/T{n}\nT{n + 1} a" for n in range(1, 40)]), "more than 30 types"),
        ("x" * 500000, "a line that is no field"),
    ],
)
def test_a_definition_that_cannot_be_read_is_named(definition, why):
    with pytest.raises(DefinitionError, match=why):
        make_plan("some/Main", definition)


def test_a_definition_that_grows_with_each_level_is_read_at_once():
    strings = f"T1 a\n{LINE}\n{NESTED}string s"
    assert make_plan("some/Main", strings).has_frames is False
    assert make_plan("some/Main", f"T1 a\n{LINE}\n{NESTED}uint8 s").size == 10**24
