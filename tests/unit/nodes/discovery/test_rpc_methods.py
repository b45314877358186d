# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The methods of master_discovery; test_conformance_discovery.py and test_bounds.py call most of them over the network."""

from rosfleet_multimaster.discovery.rpc_methods import RpcMethods, ServedMaster
from rosfleet_multimaster.edge.rpc_server import PackedAnswer
from rosfleet_multimaster.protocol.filters import Rules
from rosfleet_multimaster.protocol.graph import Policy, State, document
from rosfleet_multimaster.protocol.wire_filters import write_rules

URI = "http://own:11311/"


def test_a_whole_state_is_held_packed_by_each_connection():
    state = State(URI, "own", 1.0, 1.0, {"/one": ("/a",)})
    own = ServedMaster(URI, "own", "/master_discovery", lambda: "own", 11611, state, "")
    methods = RpcMethods(own, Policy(), {}, lambda _address: False, list, lambda _type: None, list).methods()
    whole = methods["masterInfo"].method("10.0.0.2")
    part = methods["masterInfoFiltered"].method("10.0.0.2", write_rules(Rules(), True))
    assert whole.packed == part.packed == PackedAnswer(document(state)).packed
