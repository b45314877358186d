# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""master_sync against upstream's interface, and without upstream's defects.

The numbers in the names are those of the list of upstream's defects (15) and of the checklist for own nodes (16.B); what a
test of one part holds is not here again. The program is the real one, with real XML-RPC to a roscore, a discovery and nodes that this file plays;
only rospy is not there.
"""

import pathlib
import socket
import threading
import time

import pytest
import rosfleet_multimaster
from rosfleet_multimaster.edge import patience
from rosfleet_multimaster.protocol import parameters
from rosfleet_multimaster.protocol.imports import IMPORTS
from rosfleet_multimaster.sync.core.sync import NEVER
from running_sync import DISCOVERY, Lab, serve, until

FOLDER = pathlib.Path(rosfleet_multimaster.__file__).parent
R2 = "http://robot2:11311/"


@pytest.fixture(name="lab")
def _lab(monkeypatch, tmp_path):
    lab = Lab(monkeypatch, tmp_path)
    yield lab
    lab.end()


# The checklist


def test_16_b2_registrations_are_reported_before_they_are_made(lab):
    seen = []

    def before(method, arguments):
        if method == "registerPublisher":
            reported = {(item.name, item.node) for item in lab.nodes[0].held()}
            seen.append(((arguments[0], "/talker") in reported, "/talker" in lab.roscore.parameters[IMPORTS]))

    lab.roscore.before = lambda method, arguments: lab.nodes and before(method, arguments)
    lab.start()
    until(lambda: lab.has("Publisher", "/chatter", "/talker"))
    assert seen == [(True, True)]


def test_16_b3_callers_are_remote_nodes_at_the_own_roscore_only(lab):
    lab.other.subscribers = {"/heard": ["/hearer"]}
    lab.start()
    until(lambda: lab.has("Subscriber", "/heard", "/hearer"))
    uri = lab.other.node_uri
    assert lab.roscore.made("/talker") == [("registerPublisher", "/talker", "/chatter", "std_msgs/String", uri)]
    assert lab.roscore.made("/hearer") == [("registerSubscriber", "/hearer", "/heard", "*", uri)]
    assert lab.other.roscore_calls == {}


def test_16_b4_master_tells_an_imported_subscriber_publishers(lab):
    lab.roscore.call("registerPublisher", "/own", "/heard", "std_msgs/String", "http://127.0.0.1:9/")
    lab.other.subscribers = {"/heard": ["/hearer"]}
    lab.start()
    until(lambda: lab.other.updates)
    assert lab.other.updates == [("/master", "/heard", ["http://127.0.0.1:9/"])]


def test_16_c_discovery_is_known_by_its_type_and_service_names(lab):
    for table in lab.roscore.tables.values():
        table.clear()
    lab.discovered("/zeroconf", "/zeroconf/news", "old_msgs/MasterState")
    lab.start()
    until(lambda: lab.has("Publisher", "/chatter", "/talker"))
    assert lab.nodes[0].topic == "/zeroconf/news" and set(lab.asked_list) == {"/zeroconf/list_masters"}


@pytest.mark.slow
def test_a_discovery_that_ends_is_asked_again_when_it_returns(lab):
    lab.start()
    until(lambda: lab.asked_list)
    line, _address = lab.discovery.accept()
    lab.discovery.close()
    line.close()
    time.sleep(0.2)
    count = len(lab.asked_list)
    time.sleep(1.2)
    assert len(lab.asked_list) == count
    with socket.create_server(("127.0.0.1", 0)) as another:
        lab.discovery_uri = f"http://127.0.0.1:{another.getsockname()[1]}/"
        lab.discovered(DISCOVERY, f"{DISCOVERY}/changes", "x/MasterState")
        until(lambda: len(lab.asked_list) > count)


# The defects


@pytest.mark.slow
def test_15_3_a_fault_instead_of_a_state_changes_nothing(lab):
    lab.start()
    until(lambda: lab.has("Publisher", "/chatter", "/talker"))
    lab.other.fault, lab.other.publishers, count = True, {}, len(lab.other.asked)
    lab.other_changes()
    until(lambda: len(lab.other.asked) > count + 1)
    assert lab.has("Publisher", "/chatter", "/talker")
    lab.other.fault = False
    until(lambda: not lab.has("Publisher", "/chatter", "/talker"))


def test_15_4_a_call_that_the_roscore_refused_is_repeated(lab):
    lab.roscore.fail = 2
    started = time.monotonic()
    lab.start()
    until(lambda: lab.has("Publisher", "/chatter", "/talker"))
    assert time.monotonic() - started < 5 and lab.roscore.fail == 0


def test_15_4_what_the_roscore_has_lost_is_registered_again(lab):
    lab.start()
    until(lambda: lab.has("Publisher", "/chatter", "/talker"))
    lab.roscore.tables["Publisher"]["/chatter"].clear()
    lab.own("registerPublisher", "/own", "/other", "std_msgs/String", "http://own:3/")
    until(lambda: lab.has("Publisher", "/chatter", "/talker"))


def test_15_5_a_change_registers_only_the_difference(lab):
    lab.other.subscribers = {"/heard": ["/hearer"]}
    lab.start()
    until(lambda: lab.has("Subscriber", "/heard", "/hearer"))
    before = len(lab.roscore.calls)
    lab.other.subscribers = {"/heard": ["/hearer"], "/more": ["/hearer"]}
    lab.other_changes()
    until(lambda: lab.has("Subscriber", "/more", "/hearer"))
    assert [call[2] for call in lab.roscore.calls[before:]] == ["/more"]


def test_15_5_a_subscriber_that_hangs_delays_no_other(lab):
    release = threading.Event()
    server, uri = serve({"publisherUpdate": lambda *call: release.wait(60) and [1, "", 0]})
    for name in ("/heard", "/later"):
        lab.roscore.call("registerPublisher", "/own", name, "std_msgs/String", "http://127.0.0.1:9/")
    lab.other.nodes = {"/talker": uri}
    lab.other.subscribers = {"/heard": ["/talker"], "/later": ["/hearer"]}
    started = time.monotonic()
    lab.start()
    until(lambda: lab.other.updates)
    assert time.monotonic() - started < 30
    release.set()
    server.stop()


def test_15_6_a_node_with_the_name_of_an_own_one_ends_no_node(lab):
    lab.roscore.call("registerPublisher", "/talker", "/own_topic", "std_msgs/String", "http://own:3/")
    lab.start()
    until(lab.warnings)
    assert lab.roscore.shut_down == [] and lab.roscore.nodes["/talker"] == "http://own:3/"
    assert not lab.has("Publisher", "/chatter", "/talker")
    _limits, names, kinds, *_others = lab.diagnostics.diagnoses[-1]
    assert names[2][0][0] == "node /talker" and kinds[2] == []


def test_15_6_a_state_that_comes_during_a_round_waits(lab):
    """Nobody has looked yet whether the names in it are free."""
    lab.roscore.call("registerPublisher", "/talker", "/mine", "std_msgs/String", "http://127.0.0.1:9/")
    answer, waited = lab.roscore.call, []

    def slow(method, *arguments):
        found = answer(method, *arguments)
        if method == "getSystemState" and lab.program.rounds.working and not waited:
            until(lambda: any(remote.state for remote in lab.program.core.remotes.values()))
            waited.append(True)
        return found

    lab.roscore.call = slow
    lab.start()
    until(lambda: lab.program.refusals)
    assert waited
    assert [call[2] for call in lab.roscore.made("/talker")] == ["/mine"]


def test_15_7_a_node_on_a_second_computer_is_exchanged(lab):
    lab.other.nodes = {"/talker": "http://robot2-arm:40000/"}
    lab.start()
    until(lambda: lab.has("Publisher", "/chatter", "/talker"))
    assert lab.roscore.nodes["/talker"] == "http://robot2-arm:40000/"


def test_15_8_registrations_are_recorded_outside_of_master_sync(lab):
    lab.start()
    until(lambda: lab.has("Publisher", "/chatter", "/talker"))
    assert lab.other.uri in lab.roscore.parameters[IMPORTS]
    assert {item.node for item in lab.nodes[0].held()} == {"/talker"}


def test_15_14_filters_are_parameters_and_no_yaml_file_is_loaded():
    _values, warnings = parameters.overlay(parameters.SYNC, {"interface_url": "file:///x.yaml"})
    assert warnings == ["~interface_url has no effect: filters are parameters here: give the lists themselves"]
    assert not any("import yaml" in path.read_text(encoding="utf-8") for path in FOLDER.rglob("*.py"))


def test_a_hung_service_of_discovery_does_not_stop_the_exchange():
    forever, started = threading.Event(), time.monotonic()
    for _count in range(6):
        with pytest.raises(TimeoutError):
            patience.run_with_limit(0.05, forever.wait)
    assert time.monotonic() - started < 10
    assert sum(1 for thread in threading.enumerate() if thread in patience._hanging) == 4
    forever.set()
    until(lambda: not any(thread.is_alive() for thread in patience._hanging))
    assert patience.run_with_limit(1.0, lambda: "answer") == "answer"
    with pytest.raises(ZeroDivisionError):
        patience.run_with_limit(1.0, lambda: 1 / 0)


@pytest.mark.slow
def test_while_a_slow_roscore_is_waited_for_nothing_spins(lab):
    ticks = []
    tick = lab.module.MasterSync._tick
    lab.module.MasterSync._tick = lambda self, now: ticks.append(now) or tick(self, now)
    lab.start()
    until(lambda: lab.has("Publisher", "/chatter", "/talker"))
    answer = lab.roscore.server.methods["system.multicall"]
    lab.roscore.server.methods["system.multicall"] = lambda calls: time.sleep(1.5) or answer(calls)
    time.sleep(0.7)
    ticks.clear()
    time.sleep(2.0)
    lab.roscore.server.methods["system.multicall"] = answer
    assert len(ticks) < 20


def test_a_type_conflict_is_refused_and_both_kinds_are_published(lab):
    node, uri = serve(
        {
            "getPublications": lambda caller: [1, "", []],
            "getSubscriptions": lambda caller: [1, "", [["/chatter", "std_msgs/Int32"]]],
        }
    )
    lab.roscore.call("registerSubscriber", "/own", "/chatter", "std_msgs/Int32", uri)
    lab.start()
    until(lab.warnings)
    _limits, names, kinds, *_others = lab.diagnostics.diagnoses[-1]
    assert names[:2] == ("multimaster: names", "OK") and kinds[2][0][0] == "topic /chatter"
    assert not lab.has("Publisher", "/chatter", "/talker")
    lab.own("unregisterSubscriber", "/own", "/chatter", uri)
    until(lambda: lab.has("Publisher", "/chatter", "/talker"))
    until(lambda: not lab.warnings())  # it is said when all calls have been answered
    node.stop()


def test_a_node_that_is_refused_for_its_place_is_told_at_once(lab):
    """Nothing else changes by it, so no round may come for long."""
    lab.start()
    until(lambda: lab.has("Publisher", "/chatter", "/talker"))
    lab.program.loop.post(lambda: setattr(lab.program.rounds, "tick", lambda now: NEVER))
    lab.other.nodes["/talker"] = f"{lab.other.node_uri}path"
    lab.other_changes()
    until(lab.warnings)
    (places,) = lab.warnings()
    assert places.name == "multimaster: places" and places.values[0][0] == "node or service /talker"
    lab.other.nodes.clear()
    lab.other_changes()
    until(lambda: not lab.warnings())
