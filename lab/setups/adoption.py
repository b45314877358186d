# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Inventories that playbooks/adopt.yml writes of a lab's computers, and the plan of an inventory."""

import json


def adopt(lab, folder, *options):
    """Run adopt.yml with nothing but the connection variables of the lab; returns status and output."""
    return _use_inventory(
        lab,
        lab.connection,
        lambda: lab.play("playbooks/adopt.yml", *options, variables={"adopt_inventory": str(folder)}),
    )


def site_check(lab, folder):
    """Run site.yml in check mode on an adopted inventory."""
    return _use_inventory(lab, folder, lambda: lab.play("site.yml", "--check", "--diff"))


def plan(lab, inventory):
    """The plan of an inventory, as data."""
    status, output = _use_inventory(lab, inventory, lambda: lab.module("localhost", "fleet_plan", {"group": "robots"}))
    assert status == 0, output
    return json.loads(output.partition("=>")[2])


def _use_inventory(lab, inventory, work):
    before, lab.inventory = lab.inventory, inventory
    try:
        return work()
    finally:
        lab.inventory = before
