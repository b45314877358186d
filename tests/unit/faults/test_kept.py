# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The kept results of faults that were tried."""

from dataclasses import replace

import catalogue
import kept
import remedy
from mentioned import mentions

FAULT = catalogue.Fault("icmp", "", (), (), (), (("filter", "icmp in"),), ("arm",), True)
ROW = kept.Row("first", "so it is", 12.0, 60, 59, "abc1234")


def test_a_result_is_of_the_part_that_was_expected_then(tmp_path):
    folder = kept.Kept(tmp_path / "results")
    assert folder.get(FAULT) is None
    folder.put(FAULT, ROW)
    found = folder.get(FAULT)
    assert (found.verdict, found.agreeing, found.revision) == ("first", 59, "abc1234")
    assert folder.get(replace(FAULT, parts=(("filter", "icmp"),))) is None


def test_words_are_no_commands_that_fail():
    told = [f"{remedy.MENDS}: run site.yml", f"{remedy.STAYS}: run site.yml", f"{remedy.WORDS}: look at the cable", ""]
    rows = [replace(ROW, remedied=text) for text in told]
    assert mentions(kept.told_of_remedies(rows), "1", "2")


def test_the_ways_of_all_faults_are_counted():
    assert kept.told_of_prediction([ROW, ROW]).endswith("118 of 120 ways.")
