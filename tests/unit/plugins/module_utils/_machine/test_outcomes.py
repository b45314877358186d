# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Outcomes of real sockets, and of errors."""

import errno
import os
import socket
import struct

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._contract.outcomes import Outcome
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import outcomes


def test_a_connection_is_open_refused_or_has_no_name():
    with socket.socket() as there:
        there.bind(("127.0.0.1", 0))
        port = there.getsockname()[1]
        assert outcomes.connect("127.0.0.1", port, 1.0)[:3] == (Outcome.REFUSED, errno.ECONNREFUSED, None)
        there.listen()
        opened = outcomes.connect("127.0.0.1", port, 1.0)
        assert opened.outcome == Outcome.OPEN and opened.milliseconds >= 0 and not opened.error
    assert outcomes.connect("no.such.name.invalid", 1, 1.0)[:2] == (Outcome.UNKNOWN_NAME, None)


@pytest.mark.parametrize("name", ["kobuki2computer..local", "x" * 64, "\ud800"])
def test_a_name_that_is_none_is_unknown(name):
    found = outcomes.connect(name, 1, 1.0)
    assert found[:3] == (Outcome.UNKNOWN_NAME, None, None) and found.words == found.error != ""


def test_a_connection_that_the_other_side_ends_is_reset():
    with socket.create_server(("127.0.0.1", 0)) as there, socket.create_connection(there.getsockname()) as here:
        other, _address = there.accept()
        other.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        other.close()
        with pytest.raises(OSError) as problem:
            here.recv(1)
    assert outcomes.classify_error(problem.value) == (Outcome.RESET, errno.ECONNRESET)


@pytest.mark.parametrize(
    ("number", "outcome"),
    [
        (errno.ENETUNREACH, Outcome.NETWORK_UNREACHABLE),
        (errno.EHOSTUNREACH, Outcome.HOST_UNREACHABLE),
        (errno.EADDRNOTAVAIL, Outcome.NO_LOCAL_PORT),
        (errno.ETIMEDOUT, Outcome.NO_ANSWER),
        (errno.ECONNRESET, Outcome.RESET),
        (errno.EMFILE, Outcome.NO_FILE),
        (errno.ENFILE, Outcome.NO_FILE_HERE),
        (errno.ENOBUFS, Outcome.NO_MEMORY),
        (errno.ENOMEM, Outcome.NO_MEMORY),
        (errno.EPERM, Outcome.NOT_PERMITTED),
        (errno.EACCES, Outcome.CLOSED_ROUTE),
        (errno.EINVAL, Outcome.CLOSED_ROUTE),
        (errno.EIO, Outcome.FAILED),
    ],
)
def test_an_error_of_the_kernel_is_one_outcome(number, outcome):
    assert outcomes.classify_error(OSError(number, os.strerror(number))) == (outcome, number)


def test_anything_else_failed():
    assert outcomes.classify_error(None) == outcomes.classify_error(ValueError()) == (Outcome.FAILED, None)
