# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_adopt: what the machines registered in, a folder out, or one sentence."""

import contextlib
import os
import types

import pytest
from acting import act
from ansible.playbook.task import Task
from ansible_collections.rosfleet.multimaster.plugins.action import fleet_adopt
from mentioned import mentions
from shown import machine, read_folder, roscore

INFOS = {
    name: machine(name, f"192.168.1.{number}/24", masters=[roscore(name, f"192.168.1.{number}")])
    for number, name in enumerate(("ana-pc", "bob-pc"), 10)
}


class Hosts(dict):
    """Return what Ansible hands out as hostvars, as far as it is looked at."""

    def __init__(self, infos, given=None):
        super().__init__({name: {"adopt_found": info} for name, info in infos.items()})
        everybody = types.SimpleNamespace(depth=0, priority=1, name="all", vars={"ansible_user": "operator"})
        self._inventory = types.SimpleNamespace(
            get_host=lambda name: types.SimpleNamespace(
                get_groups=lambda: [everybody], vars=(given or {}).get(name, {})
            )
        )


def adopt(folder, infos=INFOS, check=False, diff=False, given=None, **options):
    task = Task()
    task.action, task.async_val = "rosfleet.multimaster.fleet_adopt", 0
    task.args = {"machines": list(infos), "machine": "adopt_found", "path": str(folder), **options}
    task.check_mode, task.diff = check, diff
    connection = types.SimpleNamespace(_shell=types.SimpleNamespace(tmpdir=None))
    return act(fleet_adopt.ActionModule(task, connection, None, None, None, None), {"hostvars": Hosts(infos, given)})


def test_a_folder_is_written_as_a_whole(tmp_path):
    folder = tmp_path / "below" / "fleet"
    result = adopt(folder)
    assert result["changed"] and not result["problems"] and not result["left_out"] and "diff" not in result
    assert result["msg"].startswith(f"Wrote {folder}: 2 robots with 2 computers")
    assert dict(read_folder(folder).robots) == {"ana": ["ana-pc"], "bob": ["bob-pc"]}
    assert {str(path.relative_to(folder)): path.read_text() for path in folder.rglob("*.yml")} == result["files"]
    assert "ansible_user: operator" in result["files"]["group_vars/robots.yml"]
    assert [path.name for path in folder.parent.iterdir()] == ["fleet"]


def test_a_part_of_a_machine_without_an_answer_is_told(tmp_path):
    unread = {
        **INFOS,
        "bob-pc": {**INFOS["bob-pc"], "exports": [], "problems": ["The part exports could not be read."]},
    }
    (warning,) = adopt(tmp_path / "fleet", unread)["warnings"]
    assert mentions(warning, "bob-pc", "The part exports could not be read.", "run it again")


def test_check_mode_writes_nothing_and_the_difference_shows_all(tmp_path):
    result = adopt(tmp_path / "fleet", check=True, diff=True)
    assert result["changed"] and not list(tmp_path.iterdir())
    assert [entry["after"] for entry in result["diff"]] == list(result["files"].values())


def test_a_folder_with_something_in_it_stays(tmp_path):
    (tmp_path / "mine").write_text("mine")
    result = adopt(tmp_path)
    assert result["failed"] and mentions(result["msg"], tmp_path, "empty")
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]
    assert adopt(tmp_path / "mine")["failed"]


def test_an_empty_folder_is_taken(tmp_path):
    assert not adopt(tmp_path).get("failed") and (tmp_path / "hosts.yml").exists()


def test_a_place_that_cannot_be_written_is_one_sentence(tmp_path):
    (tmp_path / "file").write_text("")
    result = adopt(tmp_path / "file" / "fleet")
    assert result["failed"] and "cannot be written" in result["msg"] and "adopt_inventory" in result["msg"]


@pytest.mark.parametrize(
    "error", [UnicodeEncodeError("utf-8", "x", 0, 1, "a surrogate"), KeyboardInterrupt(), OSError(28, "full")]
)
def test_an_end_half_way_leaves_nothing(tmp_path, monkeypatch, error):
    def rename(*_paths):
        raise error

    monkeypatch.setattr(os, "rename", rename)
    with contextlib.suppress(UnicodeEncodeError, KeyboardInterrupt):
        assert adopt(tmp_path / "fleet")["failed"]
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("info", "why"),
    [
        ({"unreachable": True, "msg": "Failed to connect\x1b[2J."}, "it cannot be reached (Failed to connect\\x1b[2J)"),
        ({"failed": True, "msg": "Missing sudo password"}, "it could not be read (Missing sudo password)"),
        ({}, "it could not be read (it was not looked at)"),
        ({**INFOS["ana-pc"], "masters": 1}, "its answer cannot be understood"),
    ],
)
def test_a_machine_that_was_not_read_is_named_and_left_out(tmp_path, info, why):
    result = adopt(tmp_path, {**INFOS, "husky": info})
    assert (
        result["left_out"][0].startswith(f"husky: left out, since {why}") and result["left_out"] == result["warnings"]
    )
    assert f"# Left out: husky, since {why}" in result["files"]["hosts.yml"]


def test_without_a_robot_nothing_is_written(tmp_path):
    result = adopt(tmp_path / "fleet", {"laptop": machine("laptop", "192.168.1.9/24")})
    assert result["failed"] and mentions(result["msg"], "1", "roscore")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("options", "begin"), [({"machines": []}, "The list of machines is empty"), ({"path": ""}, "The option path")]
)
def test_options_that_make_no_sense_are_one_sentence(tmp_path, options, begin):
    result = adopt(tmp_path / "fleet", **options)
    assert result["failed"] and result["msg"].startswith(begin) and not list(tmp_path.iterdir())


def test_what_is_encrypted_is_only_named(tmp_path):
    given = {"ana-pc": {"ansible_host": object(), "ansible_password": "hunter2"}}
    text = "".join(adopt(tmp_path, given=given)["files"].values())
    assert "hunter2" not in text and text.count("a secret, which is not written here") == 2
