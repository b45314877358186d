# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The owners of the services of discovery and sync nodes: names of all implementations, and places that may be anywhere."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.ros_client import node_services

ROSCORE = "http://robot1:11311/"
ADDRESSES = {"robot1": ["192.0.2.1"], "robot1.local": ["192.0.2.1"], "robot2": ["192.0.2.2"], "me": ["127.0.0.1"]}


@pytest.fixture
def found(monkeypatch):
    monkeypatch.setattr(node_services.network, "resolve", lambda host: (ADDRESSES.get(host, []), ""))
    monkeypatch.setattr(node_services, "_list_own_addresses", lambda: {"127.0.0.1", "192.0.2.1"})

    def find(places, end=node_services.LIST_MASTERS):
        def look_up(roscore, caller, method, name):
            if places[name] is None:
                raise OSError("unknown service")
            return places[name]

        monkeypatch.setattr(node_services, "ask", look_up)
        return node_services.find_own(ROSCORE, "/me", places, end)

    return find


@pytest.mark.parametrize("node", ["/master_discovery", "/mas_discovery", "/robot1/discovery"])
@pytest.mark.parametrize("host", ["robot1", "ROBOT1", "robot1.local", "me"])
def test_own_node_is_found_under_any_name(found, node, host):
    places = {f"{node}/list_masters": f"rosrpc://{host}:1", "/a/refresh": "rosrpc://robot1:2"}
    assert found(places) == [f"{node}/list_masters"]


def test_service_of_another_robot_is_not_taken(found):
    """Its sync node has registered it here, and its name comes first."""
    places = {"/mas_sync/get_sync_info": "rosrpc://robot2:1", "/my_sync/get_sync_info": "rosrpc://robot1:1"}
    assert found(places, node_services.SYNC_INFO) == ["/my_sync/get_sync_info"]
    assert found({"/mas_sync/get_sync_info": "rosrpc://robot2:1"}, node_services.SYNC_INFO) == []


def test_usual_names_come_first_and_unknown_places_last(found):
    places = {
        "/a/list_masters": "rosrpc://robot1:1",
        "/mas_discovery/list_masters": "rosrpc://robot1:1",
        "/b/list_masters": "rosrpc://nowhere:1",
        "/c/list_masters": None,
    }
    names = found(places)
    assert names == ["/mas_discovery/list_masters", "/a/list_masters", "/b/list_masters", "/c/list_masters"]


@pytest.mark.parametrize("place", ["", "http://[", "rosrpc://", "\u202e", "rosrpc://x:99999"])
def test_a_place_that_is_none_is_unknown(found, place):
    assert found({"/x/list_masters": place}) == ["/x/list_masters"]


def test_few_of_many_are_looked_at(found):
    places = {f"/{number:04}/list_masters": "rosrpc://robot1:1" for number in range(1000)}
    assert len(found({**places, "/mas_discovery/list_masters": "rosrpc://robot1:1"})) == node_services.MOST


def test_own_addresses_are_read():
    assert "127.0.0.1" in node_services._list_own_addresses()
