# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The methods of master_discovery; test_conformance_discovery.py and test_bounds.py call most of them over the network."""

import time

import pytest
from rosfleet_multimaster.discovery.rpc_methods import RpcMethods, ServedMaster
from rosfleet_multimaster.edge.rpc_server import PackedAnswer, RefusedCall
from rosfleet_multimaster.protocol.filters import Rules
from rosfleet_multimaster.protocol.graph import ExportPolicy, State, document
from rosfleet_multimaster.protocol.wire_filters import write_rules

URI = "http://own:11311/"


def test_a_whole_state_is_held_packed_by_each_connection():
    state = State(URI, "own", 1.0, 1.0, {"/one": ("/a",)})
    own = ServedMaster(URI, "own", "/master_discovery", lambda: "own", 11611, state, "")
    methods = RpcMethods(own, ExportPolicy(), {}, lambda _address: False, list, lambda _type: None, list).methods()
    whole = methods["masterInfo"].method("10.0.0.2")
    part = methods["masterInfoFiltered"].method("10.0.0.2", write_rules(Rules(), True))
    assert whole.packed == part.packed == PackedAnswer(document(state)).packed


@pytest.mark.parametrize("secret", ["(?:(?:){65000}){65000}x", ["/two", "/o.e"], [7], {"a": []}, ["/a*b"] * 10_000])
def test_secrets_that_are_no_names_keep_everything_secret(secret):
    state = State(URI, "own", 1.0, 1.0, {"/one": ("/a",), "/" + "a" * 254: ("/a",)})
    own = ServedMaster(URI, "own", "/master_discovery", lambda: "own", 11611, state, "")
    methods = RpcMethods(
        own, ExportPolicy(), {}, lambda _address: False, lambda: secret, lambda _type: None, list
    ).methods()
    started = time.thread_time()
    for method, arguments in (("masterInfo", []), ("masterInfoFiltered", [write_rules(Rules(), True)])):
        with pytest.raises(RefusedCall, match="/do_not_sync"):
            methods[method].method("10.0.0.2", *arguments)
    assert time.thread_time() - started < 0.5
    assert methods["masterContacts"]()[1] == URI
