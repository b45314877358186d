# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Waiting for a roscore, with the programs as a unit starts them, and one that answers as a roscore does."""

import ast
import os
import pathlib
import subprocess
import sys
import threading
import xmlrpc.server

import pytest
from mentioned import mentions

FOLDER = pathlib.Path(__file__).parents[3] / "roles/nodes/files/python"


class Master:
    """The part of the master API that is asked."""

    def __init__(self):
        self.parameters = {"/master_sync": {"sync_topics": ["/old"]}}
        self.looks = 0

    def getUri(self, _caller):
        return 1, "", "http://here:11311/"

    def setParam(self, _caller, name, value):
        self.parameters[name] = value
        return 1, "", 0

    def lookupService(self, _caller, name):
        self.looks += 1
        return (1, "", "rosrpc://here:1") if name == "/there" and self.looks > 2 else (-1, "no provider", "")


@pytest.fixture(name="master")
def fixture_master():
    master = Master()
    with xmlrpc.server.SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False) as server:
        server.register_instance(master)
        thread = threading.Thread(target=server.serve_forever, args=(0.05,))
        thread.start()
        master.uri = "http://127.0.0.1:%d" % server.server_address[1]
        yield master
        server.shutdown()
        thread.join()


def wait(uri, *arguments):
    """(status, error) of the program."""
    done = subprocess.run(
        [sys.executable, "-m", "rosfleet_multimaster.wait_for_master", *arguments],
        env={**os.environ, "PYTHONPATH": str(FOLDER), "PYTHONDONTWRITEBYTECODE": "1", "ROS_MASTER_URI": uri},
        capture_output=True,
        text=True,
        check=False,
        timeout=30,
    )
    return done.returncode, done.stderr


def test_a_roscore_that_answers(master):
    assert wait(master.uri) == (0, "")


@pytest.mark.slow
def test_nobody_there_is_one_sentence():
    status, error = wait("http://127.0.0.1:9", "--timeout", "0.3")
    assert (status, error.count("\n")) == (1, 1)
    assert mentions(error, "roscore", "http://127.0.0.1:9") and error.endswith("(after 0.3 s)\n")


@pytest.mark.slow
def test_parameters_take_the_place_of_older_ones(master, tmp_path):
    (tmp_path / "master_sync.json").write_text('{"ignore_topics": ["/tf", {"tibi-pc": ["/map"]}]}')
    assert wait(master.uri, "--set", "/master_sync", str(tmp_path / "master_sync.json")) == (0, "")
    assert master.parameters == {"/master_sync": {"ignore_topics": ["/tf", {"tibi-pc": ["/map"]}]}}


@pytest.mark.slow
def test_a_service_that_comes_later(master):
    assert wait(master.uri, "--service", "/there") == (0, "")
    assert master.looks == 3


@pytest.mark.slow
def test_a_service_that_never_comes(master):
    status, error = wait(master.uri, "--service", "/nowhere", "--timeout", "0.5")
    assert (status, error) == (1, f'the roscore at {master.uri} says: "no provider" (after 0.5 s)\n')


#: what units use where ROS itself is of Python 2, and so no other module of the nodes -> what it imports of them
OLD = {
    "wait_for_master": ["edge.journal", "protocol.plain_text"],
    "run_plain": ["edge.journal", "edge.process.children"],
    "edge/process/children": [],
    "edge/journal": ["protocol.plain_text"],
    "protocol/plain_text": [],
}


@pytest.mark.parametrize("name", OLD)
def test_it_is_for_the_python_of_ubuntu_18_too(name):
    tree = ast.parse((FOLDER / f"rosfleet_multimaster/{name}.py").read_text(), feature_version=(3, 6))
    imported = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    assert [node.module for node in imported if node.level or node.module == "__future__"] == OLD[name]
