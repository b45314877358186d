# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The table of parts: every row can be told."""

import re

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._faults.fault import ALWAYS, write_advices
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.components.component import (
    FAULTS,
    FOLLOWS,
    Component,
)

UNFILLED = re.compile(r"\{(place|what|inventory|limit)\}")
#: words of commands and of advice that change something or start it again
CHANGING = re.compile(
    r"site\.yml(?! --check)|restart|kill|cleanup|delete|chmod|sed -i|modprobe|rotate|--set\b|"
    r"\b(sysctl -w|ip \S+ (add|del|set|flush|replace)|set (dev|power_save)|nft (add|delete|flush))\b|"
    r"(?<!/)\b(give|set|switch|remove|correct|run|raise|allow|let|start|end|install|write|leave)\b"
)


@pytest.mark.parametrize("key", FAULTS)
def test_every_fault_is_told_in_whole_sentences(key):
    kind, mode = key
    for what in ("", "the network of dabo"):
        component = Component(kind, "tibi-nav", mode, what)
        texts = (
            component.sentence(),
            *(text for one in (*component.do(), *component.look()) for text in (one.text, one.effect or "none")),
        )
        assert all(text and not UNFILLED.search(text) and "  " not in text for text in texts), texts
        assert component.place in component.sentence() and not component.sentence().endswith(".")


@pytest.mark.parametrize("key", [key for key, fault in FAULTS.items() if fault.read != ALWAYS])
def test_what_may_be_inferred_is_told_with_a_look_alone(key):
    kind, mode = key
    assert not CHANGING.search(write_advices(Component(kind, "tibi-nav", mode).look()))


def test_what_follows_is_in_the_table():
    assert set(FOLLOWS) | {reason for reasons in FOLLOWS.values() for reason in reasons} <= set(FAULTS)


def test_two_places_are_one_component_in_any_order():
    component = Component.from_pair("filter", "pair", "b", "a")
    assert component == Component.from_pair("filter", "pair", "a", "b")
    assert component.places == ("a", "b") and " a and b," in component.sentence()
