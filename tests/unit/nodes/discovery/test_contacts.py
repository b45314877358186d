# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Sentences about names that lead elsewhere, and the times of other masters."""

import socket
import threading
import time

import pytest
from rosfleet_multimaster.discovery.contacts import Contacts, ask_time
from rosfleet_multimaster.discovery.core.health import Health
from rosfleet_multimaster.discovery.core.peer import Contact
from rosfleet_multimaster.edge.loop import Loop, Workers
from rosfleet_multimaster.edge.process import program
from rosfleet_multimaster.edge.rpc_server import RpcServer
from rosfleet_multimaster.protocol.members import Members
from rosfleet_multimaster.protocol.messages import AnnouncedMaster

ROBOT2 = Contact(1.0, "http://robot2:11311/", "robot2", "/master_discovery")


def make_contacts(errors, known):
    loop = Loop()
    return Contacts(
        loop,
        Workers(loop, 1),
        program.LimitedLog(),
        errors,
        lambda uri: uri in known,
        lambda address: True,
        lambda *result: True,
    )


def test_what_is_said_of_a_master_that_is_not_known_is_not_kept():
    errors, known = {}, []
    contacts = make_contacts(errors, known)
    contacts._compare(ROBOT2, "192.168.1.2", "", None)
    assert errors == {}
    known.append(ROBOT2.uri)
    contacts._compare(ROBOT2, "192.168.1.2", "", None)
    assert list(errors) == [ROBOT2.uri]


@pytest.mark.parametrize(
    ("problem", "is_said"),
    [
        (socket.gaierror(-2, "unknown"), True),
        (UnicodeError("no name"), True),
        (OSError("too much to do at once"), False),
    ],
)
def test_only_a_name_that_was_looked_up_has_no_address(problem, is_said):
    errors = {}
    make_contacts(errors, [ROBOT2.uri])._on_host(ROBOT2, "192.168.1.2", None, problem)
    assert list(errors) == [ROBOT2.uri] * is_said


class Now:
    """Workers that do it at once."""

    def submit(self, job, done):
        try:
            done(job(), None)
        except (OSError, ValueError) as problem:
            done(None, problem)


@pytest.mark.parametrize(
    ("answer", "offset"), [(lambda: ["http://x:1/", time.time() + 3.0], 3.0), (lambda: ["x", "y"], None), (None, None)]
)
def test_the_offset_is_measured_and_nonsense_is_none(answer, offset):
    server = RpcServer("127.0.0.1", 0, {"getCurrentTime": answer} if answer else {}, lambda _host, _why: None)
    try:
        monitor = f"http://127.0.0.1:{server.server_address[1]}"
        master = AnnouncedMaster("robot2", "http://robot2:11311/", monitor, "/d", 1.0, 1.0, True)
        health = Health("http://own:11311/", Members())
        assert health.question([master], 0.0) == master
        if answer is None:
            with pytest.raises(Exception, match="getCurrentTime"):
                ask_time(master, Now(), health)
        else:
            ask_time(master, Now(), health)
    finally:
        threading.Thread(target=server.stop).start()
    (link,) = health.links([master], []).links
    assert (link.answer is None) == (offset is None)
    if link.answer is not None:
        assert link.answer.offset == pytest.approx(offset, abs=0.5) and 0 < link.answer.seconds < 3
