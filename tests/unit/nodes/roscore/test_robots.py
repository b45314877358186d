# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The robots of the fleet, as the roscore knows them: read again where the file changes, and never a reason to end."""

import json
import os

import pytest
from rosfleet_multimaster.roscore.robots import EVERY, Robots


def write(path, hosts):
    member = {"robot": "robot2", "name": "robot2", "uris": [], "rpc_port": 11611, "addresses": [], "hosts": hosts}
    new = path.with_suffix(".new")
    new.write_text(json.dumps({"members": [member]}), "utf-8")
    os.replace(new, path)


def test_a_file_that_changes_is_read_again(tmp_path):
    path = tmp_path / "master_discovery.json"
    told = []
    robots = Robots(str(path), told.append)
    robots.look(100.0)
    assert robots.at("10.0.0.2") == "10.0.0.2", "without a plan, each address is one"
    write(path, ["10.0.0.2", "10.0.0.3"])
    robots.look(101.0)
    assert robots.at("10.0.0.2") == "10.0.0.2", "not yet"
    robots.look(100.0 + EVERY)
    assert robots.at("10.0.0.2") == robots.at("10.0.0.3") == "robot2" and robots.at("10.9.9.9") == ""
    assert told == [{"robot2", "", "allowed computers"}]
    write(path, ["10.0.0.4"])
    robots.look(100.0 + 2 * EVERY)
    assert robots.at("10.0.0.4") == "robot2" and robots.at("10.0.0.2") == ""


@pytest.mark.parametrize("text", ["", "{", "[]", '{"members": [1]}', '{"members": [{"robot": "x"}]}', "\xff"])
def test_a_file_that_is_none_changes_nothing(tmp_path, text):
    path = tmp_path / "master_discovery.json"
    write(path, ["10.0.0.2"])
    robots = Robots(str(path), lambda robots: None)
    robots.look(0.0)
    path.write_bytes(text.encode("latin-1"))
    robots.look(EVERY)
    assert robots.at("10.0.0.2") == "robot2"
    Robots("", lambda robots: None).look(0.0)
