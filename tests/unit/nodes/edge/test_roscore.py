# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Questions to a roscore that answers as rosmaster does."""

import threading
import xmlrpc.client
from xmlrpc.server import SimpleXMLRPCServer

import pytest
from rosfleet_multimaster.edge.roscore import Roscore
from rosfleet_multimaster.edge.rpc_client import Last


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
