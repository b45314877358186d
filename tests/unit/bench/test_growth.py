# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The inventory and the tables of the growth."""

from tests.bench.site import growth


def test_an_inventory_has_all_computers_with_their_own_addresses():
    for computers in growth.COMPUTERS:
        robots = growth.inventory(computers)["robots"]["children"]
        hosts = {host: values for robot in robots.values() for host, values in robot["hosts"].items()}
        assert len(hosts) == len({values["multimaster_address"] for values in hosts.values()}) == computers
        assert all(robot["vars"]["multimaster_master"] in robot["hosts"] for robot in robots.values())


def test_the_tables_have_a_line_for_each_size():
    report = {
        "site": [{"computers": 100, "seconds": 28.2, "processor": 34.0}],
        "functions": [{"robots": 100, "plan": 0.08, "judgement": 4.2, "findings": 1599600, "sampled": 2.18}],
    }
    text = growth.site_table(report) + growth.functions_table(report)
    assert all(word in text for word in ("100 computers", "0.34 s", "1,599,600", "2.18 s"))
