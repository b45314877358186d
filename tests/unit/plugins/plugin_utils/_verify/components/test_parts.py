# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The table of parts: every row can be told."""

import re

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.components.parts import (
    ALWAYS,
    FAULTS,
    FOLLOWS,
    Part,
)

#: words of commands and of advice that change something or start it again
CHANGING = re.compile(
    r"site\.yml(?! --check)|restart|kill|cleanup|delete|chmod|sed -i|modprobe|rotate|--set\b|"
    r"\b(sysctl -w|ip \S+ (add|del|set|flush|replace)|set (dev|power_save)|nft (add|delete|flush))\b|"
    r"\b(give|set|switch|remove|correct|run|raise|allow|let|start|end|install|write|leave)\b"
)


@pytest.mark.parametrize("key", FAULTS)
def test_every_fault_is_told_in_whole_sentences(key):
    kind, mode = key
    for what in ("", "the network of dabo"):
        part = Part(kind, "tibi-nav", mode, what)
        texts = part.sentence(), part.remedy(), part.decide()
        assert all(text and "{" not in text and "  " not in text for text in texts), texts
        assert part.place in part.sentence() and not part.sentence().endswith(".")


@pytest.mark.parametrize("key", [key for key, fault in FAULTS.items() if fault.read != ALWAYS])
def test_what_may_be_inferred_is_told_with_a_look_alone(key):
    kind, mode = key
    assert not CHANGING.search(Part(kind, "tibi-nav", mode).decide())


def test_what_follows_is_in_the_table():
    assert set(FOLLOWS) | {reason for reasons in FOLLOWS.values() for reason in reasons} <= set(FAULTS)


def test_two_places_are_one_part_in_any_order():
    part = Part.from_pair("filter", "pair", "b", "a")
    assert part == Part.from_pair("filter", "pair", "a", "b")
    assert part.places == ("a", "b") and " a and b," in part.sentence()
