# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
import pytest
from rosfleet_multimaster.protocol.filters import Filters
from rosfleet_multimaster.protocol.graph import Node, State
from rosfleet_multimaster.protocol.members import Members
from rosfleet_multimaster.protocol.messages import AnnouncedMaster, Registration, View
from rosfleet_multimaster.sync.core.sync import (
    NEVER,
    PATIENCE,
    Candidate,
    RegistrationConflict,
    Sync,
    calls,
    plan,
    select,
)

OWN = "http://robot1:11311/"
R2, R3 = "http://robot2:11311/", "http://robot3:11311/"
TALKER = ("/talker", "http://robot2:40000/")
CHATTER = Registration("publisher", "/chatter", *TALKER)
HEARD = Registration("subscriber", "/heard", *TALKER)
ADD = Registration("service", "/add", *TALKER, "rosrpc://robot2:50000")


def wanted(*items, master=R2, name="robot2"):
    types = {"/chatter": "std_msgs/String"}
    return [Candidate(item, master, name, types.get(item.name, "*")) for item in items]


def view(*items, node_uris=(), types=()):
    """A roscore with these registrations, and more nodes."""
    tables = {"publisher": {}, "subscriber": {}, "service": {}}
    uris, service_uris = dict(node_uris), {}
    for item in items:
        tables[item.kind].setdefault(item.name, []).append(item.node)
        uris[item.node] = item.node_uri
        if item.kind == "service":
            service_uris[item.name] = item.service_uri
    return View(tables["publisher"], tables["subscriber"], tables["service"], dict(types), uris, service_uris)


class Roscore:
    """A roscore: registrations, and the nodes that it shuts down."""

    def __init__(self, *own):
        self.items, self.shut_down = set(own), []

    def carry_out(self, todo):
        for call in calls(todo):
            verb, kind = (
                call[0][: -len(call[0].lstrip("abcdefghijklmnopqrstuvwxyz"))],
                call[0].lstrip("abcdefghijklmnopqrstuvwxyz").lower(),
            )
            node, name = call[1], call[2]
            if verb == "register":
                uri = call[-1]
                for old in [item for item in self.items if item.node == node and item.node_uri != uri]:
                    self.items.discard(old)
                    self.shut_down.append(old.node_uri)
                self.items.add(Registration(kind, name, node, uri, call[3] if kind == "service" else ""))
            else:
                key = call[3]
                self.items = {
                    i
                    for i in self.items
                    if not (i.kind == kind and i.name == name and i.node == node and key in (i.node_uri, i.service_uri))
                }

    def view(self):
        return view(*sorted(self.items))


def settle(roscore, items, claims):
    """Rounds until nothing changes; the last plan."""
    for _round in range(4):
        todo = plan(items, roscore.view(), claims)
        claims = todo.claims
        roscore.carry_out(todo)
    assert not todo.register and not todo.unregister
    return todo


def test_a_wanted_topic_has_the_remote_nodes_name_and_uri():
    todo = plan(wanted(CHATTER, HEARD, ADD), view(), {})
    assert calls(todo) == [
        ("registerPublisher", "/talker", "/chatter", "std_msgs/String", "http://robot2:40000/"),
        ("registerService", "/talker", "/add", "rosrpc://robot2:50000", "http://robot2:40000/"),
        ("registerSubscriber", "/talker", "/heard", "*", "http://robot2:40000/"),
    ]
    assert todo.claims == {TALKER: R2}
    assert set(todo.held) == {CHATTER, HEARD, ADD}


def test_what_is_there_is_not_registered_again():
    todo = plan(wanted(CHATTER, ADD), view(CHATTER, ADD), {TALKER: R2})
    assert calls(todo) == []
    assert set(todo.held) == {CHATTER, ADD}


def test_an_unwanted_topic_is_unregistered_then_unclaimed():
    todo = plan([], view(CHATTER, HEARD, ADD), {TALKER: R2})
    assert calls(todo) == [
        ("unregisterPublisher", "/talker", "/chatter", "http://robot2:40000/"),
        ("unregisterService", "/talker", "/add", "rosrpc://robot2:50000"),
        ("unregisterSubscriber", "/talker", "/heard", "http://robot2:40000/"),
    ]
    assert todo.claims == {TALKER: R2}  # until it is known to be gone
    assert plan([], view(), todo.claims).claims == {}


def test_registrations_of_the_own_robot_are_never_touched():
    own = Registration("publisher", "/chatter", "/own", "http://robot1:1/")
    todo = plan([], view(own), {TALKER: R2})
    assert calls(todo) == []


def test_a_killed_sync_finds_its_registrations_again():
    roscore = Roscore()
    claims = settle(roscore, wanted(CHATTER, ADD), {}).claims
    assert calls(plan(wanted(ADD), roscore.view(), claims)) == [
        ("unregisterPublisher", "/talker", "/chatter", "http://robot2:40000/")
    ]


def test_a_lost_registration_is_made_again():
    assert plan(wanted(CHATTER, ADD), view(CHATTER), {TALKER: R2}).register == [ADD]


# The collision guard


def test_a_node_with_the_name_of_an_own_one_is_refused():
    own = Registration("publisher", "/other", "/talker", "http://robot1:1/")
    roscore = Roscore(own)
    todo = settle(roscore, wanted(CHATTER, HEARD, ADD), {})
    assert todo.refused == [
        RegistrationConflict("node", "/talker", "robot2", "http://robot2:40000/", "http://robot1:1/")
    ]
    assert roscore.items == {own} and roscore.shut_down == []


def test_it_is_registered_when_the_own_node_has_gone():
    roscore = Roscore()
    todo = settle(roscore, wanted(CHATTER), {})
    assert todo.refused == [] and roscore.items == {CHATTER}


def test_an_own_node_seen_through_another_master_is_left_alone():
    own = Registration("publisher", "/chatter", *TALKER)
    todo = plan(wanted(CHATTER), view(own), {})
    assert (calls(todo), todo.refused, todo.claims) == ([], [], {})


def test_a_service_that_another_node_provides_is_refused():
    own = Registration("service", "/add", "/own", "http://robot1:1/", "rosrpc://robot1:2")
    todo = plan(wanted(CHATTER, ADD), view(own), {})
    assert todo.register == [CHATTER]
    assert todo.refused == [
        RegistrationConflict("service", "/add", "robot2", "rosrpc://robot2:50000", "rosrpc://robot1:2")
    ]


@pytest.mark.parametrize("holder", [R2, R3])
def test_of_two_masters_the_one_that_holds_a_name_keeps_it(holder):
    third = Registration("publisher", "/chatter", "/talker", "http://robot3:40000/")
    items = wanted(CHATTER) + wanted(third, master=R3, name="robot3")
    there = CHATTER if holder == R2 else third
    roscore = Roscore(there)
    todo = settle(roscore, items, {there.node_key: holder})
    assert roscore.items == {there} and roscore.shut_down == []
    assert [refusal.kind for refusal in todo.refused] == ["node"]


def test_of_two_masters_that_offer_a_service_one_is_registered():
    third = Registration("service", "/add", "/adder", "http://robot3:40000/", "rosrpc://robot3:1")
    roscore = Roscore()
    todo = settle(roscore, wanted(ADD) + wanted(third, master=R3, name="robot3"), {})
    assert roscore.items == {ADD}
    assert [(refusal.kind, refusal.master) for refusal in todo.refused] == [("service", "robot3")]


def test_a_restarted_remote_node_is_withdrawn_before_it_returns():
    again = CHATTER._replace(node_uri="http://robot2:40001/")
    roscore = Roscore(CHATTER, HEARD)
    settle(roscore, wanted(again), {TALKER: R2})
    assert roscore.items == {again} and roscore.shut_down == []


# What is selected


def state(stamp=1.0, local="local", origin=R2, kind="std_msgs/String", uri="http://robot2:40000/"):
    return State(
        uri=R2,
        name="robot2",
        stamp=stamp,
        local_stamp=stamp,
        publishers={"/chatter": ("/talker",)},
        subscribers={"/unknown": ("/talker",)},
        services={"/add": ("/talker",)},
        types={"/chatter": kind},
        nodes={"/talker": Node(uri, origin, local)},
        providers={"/add": Node("rosrpc://robot2:50000", origin, local)},
    )


RULES = Filters({}).rules("robot2")


def test_select():
    names = {item.name for item in select(state(), RULES, OWN, False)}
    assert names == {"/chatter", "/unknown", "/add"}


@pytest.mark.parametrize(
    ("given", "remote_nodes", "names"),
    [
        ({"local": "remote"}, False, set()),
        ({"local": "remote"}, True, {"/chatter", "/unknown", "/add"}),
        ({"local": "remote", "origin": R3}, True, set()),
        ({"origin": OWN}, True, set()),
        ({"uri": None}, False, set()),
        ({"kind": "*"}, False, {"/unknown", "/add"}),
        ({"kind": "None"}, False, {"/unknown", "/add"}),
    ],
)
def test_what_is_not_selected(given, remote_nodes, names):
    assert {item.name for item in select(state(**given), RULES, OWN, remote_nodes)} == names


# The other masters


def core(**filters):
    return Sync(Filters(filters), OWN, "/master_sync", False, bool(filters.pop("on_demand", False)), 0.0)


def announced(stamp=1.0, online=True, uri=R2, name="robot2"):
    return AnnouncedMaster(name, uri, f"http://{name}:11611", "/master_discovery", stamp, stamp, online)


def fetch(sync, now):
    (found,) = sync.due(now)
    return found


def synced():
    sync = core()
    sync.take_announcement(announced(), 0.0)
    assert sync.take_fetch(fetch(sync, 0.1), state(), 0.2)
    return sync


def test_several_changes_make_one_fetch_soon():
    sync = core()
    for now in (0.0, 0.02, 0.04):
        sync.take_announcement(announced(now + 1), now)
    assert sync.due(0.04) == []
    assert fetch(sync, 0.05).monitor_uri == "http://robot2:11611"
    assert sync.due(1.0) == []


def test_a_fetched_state_is_wanted_and_not_fetched_again():
    sync = synced()
    sync.take_announcement(announced(), 1.0)
    assert sync.due(2.0) == [] and sync.next_due() == NEVER
    assert {item.registration.name for item in sync.candidates(1.0)} == {"/chatter", "/unknown", "/add"}


def test_a_change_while_a_fetch_is_under_way_makes_another_one():
    sync = core()
    sync.take_announcement(announced(1.0), 0.0)
    first = fetch(sync, 0.1)
    sync.take_announcement(announced(2.0), 0.2)
    assert sync.due(1.0) == []
    sync.take_fetch(first, state(1.0), 1.0)
    assert len(sync.due(1.1)) == 1


def test_stamps_that_never_match_do_not_make_a_loop():
    sync = core()
    sync.take_announcement(announced(5.0), 0.0)
    sync.take_fetch(fetch(sync, 0.1), state(7.0), 0.2)
    sync.take_announcement(announced(5.0), 0.3)
    assert sync.next_due() == NEVER


def test_a_stamp_that_the_next_beat_corrects_ends_no_connection():
    """A silent master is asked over TCP. The answer has one stamp, of own nodes and of others', until the next heartbeat."""
    sync = core()
    sync.take_announcement(announced(1.0), 0.0)
    sync.take_fetch(fetch(sync, 0.1), state(1.0), 0.2, following=True)
    sync.take_announcement(announced(5.0), 1.0)
    assert sync.next_due() == pytest.approx(1.0 + PATIENCE)
    sync.take_announcement(announced(1.0), 1.4)
    assert sync.next_due() == NEVER
    sync.take_announcement(announced(5.0), 2.0)
    assert fetch(sync, 2.0 + PATIENCE), "one that stays is fetched"


def test_a_failed_fetch_keeps_the_old_state_and_slows_down():
    sync = synced()
    sync.take_announcement(announced(2.0), 10.0)
    now, pauses = 10.1, []
    for _attempt in range(6):
        failed = fetch(sync, now)
        assert sync.take_fetch(failed, None, now) is None
        assert sync.candidates(now)
        pauses.append(round(sync.next_due() - now, 3))
        now = sync.next_due()
    assert pauses == [0.2, 1.0, 3.0, 10.0, 30.0, 30.0]


def test_the_state_of_somebody_else_is_not_taken():
    sync = core()
    sync.take_announcement(announced(), 0.0)
    other = State(uri=R3, name="robot3")
    assert sync.take_fetch(fetch(sync, 0.1), other, 0.2) is None
    assert sync.candidates(0.2) == []


def test_offline_removed_and_back():
    sync = synced()
    sync.take_announcement(announced(online=False), 10.0)
    assert sync.candidates(10.0) == []
    sync.take_announcement(announced(), 20.0)
    sync.take_fetch(fetch(sync, 20.1), state(), 20.2)
    assert sync.candidates(20.2)
    sync.remove(R2)
    assert sync.candidates(20.3) == [] and sync.remotes == {}


def test_registrations_can_be_kept_while_offline():
    sync = Sync(Filters({}), OWN, "/master_sync", False, False, 30.0)
    sync.take_announcement(announced(), 0.0)
    sync.take_fetch(fetch(sync, 0.1), state(), 0.2)
    sync.take_announcement(announced(online=False), 10.0)
    assert sync.candidates(39.0) and sync.next_expiry(39.0) == 40.0
    assert not sync.candidates(40.0)


def test_a_list_that_is_incomplete_for_a_moment_removes_nobody():
    sync = synced()
    sync.take_list([], 10.0)
    sync.take_list([announced()], 20.0)
    sync.take_list([], 30.0)
    sync.take_list([], 44.0)
    assert sync.remotes
    sync.take_list([], 45.0)
    assert not sync.remotes


def test_a_list_says_nothing_of_masters_with_newer_news():
    sync = synced()
    sync.take_list([announced(online=False)], 10.0, {R2})
    assert sync.candidates(10.0)
    sync.remove(R2)
    sync.take_list([announced()], 11.0, {R2})
    assert not sync.remotes


def test_the_own_master_and_unwanted_hosts_are_not_synchronised():
    sync = core(ignore_hosts=["robot3"])
    sync.take_list([announced(uri=OWN, name="robot1"), announced(uri=R3, name="robot3")], 0.0)
    assert sync.remotes == {}


def test_on_demand_only_what_is_there():
    sync = core(on_demand=True)
    sync.take_announcement(announced(), 0.0)
    sync.take_fetch(fetch(sync, 0.1), state(), 0.2)
    assert {item.registration.name for item in sync.candidates(1.0, ["/chatter"])} == {"/chatter", "/add"}
    assert {item.registration.name for item in sync.candidates(1.0, [])} == {"/add"}


@pytest.mark.parametrize(
    ("filters", "names"),
    [
        ({"sync_topics": ["/scan"]}, {"/scan", "/chatter"}),
        ({"sync_nodes": ["/laser"]}, {"/scan", "/chatter"}),
        ({"sync_topics": ["/scan"], "ignore_topics": ["/chatter"]}, {"/scan"}),
        ({}, {"/chatter"}),
    ],
)
def test_a_white_list_admits_more_than_what_is_demanded(filters, names):
    sync = core(on_demand=True, **filters)
    sync.take_announcement(announced(), 0.0)
    publishers = {"/chatter": ("/talker",), "/scan": ("/laser",), "/map": ("/talker",)}
    nodes = {name: Node(f"http://robot2:4000{at}/", R2, "local") for at, name in enumerate(("/talker", "/laser"))}
    found = State(R2, "robot2", 1.0, 1.0, publishers, types=dict.fromkeys(publishers, "std_msgs/String"), nodes=nodes)
    asked = fetch(sync, 0.1)
    assert all(asked.rules.topic(nodes[0], topic, "x/Y", True) for topic, nodes in publishers.items() if topic in names)
    sync.take_fetch(asked, found, 0.2)
    assert {item.registration.name for item in sync.candidates(1.0, ["/chatter"])} == names


@pytest.mark.parametrize("kind", ["", "*", "None"])
def test_a_type_that_nobody_knows_is_not_told_to_the_roscore(kind):
    sync = core()
    sync.take_announcement(announced(), 0.0)
    sync.take_fetch(fetch(sync, 0.1), state(kind=kind), 0.2)
    assert {item.type for item in sync.candidates(1.0)} == {"*"}


def test_a_subscriber_is_told_the_publishers_here_and_at_home():
    sync = synced()
    hearing = CHATTER._replace(kind="subscriber")
    here = ["http://robot1:1/", "http://robot2:40000/"]
    assert sync.publishers_for(hearing, R2, here) == here
    assert sync.publishers_for(hearing, R2, here[:1]) == here
    assert sync.publishers_for(hearing, R2, []) == sync.publishers_for(hearing, R3, here) == []


def test_a_subscriber_whose_roscore_has_all_is_told_nothing():
    """rospy that is told twice of a publisher connects twice, and loses what came by the first connection."""
    sync = synced()
    hearing, there = CHATTER._replace(kind="subscriber"), "http://robot2:40000/"
    assert sync.publishers_for(hearing, R2, [there]) == []
    assert sync.publishers_for(hearing, R2, ["http://robot1:1/"]) == ["http://robot1:1/", there]


def test_a_subscriber_of_a_member_keeps_publishers_elsewhere():
    """A node of its robot at an address that the plan does not have, or one of a third robot: roscpp would leave it."""
    sync = synced()
    sync.remotes[R2].misplaced = {"http://robot2:40000/": "it is elsewhere"}
    hearing, here = CHATTER._replace(kind="subscriber"), ["http://robot1:1/"]
    assert sync.publishers_for(hearing, R2, here) == [], "a stranger's says what it likes"
    known = {"robot": "robot2", "name": "robot2", "uris": [R2], "rpc_port": 11611, "addresses": [], "hosts": ["robot2"]}
    sync.members = Members.from_parameters({"members": [known]})
    assert sync.publishers_for(hearing, R2, here) == [*here, "http://robot2:40000/"]


@pytest.mark.parametrize("filters", [{"ignore_publishers": ["/chatter"]}, {"do_not_sync": ["/chatter"]}])
def test_a_subscriber_with_unseen_publishers_is_told_nothing(filters):
    sync = core(**filters)
    sync.take_announcement(announced(), 0.0)
    sync.take_fetch(fetch(sync, 0.1), state(), 0.2)
    assert sync.publishers_for(CHATTER._replace(kind="subscriber"), R2, ["http://robot1:1/"]) == []


def test_a_master_unwanted_under_its_new_name_goes():
    sync = Sync(Filters({"ignore_hosts": ["other"]}), OWN, "/master_sync", False, False, 0.0)
    sync.take_announcement(announced(), 0.0)
    sync.take_announcement(announced(2.0, name="other"), 1.0)
    assert not sync.remotes
