# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""A state that cannot be had: the sentence in the log; and a master that lists what it has."""

import threading
from types import SimpleNamespace
from xmlrpc.server import SimpleXMLRPCServer

import pytest
from mentioned import mentions
from rosfleet_multimaster.protocol.differences import PACKED
from rosfleet_multimaster.protocol.members import Members
from rosfleet_multimaster.protocol.xml_rpc import DocumentTooLarge
from rosfleet_multimaster.sync.fetcher import Fetcher, _fetch

FETCH = SimpleNamespace(uri="http://b:11311/", monitor_uri="http://b:11611")


@pytest.mark.parametrize(
    ("problem", "end"),
    [
        (OSError("it does not answer"), '11611: "it does not answer"'),
        (
            DocumentTooLarge("it has more than 16777216 bytes"),
            '11611: "it has more than 16777216 bytes"; nothing new of it is taken, its registrations stay: leave out there the topics that '
            "nobody needs, by multimaster_exports",
        ),
    ],
)
def test_a_state_that_cannot_be_had_is_one_sentence(problem, end):
    said = []
    core = SimpleNamespace(members=Members(), take_fetch=lambda *arguments, **options: None)
    limited = SimpleNamespace(say=lambda level, key, sentence: said.append((level, sentence)))
    Fetcher(None, core, limited, None, None)._on_fetch(FETCH, None, problem)
    ((level, sentence),) = said
    assert level == "warning" and mentions(sentence, "http://b:11311/", "http://b")
    assert sentence.endswith(end)


@pytest.fixture(name="other_program")
def fixture_other_program():
    """A program that answers the method of changes with something else, and does not list it."""
    document = [
        "1.0",
        "1.0",
        "http://b:11311/",
        "b",
        [["/topic", ["/node"]]],
        [],
        [],
        [["/topic", "std_msgs/String"]],
        [],
        [],
    ]
    document[8] = [["/node", "http://b:40000/", "http://b:11311/", 1, "local"]]
    asked = []
    with SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False) as server:
        for name, answer in ((PACKED, ["something else"]), ("masterInfoFiltered", document)):
            server.register_function(lambda *_words, name=name, answer=answer: asked.append(name) or answer, name)
        server.register_function(lambda: ["masterInfoFiltered"], "system.listMethods")
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_address[1]}", asked
        server.shutdown()
        thread.join()


def test_a_master_is_asked_for_what_it_lists_alone(other_program):
    uri, asked = other_program
    fetch = SimpleNamespace(uri="http://b:11311/", monitor_uri=uri)
    states = SimpleNamespace(rules=[], limit=lambda state, before: state, find_misplaced=lambda state: {}, hold=print)
    found = _fetch(fetch, None, states, True)
    assert asked == ["masterInfoFiltered"]
    assert (found.state.name, found.follower) == ("b", None)
