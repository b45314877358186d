# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The findings that a change of one cost moves."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._faults.table import FAULTS

from tools import costs

pytestmark = [pytest.mark.whole, pytest.mark.slow]

LINK_DOWN = "RF-231"


@pytest.fixture(scope="module")
def cases():
    return list(costs.list_cases(len(costs.faults.FAULTS)))


@pytest.mark.costly
def test_no_change_moves_nothing(cases):
    assert list(costs.find_moves(LINK_DOWN, 0.0, cases)) == []


def test_a_large_change_moves_findings_and_is_taken_back(cases):
    before = FAULTS["link", "down"]
    moves = list(costs.find_moves(LINK_DOWN, 8.0, cases))
    assert moves and all(move.before != move.after for move in moves)
    assert FAULTS["link", "down"] == before


def test_an_id_of_no_finding_is_refused():
    with pytest.raises(KeyError):
        costs.find_key("RF-999")
