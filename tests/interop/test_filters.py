# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Each side honours the other's filters: those of the importing master_sync, and those of the serving master_discovery."""

import pytest
from fleet import DIRECTIONS, eventually

# The giver has these topics and these services; every filter leaves the first ones.
WANTED, UNWANTED = "/filters/wanted", "/filters/unwanted"
CASES = {
    "ignore_topics": ("sync", {"ignore_topics": ["/filters/un*"], "ignore_services": ["/filters/un*"]}),
    "sync_topics": ("sync", {"sync_topics": [WANTED], "sync_services": [f"{WANTED}/*"]}),
    "ignore_nodes": ("sync", {"ignore_nodes": ["/unwanted*"]}),
    "sync_nodes": ("sync", {"sync_nodes": ["/wanted*"]}),
    "ignore_publishers": ("sync", {"ignore_publishers": [UNWANTED], "ignore_services": [f"{UNWANTED}/*"]}),
    "for_one_master": (
        "sync",
        {"ignore_topics": [{"GIVER": [UNWANTED]}], "ignore_services": [{"GIVER": [f"{UNWANTED}/*"]}]},
    ),
    "do_not_sync": ("sync", {"do_not_sync": [UNWANTED, f"{UNWANTED}/*"]}),
    "hide_topics": ("discovery", {"hide_topics": [UNWANTED], "hide_services": [f"{UNWANTED}/*"]}),
    "hide_nodes": ("discovery", {"hide_nodes": ["/unwanted*"]}),
}


def there(computer):
    return sorted(name for name in computer.topics() + computer.services() if name.startswith("/filters/"))


@pytest.mark.parametrize(("giver", "taker"), DIRECTIONS, ids=lambda robot: robot.host)
@pytest.mark.parametrize(("node", "given"), CASES.values(), ids=CASES)
def test_a_filter_leaves_what_is_wanted(giver, taker, node, given):
    for_this_giver = {key: [named(item, giver) for item in items] for key, items in given.items()}
    with (taker if node == "sync" else giver).with_parameters(node, **for_this_giver):
        # In this order: when the wanted ones have crossed, the unwanted ones would have too.
        for name in (UNWANTED, WANTED):
            giver.start(name[9:], f"python3 /opt/interop/giver.py {name} __name:={name[9:]}_giver")
            offered = {name, f"{name}/call"}
            assert offered <= set(
                eventually(lambda: there(giver), lambda names, offered=offered: offered <= set(names))
            )
        assert eventually(lambda: there(taker), lambda names: offered <= set(names), 45) == sorted(offered)


def named(item, giver):
    """An entry for one master only names the giver."""
    return {giver.host: item["GIVER"]} if isinstance(item, dict) else item
