# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_keys: each computer speaks for itself, and the file is the old one or the new one."""

import base64
import types
from pathlib import Path

import pytest
from acting import act
from ansible.playbook.task import Task
from ansible_collections.rosfleet.multimaster.plugins.action import fleet_keys
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain import to_plain
from fleets import plan

ONE, TWO = "kobuki1computer", "kobuki2computer"
FLEET = to_plain(
    plan(
        multimaster_tunnel="wireguard",
        multimaster_transport="unicast",
        multimaster_firewall="fleet",
    )
)


def key(number):
    return base64.b64encode(bytes([number]) * 32).decode()


@pytest.fixture(name="gather")
def fixture_gather(tmp_path):
    path = tmp_path / "keys.txt"

    def run(told, check=False, rotate=False, folders=None, path=path):
        task = Task()
        task.action, task.async_val, task.check_mode = "rosfleet.multimaster.fleet_keys", 0, check
        task.args = {"fleet": FLEET, "told": "own", "path": str(path), "rotate": rotate}
        connection = types.SimpleNamespace(_shell=types.SimpleNamespace(tmpdir=None))
        module = fleet_keys.ActionModule(task, connection, None, None, None, None)
        hostvars = {
            host: {"own": result, "inventory_dir": (folders or {}).get(host, "/inventory")}
            for host, result in told.items()
        }
        return act(module, {"hostvars": hostvars, "ansible_play_hosts_all": list(told)})

    run.path = path
    return run


def test_keys_are_kept_for_runs_without_their_computers(gather):
    first = gather({ONE: {"public_key": key(1)}})
    assert first["changed"] and first["keys_by_computer"] == {ONE: key(1)} and TWO in first["warnings"][0]
    second = gather({TWO: {"public_key": key(2)}})
    assert second["keys_by_computer"] == {ONE: key(1), TWO: key(2)} and not second["warnings"]
    assert not gather({ONE: {"failed": True, "msg": "no answer"}})["changed"]
    assert [entry.name for entry in gather.path.parent.iterdir()] == ["keys.txt"]


def test_check_mode_writes_nothing(gather):
    found = gather({ONE: {"public_key": key(1)}}, check=True)
    assert found["changed"] and found["diff"]["after"].endswith(f"{ONE} {key(1)}\n") and not gather.path.exists()


def test_a_changed_key_leaves_the_file_as_it_was(gather):
    gather({ONE: {"public_key": key(1)}, TWO: {"public_key": key(2)}})
    before = gather.path.read_text()
    found = gather({ONE: {"public_key": key(3)}, TWO: {"public_key": key(2)}})
    assert not found.get("failed") and gather.path.read_text() == before, "the others go on"
    assert list(found["refused"]) == [ONE] and f"{ONE}: its public key is {key(3)}" in found["refused"][ONE]
    assert found["keys_by_computer"] == {ONE: key(1), TWO: key(2)}
    assert gather({ONE: {"public_key": key(3)}}, rotate=True)["keys_by_computer"][ONE] == key(3)


@pytest.mark.parametrize("content", [b"\xff\xfe", b"a b c\n", b"name \x1b[2J\n"])
def test_a_strange_file_is_a_sentence(gather, content):
    gather.path.write_bytes(content)
    found = gather({ONE: {"public_key": key(1)}})
    assert found["failed"] and "No tunnel was changed" in found["msg"] and "\x1b" not in found["msg"]
    assert gather.path.read_bytes() == content


def test_a_key_that_waits_counts_where_it_is_the_kept_one(gather):
    """As after a rotation that broke off on the computer, and not here."""
    gather({ONE: {"public_key": key(2), "waiting_key": ""}})
    found = gather({ONE: {"public_key": key(1), "waiting_key": key(2)}})
    assert not found["changed"] and found["keys_by_computer"][ONE] == key(2)
    assert gather({ONE: {"public_key": key(1), "waiting_key": key(3)}})["refused"]


def test_several_inventories_have_one_place_for_keys(gather, tmp_path):
    """With two of them the file would be that of the computer which comes first in a run."""
    told = {ONE: {"public_key": key(1)}, TWO: {"public_key": key(2)}}
    folders = {ONE: str(tmp_path), TWO: "/other"}
    found = gather(told, folders=folders)
    assert found["failed"] and f"found inventories in /other, {tmp_path}; expected one" in found["msg"]
    assert gather(told, folders=dict.fromkeys(told), path=Path("None/keys.txt"))["failed"]
    assert not gather(told, folders={**folders, ONE: "/one"}).get("failed")  # a place of its own


def test_a_link_stays_one_and_so_do_the_permissions(gather, tmp_path):
    target = tmp_path / "repository.txt"
    target.write_text("")
    target.chmod(0o640)
    gather.path.symlink_to(target)
    gather({ONE: {"public_key": key(1)}})
    assert gather.path.is_symlink() and ONE in target.read_text() and target.stat().st_mode & 0o777 == 0o640
