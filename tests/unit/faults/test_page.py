# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The table of the catalogue: the rows of faults that were not tried again stay."""

import catalogue
import page
from kept import Row, told_of_remedies


def fault(name, parts):
    return catalogue.Fault(name, f"title of {name}", (), (), (), parts, ("arm",), False)


def test_a_row_of_the_page_is_read_as_it_was_written():
    tried, words, untried = fault("tried", (("a", "b"),)), fault("words", (("a", "b"),)), fault("new", (("a", "b"),))
    rows = [(tried, Row("first", "", 0.0, 0, 0, "", remedied="yes: do")), (words, Row("first", "", 0.0, 0, 0, ""))]
    written = page.table([*rows, (untried, None)])
    found = page.read([tried, words, untried], written)
    assert set(found) == {tried, words}
    assert page.table([*found.items(), (untried, None)]) == written


def test_a_row_of_another_expected_part_is_left_out():
    written = page.table([(fault("one", (("a", "b"),)), Row("first", "", 0.0, 0, 0, ""))])
    assert page.read([fault("one", (("a", "c"),))], written) == {}


def test_the_page_has_the_sentence_of_the_prediction():
    assert page.find_sentence("The prediction of reachability").endswith(" ways.")


def test_words_that_hands_have_tried_are_counted_apart_from_commands():
    told = ("yes: do", "no: do", "words: write", "yes, by hand: write", "no, by hand: write", "")
    sentence = told_of_remedies([Row("first", "", 0.0, 0, 0, "", remedied=one) for one in told])
    assert sentence == (
        "The command that is told mends it in 1 of 2; 3 are told in words; of these 2 were done by hand, and mend it in 1."
    )
