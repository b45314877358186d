# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Questions to a roscore that answers as rosmaster does."""

import threading
import types
import xmlrpc.client
from xmlrpc.server import SimpleXMLRPCServer

import pytest
from rosfleet_multimaster.edge.roscore import Roscore, RoscoreGraph
from rosfleet_multimaster.edge.rpc_client import Last
from rosfleet_multimaster.protocol.json_text import pack_rows
from rosfleet_multimaster.protocol.mirror import CHANGES


@pytest.fixture(name="server")
def _server():
    made = SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False, allow_none=True)
    made.values = {"getPid": 7, "getParam": "x"}
    made.asked = []

    def dispatch(method, arguments):
        made.asked.append((method, *arguments))
        if method not in made.values:
            raise ValueError("not supported")
        return [1, "", made.values[method]] if made.values[method] else [-1, "refused", 0]

    made.register_instance(type("Methods", (), {"_dispatch": staticmethod(dispatch)})())
    made.register_multicall_functions()
    threading.Thread(target=made.serve_forever, args=(0.02,), daemon=True).start()
    yield made
    made.shutdown()
    made.server_close()


@pytest.fixture(name="roscore")
def _roscore(server):
    made = Roscore(f"http://127.0.0.1:{server.server_address[1]}", "/own", 10.0)
    yield made
    made.rpc.close()


@pytest.mark.parametrize("more", [[], [("getParam", "/x")]])
def test_an_answer_that_repeats_the_last_one_has_no_values(server, roscore, more):
    last, calls = Last(), [("getPid",), *more]
    first = roscore.ask(*calls, last=last)
    assert first == [7, "x"][: len(calls)] and roscore.ask(*calls, last=last) == []
    server.values["getPid"] = 8
    assert roscore.ask(*calls, last=last)[0] == 8 and roscore.ask(*calls, last=Last())[0] == 8
    assert server.asked[0] == ("getPid", "/own")


def test_what_is_refused_is_none_alone_and_among_others(server, roscore):
    server.values["getPid"] = None
    assert roscore.ask(("getPid",), last=Last()) == [None] == roscore.ask(("getPid",))
    assert roscore.ask(("missing",), last=Last()) == [None] and roscore.ask(("missing",), ("getParam",)) == [None, "x"]
    server.shutdown()
    server.server_close()
    with pytest.raises((OSError, xmlrpc.client.Error)):
        roscore.ask(("getPid",), last=Last())


# The registrations: read as a whole once, then only what changed; of any other roscore as a whole

WHOLE = [
    ["publisher", "/one", "/a", True],
    ["type", "/one", "std_msgs/String"],
    ["node", "/a", "http://own:1/"],
    ["service", "/a/ask", "/a", "rosrpc://own:2"],
]
SYSTEM = [[["/one", ["/a"]]], [], [["/a/ask", ["/a"]]]]
VALUES = {"getTopicTypes": [["/one", "std_msgs/String"]], "getSystemState": SYSTEM}
LOOKUPS = {"/a": "http://own:1/", "/a/ask": "rosrpc://own:2"}


class PlayedRoscore:
    """The answers of a roscore. `answers`: those of CHANGES, one after the other."""

    caller = "/master_sync"

    def __init__(self, answers, tells=True):
        self.answers, self.tells, self.asked = answers, tells, []
        self.rpc = types.SimpleNamespace(call=self.call, multicall=self.multicall)

    def has(self, method):
        self.asked.append("has")
        return self.tells and method == CHANGES

    def call(self, _method, _caller, epoch, revision, wait, in_texts):
        assert in_texts is True
        self.asked.append((epoch, revision, wait))
        answer = self.answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        if isinstance(answer, list) and len(answer) == 4 and isinstance(answer[3], list):
            answer = [*answer[:3], pack_rows(answer[3])]
        return [1, "changes", answer]

    def together(self, calls):
        self.asked.append(("together", calls))
        if isinstance(self.tells, Exception):
            raise self.tells
        return ["done"]

    def multicall(self, calls):
        self.asked.append(("multicall", calls))
        return ["done"]

    def ask(self, *calls):
        self.asked.append(calls[0][0])
        return [VALUES[call[0]] if call[0] in VALUES else LOOKUPS.get(call[1]) for call in calls]


def everything(view):
    return ["/a"], ["/a/ask"]


def shown(view):
    return (
        {name: tuple(nodes) for name, nodes in view.publishers.items()},
        {name: tuple(nodes) for name, nodes in view.services.items()},
        dict(view.types),
        dict(view.node_uris),
        dict(view.service_uris),
    )


def test_a_feed_and_whole_states_show_the_same():
    roscore = PlayedRoscore(
        [["e", 3, True, WHOLE], ["e", 4, False, [["publisher", "/two", "/a", True]]], ["e", 4, False, []]]
    )
    graph = RoscoreGraph(roscore)
    first = graph.read(everything)
    assert shown(first) == shown(RoscoreGraph(PlayedRoscore([], tells=False)).read(everything))
    assert sorted(graph.read(everything).publishers) == ["/one", "/two"] == sorted(graph.read(everything).publishers)
    assert sorted(first.publishers) == ["/one"], "a view is what it was"
    assert roscore.asked == ["has", ("", 0, 0), ("e", 3, 0), ("e", 4, 0)]


@pytest.mark.parametrize("answer", [xmlrpc.client.Fault(1, "8 callers"), ["e", 3, True, [["publisher"]]], ["e"], 7])
def test_a_roscore_that_tells_nothing_is_read_as_a_whole(answer):
    roscore = PlayedRoscore([answer, ["e", 3, True, WHOLE]])
    graph = RoscoreGraph(roscore)
    assert shown(graph.read(everything)) == shown(graph.read(everything))
    assert roscore.asked[-2:] == ["has", ("", 0, 0)]


def test_after_a_roscore_without_answer_the_next_one_is_asked():
    roscore = PlayedRoscore([["e", 3, True, WHOLE], OSError("refused")])
    graph = RoscoreGraph(roscore)
    graph.read(everything)
    with pytest.raises(OSError, match="refused"):
        graph.read(everything)
    roscore.tells = False
    assert sorted(graph.read(everything).publishers) == ["/one"] and roscore.asked.count("has") == 2


def test_a_bundled_roscore_gets_calls_together():
    calls = [("registerPublisher", "/a", "/one", "*", "http://own:1/")]
    roscore, other = PlayedRoscore([["e", 3, True, WHOLE]]), PlayedRoscore([], tells=False)
    for asked, way in ((roscore, "together"), (other, "multicall")):
        graph = RoscoreGraph(asked)
        graph.read(everything)
        assert graph.carry_out(calls) == ["done"] and asked.asked[-1] == (way, calls)


def test_after_failed_calls_the_next_one_is_asked_what_it_can():
    roscore = PlayedRoscore([["e", 3, True, WHOLE], ["f", 1, True, WHOLE]])
    graph = RoscoreGraph(roscore)
    graph.read(everything)
    roscore.tells = OSError("gone")
    with pytest.raises(OSError, match="gone"):
        graph.carry_out([])
    roscore.tells = True
    graph.read(everything)
    assert roscore.asked.count("has") == 2
