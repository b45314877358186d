# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The table of the catalogue: the rows of faults that were not tried again stay."""

import catalogue
import page
from kept import Row


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
