# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The times at which files and services were changed that may decide names and packet filters."""

import os

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.measure import changes

WHEN = "2001-09-09 01:46:40 UTC"


def write(path, when=1_000_000_000, content="content\n"):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(content)
    os.utime(path, (0, when))
    return str(path)


@pytest.fixture
def active(monkeypatch):
    """The names of the services that run; systemd tells."""
    names = set()

    def states(units, _properties):
        on = {"ActiveState": "active", "StateChangeTimestamp": "Sun 2026-11-22 09:12:44 UTC"}
        return [on if unit.partition(".")[0] in names else {"ActiveState": "inactive"} for unit in units]

    monkeypatch.setattr(changes.systemd, "states", states)
    return names


def test_the_last_changed_file_of_a_group_is_named(tmp_path, active):
    hosts = write(tmp_path / "etc" / "hosts")
    rules = write(tmp_path / "etc" / "ufw" / "user.rules")
    write(tmp_path / "etc" / "ufw" / "before.rules", 900_000_000)
    found = [(entry["about"], entry["what"], entry["when"]) for entry in changes.changes(str(tmp_path))]
    assert found == [("names", hosts, WHEN), ("ufw", rules, WHEN)]


def test_a_service_that_makes_rules_is_named_if_it_runs(tmp_path, active):
    active.update({"docker", "nftables"})
    (found,) = changes.changes(str(tmp_path))
    assert (found["about"], found["what"], found["how"]) == ("docker", "docker.service", "was started")


def test_a_file_of_nftables_counts_for_its_tables(tmp_path, active):
    path = write(
        tmp_path / "etc" / "nftables.conf",
        content="flush ruleset\n# table inet no\ntable inet filter {\n}\ndelete table ip gone\nadd table ip6 six;\ntable nat {\n}\n",
    )
    assert not changes.changes(str(tmp_path))  # its service does not run
    active.add("nftables")
    rows = changes.changes(str(tmp_path))
    assert [entry["about"] for entry in rows] == ["table inet filter", "table ip6 six", "table ip nat"]
    assert {(entry["what"], entry["when"]) for entry in rows} == {(path, WHEN)}


def test_a_file_with_very_many_tables_is_bounded(tmp_path, active):
    active.add("nftables")
    write(
        tmp_path / "etc" / "nftables.conf", content="".join(f"table inet t{number} {{\n}}\n" for number in range(9999))
    )
    assert len(changes.changes(str(tmp_path))) == changes.MOST_TABLES


def test_an_interface_without_a_line_in_the_journal_has_none():
    assert changes.carrier("no-such-interface.0") == ""
