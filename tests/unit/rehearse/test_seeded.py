# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Each seeded mistake that needs no machine is told by its sentence, and the shipped inventories have none."""

import pytest
import seeded
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory.read import (
    Inventory,
    InventoryProblems,
    read_fleet,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.plan import fleet_plan
from rehearsals import rehearsal

MISTAKES = seeded.load()


def refused(mistake):
    """The sentences of the plan."""
    inventory = Inventory(mistake.robots(), mistake.variables(), mistake.strays(), mistake.routers())
    try:
        fleet_plan(read_fleet(inventory))
    except InventoryProblems as found:
        return found.problems
    return []


def noted(mistake):
    """The first lines of a rehearsal."""
    values = {
        "robots": mistake.robots(),
        "variables": mistake.variables(),
        "routers": mistake.routers(),
        "networks": [],
    }
    return list(rehearsal.make_rehearsable(values).notes)


def of(*who):
    return [pytest.param(mistake, id=mistake.name) for mistake in MISTAKES if mistake.told in who]


@pytest.mark.parametrize("mistake", of(seeded.PLAN, seeded.REHEARSAL))
def test_a_mistake_is_told(mistake):
    sentences = refused(mistake) if mistake.told == seeded.PLAN else noted(mistake)
    for words in mistake.words:
        assert any(words in sentence for sentence in sentences), sentences


@pytest.mark.parametrize("mistake", of(seeded.MACHINE, seeded.PREDICTION))
def test_what_only_a_machine_shows_is_no_contradiction(mistake):
    """tests/long/test_seeded.py shows that preflight or the prediction tells these on real systems."""
    assert refused(mistake) == []


@pytest.mark.parametrize("layout", sorted({mistake.layout for mistake in MISTAKES}))
def test_the_shipped_inventories_have_no_mistake(layout):
    shipped = seeded.Mistake("none", "", layout, seeded.PLAN, ())
    assert refused(shipped) == noted(shipped) == []


def test_there_are_enough_of_them():
    assert len(of(seeded.PLAN, seeded.REHEARSAL)) >= 20
    assert {mistake.told for mistake in MISTAKES} == {seeded.PLAN, seeded.REHEARSAL, seeded.MACHINE, seeded.PREDICTION}
