# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The process that is kept for the next run of a module: its door, what it runs, and what came in the archive."""

import json
import os
import sys
import threading
import zipfile

import pytest
from ansible.module_utils import basic
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import kept, left_behind

FORMER = {"ANSIBLE_MODULE_ARGS": {"state": "started", "_ansible_version": "2.19", "_ansible_check_mode": True}}


@pytest.fixture(autouse=True)
def _former(monkeypatch):
    monkeypatch.setattr(basic, "_ANSIBLE_ARGS", json.dumps(FORMER).encode())
    monkeypatch.setattr(kept, "_asker", 0)
    monkeypatch.setattr(kept.warnings, "_global_warnings", {"of the first run": None})


def echo():
    """A module that returns its options."""
    print("\n" + basic._ANSIBLE_ARGS.decode())
    sys.exit(1)


def test_a_run_has_its_own_options_and_what_ansible_said_to_the_first():
    found = kept.result(echo, {"state": "collected", "_ansible_check_mode": False})["ANSIBLE_MODULE_ARGS"]
    assert found == {"state": "collected", "_ansible_version": "2.19", "_ansible_check_mode": False}
    assert not kept.warnings._global_warnings
    assert sys.stdout is sys.__stdout__ or not hasattr(sys.stdout, "getvalue")


@pytest.mark.parametrize("main", [lambda: None, lambda: print("no result")])
def test_a_module_that_says_nothing_has_no_result(main):
    with pytest.raises(ValueError):
        kept.result(main, {})


@pytest.fixture
def door(tmp_path):
    """Serve one visitor; returns the path of the door."""
    path = str(tmp_path / "door.sock")
    listening = left_behind.open_door(path)
    thread = threading.Thread(target=kept.serve, args=(listening, path, echo, 10.0))
    thread.start()
    yield path
    thread.join(10)
    listening.close()
    assert not thread.is_alive() and not os.path.exists(path)


def test_it_answers_the_one_visitor_and_is_gone(door):
    assert os.stat(door).st_mode & 0o777 == 0o600
    assert kept.asker() == 0
    found = left_behind.Visit(door, {"run": {"state": "collected"}}).reply(5)
    assert found["ANSIBLE_MODULE_ARGS"]["state"] == "collected"
    assert kept.asker() == os.getpid(), "the kernel says who asked"


@pytest.mark.parametrize("request_", [{"do": "end"}, {"run": "state"}, {}])
def test_it_ends_without_an_answer_where_nothing_is_to_be_run(door, request_):
    assert left_behind.Visit(door, request_).reply(5) is None


def test_it_waits_no_longer_than_it_may(tmp_path):
    path = str(tmp_path / "door.sock")
    with left_behind.open_door(path) as listening:
        kept.serve(listening, path, echo, 0.05)
    assert not os.path.exists(path)


def test_what_came_in_the_archive_is_there_after_it(tmp_path, monkeypatch):
    package = "ansible_collections/rosfleet/multimaster/plugins/module_utils"
    archive = tmp_path / "module.zip"
    with zipfile.ZipFile(archive, "w") as made:
        for name in ("_machine/ends.py", "_machine/__init__.py", "_verify/packets.py", "_verify/not_there_at_all.py"):
            made.writestr(f"{package}/{name}", "")
    name = package.replace("/", ".") + "._verify.packets"
    monkeypatch.delitem(sys.modules, name, raising=False)
    kept.load(str(archive))
    assert name in sys.modules
    kept.load("")


def test_a_place_without_doors_is_no_failure(monkeypatch):
    def refuse(path):
        raise PermissionError(path)

    monkeypatch.setattr(kept, "open_door", refuse)
    monkeypatch.setattr(kept, "leave", lambda *arguments: pytest.fail("no process is kept"))
    kept.keep(echo, "x", 1.0)


def test_an_error_of_the_module_is_its_result(tmp_path):
    path = str(tmp_path / "door.sock")
    with left_behind.open_door(path) as listening:
        thread = threading.Thread(target=kept.serve, args=(listening, path, lambda: 1 / 0, 10.0))
        thread.start()
        found = left_behind.Visit(path, {"run": {}}).reply(5)
        thread.join(10)
    assert found["failed"] and "ZeroDivisionError" in found["msg"] and "Traceback" in found["exception"]


def test_the_door_of_a_killed_process_is_opened_again(tmp_path, monkeypatch):
    monkeypatch.setattr(left_behind, "FOLDER", str(tmp_path))
    path = left_behind.path_of(kept.KIND, "x")
    left_behind.open_door(path).close()
    with kept._opened(path) as listening:
        assert listening.getsockname() == path


def test_where_no_process_can_be_made_the_run_goes_on(tmp_path, monkeypatch):
    def refuse(*arguments):
        raise BlockingIOError

    monkeypatch.setattr(left_behind, "FOLDER", str(tmp_path))
    monkeypatch.setattr(kept, "leave", refuse)
    kept.keep(echo, "x", 1.0)
    assert not list(tmp_path.glob("*"))
