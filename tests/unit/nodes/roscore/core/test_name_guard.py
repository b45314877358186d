# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The node that gets a name that two nodes want."""

import pytest
from rosfleet_multimaster.roscore.core.name_guard import MOST, REPLACED, NameGuard, Verdict

OWN, NEWER, FAR, OTHER = "http://own:1/", "http://own:2/", "http://far:1/", "http://other:1/"


def guard(*imports):
    found = NameGuard()
    found.set_imports(("/camera", uri) for uri in imports)
    return found


def test_a_name_that_is_free_and_a_node_that_registers_again():
    found = guard(FAR)
    assert found.judge("/camera", "", OWN, 0.0) == found.judge("/camera", OWN, OWN, 0.0) == Verdict()
    assert found.judge("/arm", "", FAR, 0.0) == Verdict()


def test_the_newer_of_two_own_nodes_has_the_name():
    verdict = guard().judge("/camera", OWN, NEWER, 0.0)
    assert verdict == Verdict()


def test_a_replaced_node_does_not_come_back_while_it_ends():
    found = guard()
    found.judge("/camera", OWN, NEWER, 0.0)
    assert "newer node" in found.judge("/camera", NEWER, OWN, 1.0).refusal
    assert found.judge("/camera", NEWER, OWN, REPLACED + 1.0) == Verdict()
    assert guard().judge("/camera", NEWER, OWN, 1.0) == Verdict()


def test_a_replaced_node_may_have_a_name_that_is_free_again():
    found = guard()
    found.judge("/camera", OWN, NEWER, 0.0)
    assert found.judge("/camera", "", OWN, 1.0) == Verdict()


def test_an_own_node_takes_an_imported_name_without_its_end():
    found = guard(FAR)
    found.judge("/camera", "", FAR, 0.0)
    verdict = found.judge("/camera", FAR, OWN, 1.0)
    assert verdict.spared and verdict.import_lost


def test_an_import_never_takes_the_name_of_an_own_node():
    found = guard(FAR)
    assert "own node" in found.judge("/camera", OWN, FAR, 0.0).refusal
    found.judge("/camera", "", FAR, 0.0)
    found.judge("/camera", FAR, OWN, 1.0)
    for now in (2.0, 100.0, 10000.0):
        assert found.judge("/camera", OWN, FAR, now).refusal


def test_an_import_that_the_record_has_no_longer_is_still_one():
    found = guard(FAR)
    found.judge("/camera", "", FAR, 0.0)
    found.set_imports([])
    assert found.judge("/camera", FAR, OWN, 1.0).spared
    assert not found.is_import("/camera", FAR), "the name is an own node's now"


def test_of_two_imports_none_is_shut_down():
    found = guard(FAR, OTHER)
    found.judge("/camera", "", FAR, 0.0)
    verdict = found.judge("/camera", FAR, OTHER, 1.0)
    assert verdict.spared and not verdict.import_lost


def test_a_name_that_nobody_has_any_more_is_an_own_ones_next():
    found = guard(FAR)
    found.judge("/camera", "", FAR, 0.0)
    found.set_imports([])
    found.forget("/camera")
    assert not found.is_import("/camera", FAR)


@pytest.mark.slow
def test_what_is_remembered_is_bounded():
    found = guard()
    for number in range(3 * MOST):
        found.judge(f"/node_{number}", OWN, NEWER, number * 0.001)
    assert len(found._replaced) <= MOST
    assert found.judge("/late", OWN, NEWER, 1000.0) == Verdict()
    assert found.judge("/late", NEWER, OWN, 1001.0).refusal, "old ones make room"
