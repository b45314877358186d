# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Text of others is made plain: one line, printable, bounded, and what is plain stays as it is."""

import unicodedata

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from rosfleet_multimaster.protocol.plain_text import CUT, LONGEST, is_plain, plain, plain_data, plain_lines

HOSTILE = st.text(
    st.one_of(st.characters(), st.sampled_from("\n\r\v\f\x1b\x85\u2028\u2029\u202e\u2066\u200b\ufeff\u3164"))
)


def refused(text):
    """The characters that must not reach a terminal or a journal."""
    return [
        character
        for character in text
        if character != " "
        and (unicodedata.category(character)[0] in "CZ" or character in "\u115f\u1160\u3164\uffa0\ufe0f")
    ]


@given(HOSTILE, st.integers(4, 300))
@example("a" * 500, 200)
@example("\x1b" * 200, 200)
@example(" " * 1000 + "a", 200)
def test_any_text_becomes_plain(text, most):
    made = plain(text, most)
    assert not refused(made)
    assert len(made) <= most
    assert len(made.splitlines()) <= 1
    assert plain(made, most) == made


@given(HOSTILE)
def test_lines_stay_lines(text):
    made = plain_lines(text, 100)
    assert not refused(made.replace("\n", "").replace("\t", ""))
    assert made.count("\n") == text.count("\n")
    assert plain_lines(made, 100) == made


@given(st.recursive(HOSTILE | st.integers() | st.none(), lambda part: st.lists(part) | st.dictionaries(HOSTILE, part)))
def test_data_is_plain_to_its_leaves(value):
    def texts(part):
        if isinstance(part, str):
            yield part
        elif isinstance(part, dict):
            for key, inner in part.items():
                yield from [*texts(key), *texts(inner)]
        elif isinstance(part, list):
            for inner in part:
                yield from texts(inner)

    assert not refused("".join(texts(plain_data(value))))


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("robot1: ok", "robot1: ok"),
        ("Gelenk äöü, 関節", "Gelenk äöü, 関節"),
        ("one\nSTATUS=two", "one STATUS=two"),
        ("one\x85two\u2028three", "one two three"),
        ("\x1b[2Jgone", "\\x1b[2Jgone"),
        ("\x9b2Jgone", "\\x9b2Jgone"),
        ("a\u202ecba", "a\\u202ecba"),
        ("half \udc80", "half \\udc80"),
        ("/pose\u3164", "/pose\\u3164"),
    ],
)
def test_examples(text, shown):
    assert plain(text) == shown


def test_a_cut_is_seen():
    assert plain("a" * LONGEST) == "a" * LONGEST
    assert plain("a" * (LONGEST + 1)) == "a" * (LONGEST - len(CUT)) + CUT
    assert plain("a" + " " * 5000 + "b").endswith(CUT)


def test_the_end_of_a_line_is_seen_in_a_difference():
    assert plain_lines("127.0.0.1\tlocalhost\r\n") == "127.0.0.1\tlocalhost\\r\n"


def test_values_that_are_plain_stay_the_same_and_whole():
    value = {"/pose": ["/a " * 1000, 1.5, None, True]}
    assert plain_data(value) == value


def test_what_is_plain():
    assert is_plain("/robot1/pose")
    assert not is_plain("/robot1/pose\n")
    assert not is_plain("/robot1/pose\u200b")
    assert not is_plain("a" * 10, 9)
