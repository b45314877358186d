# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Replacing /etc/hosts for real: by rename and on a bind mount, killed at any moment; and the module as it is run."""

import errno
import io
import json
import os
import pathlib
import random
import signal
import subprocess
import time

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.hosts import file as hosts_file
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.hosts.bindings import bindings_of
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem
from mentioned import mentions
from processes import with_paths

from tests.unit import module_server

COLLECTION = pathlib.Path(__file__).parents[6]
MODULE = "hosts_entries"
ENTRIES = [
    {"address": "192.168.1.229", "names": ["kobuki1computer"]},
    {"address": "192.168.1.239", "names": ["kobuki2computer"]},
]
OLD = b"127.0.0.1 localhost\n127.0.1.1 kobuki1computer\n"
NEW = (
    b"127.0.0.1 localhost\n"
    b"# rosfleet.multimaster replaced: 127.0.1.1 kobuki1computer\n"
    b"192.168.1.229\tkobuki1computer # rosfleet.multimaster\n"
    b"192.168.1.239\tkobuki2computer # rosfleet.multimaster\n"
)
# A mount namespace of its own, with the file mounted on itself, as container engines do with /etc/hosts.
MOUNTED = ["unshare", "--mount", "--propagation", "private", "sh", "-ec", 'mount --bind "$0" "$0"; exec "$@"']
needs_mounts = pytest.mark.skipif(
    os.geteuid() != 0
    or subprocess.run(["unshare", "--mount", "true"], stderr=subprocess.DEVNULL, check=False).returncode != 0,
    reason="needs to be root, with mount namespaces",
)


class Machine:
    """A folder that stands for a machine, and the module run on it as Ansible runs it: a program of its own."""

    def __init__(self, folder):
        self.hosts = folder / "etc" / "hosts"
        self.records = folder / "records"
        self.arguments = folder / "arguments.json"
        self.hosts.parent.mkdir()
        self.hosts.write_bytes(OLD)

    def given(self, options):
        arguments = {
            "entries": ENTRIES,
            "path": str(self.hosts),
            "records": str(self.records),
            "own_name": "kobuki1computer",
        }
        return {**arguments, **options}

    def command(self, mounted=False, **options):
        self.arguments.write_text(json.dumps({"ANSIBLE_MODULE_ARGS": self.given(options)}))
        program = [*module_server.command(MODULE), str(self.arguments)]
        return [*MOUNTED, str(self.hosts), *program] if mounted else program

    def run(self, mounted=False, **options):
        if not mounted:
            return json.loads(module_server.run(MODULE, self.given(options)).stdout)
        done = subprocess.run(
            self.command(mounted, **options), env=environment(), capture_output=True, text=True, check=False
        )
        return json.loads(done.stdout)

    def left(self):
        """The files beside the file, and in the folder of records."""
        records = [path.name for path in self.records.iterdir()] if self.records.exists() else None
        return [path.name for path in self.hosts.parent.iterdir()], records


def environment():
    return with_paths()


@pytest.fixture
def machine(tmp_path):
    return Machine(tmp_path)


def test_apply_again_and_take_back(machine):
    machine.hosts.chmod(0o640)
    os.chown(machine.hosts, 12, 34) if os.geteuid() == 0 else None
    before = machine.hosts.stat()

    planned = machine.run(_ansible_check_mode=True)
    assert planned["changed"] and planned["written"] == ""
    assert machine.hosts.read_bytes() == OLD
    assert (planned["diff"]["before"], planned["diff"]["after"]) == (OLD.decode(), NEW.decode())

    applied = machine.run()
    assert machine.hosts.read_bytes() == NEW
    assert (applied["changed"], applied["written"], applied["repaired"]) == (True, "rename", False)
    assert applied["diff"] == planned["diff"]
    assert mentions(applied["msg"], "2", "127.0.1.1", "kobuki1computer", "own", "loopback")
    after = machine.hosts.stat()
    assert (after.st_mode, after.st_uid, after.st_gid) == (before.st_mode, before.st_uid, before.st_gid)

    again = machine.run()
    assert (again["changed"], again["written"]) == (False, "")
    assert machine.hosts.stat().st_ino == after.st_ino
    assert again["msg"].endswith("2 unchanged.")

    back = machine.run(entries=[])
    assert back["changed"]
    assert mentions(back["msg"], "2", "127.0.1.1 kobuki1computer")
    assert machine.hosts.read_bytes() == OLD
    assert machine.run(entries=[])["changed"] is False
    assert machine.left() == (["hosts"], None)


def test_a_conflict_changes_nothing_unless_only_reported(machine):
    machine.hosts.write_bytes(OLD + b"192.168.1.99 kobuki1computer\n")
    failed = machine.run()
    assert failed["failed"] and not failed["changed"]
    assert mentions(failed["msg"], machine.hosts, "3", "kobuki1computer", "192.168.1.99", "192.168.1.229")
    assert machine.hosts.read_bytes() == OLD + b"192.168.1.99 kobuki1computer\n"
    reported = machine.run(on_conflict="report")
    assert reported["changed"] and reported["conflicts"] == failed["conflicts"]
    assert "line 3 gives kobuki1computer" in json.dumps(reported["warnings"])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"entries": [{"address": "x", "names": ["a"]}]}, "entries[0]: the address is 'x'"),
        ({"entries": ENTRIES + ENTRIES[:1]}, "entries[0] and entries[2] both have the address"),
        ({"path": "etc/hosts"}, "expected an absolute path"),
    ],
)
def test_wrong_options_change_nothing(machine, options, message):
    result = machine.run(**options)
    assert result["failed"] and message in result["msg"]
    assert machine.hosts.read_bytes() == OLD


def test_a_folder_and_a_missing_folder_are_named(machine):
    assert "Is a directory" in machine.run(path=str(machine.hosts.parent))["msg"]
    missing = machine.run(path=str(machine.hosts.parent / "no" / "hosts"))
    assert missing["failed"] and "No such file or directory" in missing["msg"]


def test_a_missing_file_is_made_and_goes_again(machine):
    machine.hosts.unlink()
    assert machine.run()["written"] == "rename"
    assert machine.hosts.read_bytes().startswith(b"# rosfleet.multimaster created this file\n192.168.1.229\t")
    assert machine.run(entries=[])["written"] == "removed"
    assert machine.left() == ([], None)


def test_the_target_of_a_link_is_written(machine):
    link = machine.hosts.parent / "link"
    link.symlink_to("hosts")
    result = machine.run(path=str(link))
    assert result["path"] == str(machine.hosts)
    assert link.is_symlink() and machine.hosts.read_bytes() == NEW


@pytest.mark.slow
def test_a_run_that_is_killed_leaves_the_old_or_the_new_file(machine):
    contents = set()
    for number in range(16):
        machine.hosts.write_bytes(OLD)
        child = subprocess.Popen(machine.command(), env=environment(), stdout=subprocess.DEVNULL)
        time.sleep(number * 0.02)
        child.kill()
        child.wait()
        contents.add(machine.hosts.read_bytes())
    assert OLD in contents and contents <= {OLD, NEW}
    machine.run()
    assert machine.hosts.read_bytes() == NEW
    assert machine.left() == (["hosts"], None)


def replace_in_place_until(hosts, records, content, bytes_left):
    """Write in place in a child that is killed after so many bytes; whether it was."""

    class Killing(io.FileIO):
        def write(self, data):
            nonlocal bytes_left
            done = super().write(data[:bytes_left])
            bytes_left -= done
            if not bytes_left:
                os.kill(os.getpid(), signal.SIGKILL)
            return done

    child = os.fork()
    if child == 0:
        hosts_file.open = lambda path, mode, buffering: Killing(path, "r+")
        hosts_file.HostsFile(str(hosts), str(records))._replace_in_place(content)
        os._exit(0)
    return os.WIFSIGNALED(os.waitpid(child, 0)[1])


@pytest.mark.slow
@pytest.mark.parametrize(("before", "after"), [(OLD, NEW), (NEW, OLD)])
def test_a_write_in_place_killed_at_any_byte_is_repaired(tmp_path, before, after):
    hosts, records = tmp_path / "hosts", tmp_path / "records"
    torn = 0
    for position in range(1, len(after) + 1):
        hosts.write_bytes(before)
        assert replace_in_place_until(hosts, records, after, position)
        file = hosts_file.HostsFile(str(hosts), str(records))
        assert file.content in (before, after)
        assert file.was_torn == (hosts.read_bytes() not in (before, after))
        torn += file.was_torn
        assert file.replace(after) == "rename"
        file.clean()
        assert hosts.read_bytes() == after
        assert not records.exists()
    assert torn > 20


def fill_up(monkeypatch, times):
    """The file takes 60 bytes, then refuses so many writes, as a file system does that is full."""

    class Full(io.FileIO):
        def write(self, data):
            nonlocal times
            if self.tell() == 60 and times:
                times -= 1
                raise OSError(errno.ENOSPC, "No space left on device")
            return super().write(data[:60] if times else data)

    monkeypatch.setattr(hosts_file, "open", lambda path, mode, buffering: Full(path, "r+"), raising=False)


def test_a_refused_write_in_place_is_taken_back(tmp_path, monkeypatch):
    hosts, records = tmp_path / "hosts", tmp_path / "records"
    hosts.write_bytes(OLD)
    fill_up(monkeypatch, times=1)
    with pytest.raises(OSError, match="No space left"):
        hosts_file.HostsFile(str(hosts), str(records))._replace_in_place(NEW)
    assert hosts.read_bytes() == OLD
    assert not records.exists()


def test_a_refused_write_without_a_way_back_is_repaired_later(tmp_path, monkeypatch):
    hosts, records = tmp_path / "hosts", tmp_path / "records"
    hosts.write_bytes(NEW)
    fill_up(monkeypatch, times=2)
    with pytest.raises(Problem, match="neither.*written"):
        hosts_file.HostsFile(str(hosts), str(records))._replace_in_place(NEW[:60].upper() + NEW)
    later = hosts_file.HostsFile(str(hosts), str(records))
    assert later.content == NEW and (records / "hosts_entries.json").exists()


def test_what_somebody_else_wrote_after_a_killed_write_is_theirs(tmp_path):
    hosts, records = tmp_path / "hosts", tmp_path / "records"
    hosts.write_bytes(OLD)
    assert replace_in_place_until(hosts, records, NEW, 60)
    hosts.write_bytes(b"127.0.0.1 localhost\n10.0.0.1 container\n")
    file = hosts_file.HostsFile(str(hosts), str(records))
    assert not file.was_torn and file.content == b"127.0.0.1 localhost\n10.0.0.1 container\n"
    file.clean()
    assert not records.exists()


@pytest.mark.parametrize(
    ("found", "torn"),
    [
        (b"new", True),
        (b"", True),
        (b"\0\0\0", True),
        (b"nld and longer", True),
        (b"olw", True),
        (b"new\0\0\0\0\0\0\0\0\0\0\0", True),
        (b"old and longer!", False),
        (b"xld", False),
    ],
)
def test_is_torn(found, torn):
    assert hosts_file.is_torn(found, b"old and longer", b"new") is torn


def test_a_change_between_looking_and_writing_is_not_lost(tmp_path):
    hosts = tmp_path / "hosts"
    hosts.write_bytes(OLD)
    file = hosts_file.HostsFile(str(hosts), str(tmp_path / "records"))
    hosts.write_bytes(OLD + b"10.0.0.1 new\n")
    with pytest.raises(Problem, match="changed by something else"):
        file.replace(NEW)
    assert hosts.read_bytes() == OLD + b"10.0.0.1 new\n"


@needs_mounts
def test_a_mounted_file_is_written_in_place(machine):
    inode = machine.hosts.stat().st_ino
    result = machine.run(mounted=True)
    assert (result["changed"], result["written"], result["repaired"]) == (True, "in_place", False)
    assert machine.hosts.read_bytes() == NEW
    assert machine.run(mounted=True)["changed"] is False
    assert machine.run(mounted=True, entries=[])["written"] == "in_place"
    assert machine.hosts.read_bytes() == OLD
    assert machine.hosts.stat().st_ino == inode
    assert machine.left() == (["hosts"], None)


@needs_mounts
def test_a_full_file_system_leaves_a_mounted_file_as_it_was(machine, tmp_path):
    small = tmp_path / "small"
    small.mkdir()
    script = (
        'mount -t tmpfs -o size=8k none "$1"; cp "$0" "$1/hosts"; mount --bind "$1/hosts" "$1/hosts"; '
        'head -c 4096 /dev/zero > "$1/full"; shift; "$@"; cat "$MOUNTED" >&2'
    )
    machine.hosts.write_bytes(OLD + b"# " + b"x" * 4000 + b"\n")
    command = machine.command(path=str(small / "hosts"))
    done = subprocess.run(
        [
            "unshare",
            "--mount",
            "--propagation",
            "private",
            "sh",
            "-c",
            script,
            str(machine.hosts),
            str(small),
            *command,
        ],
        env={**environment(), "MOUNTED": str(small / "hosts")},
        capture_output=True,
        check=False,
    )
    assert "No space left on device" in json.loads(done.stdout)["msg"]
    assert done.stderr == machine.hosts.read_bytes()
    assert machine.left() == (["hosts"], None)


@pytest.mark.slow
@needs_mounts
def test_a_mounted_file_is_repaired_after_kills_in_the_middle(machine):
    """Big enough to be hit while it is written: the record stands exactly as long as the writing takes."""
    big = OLD + b"# " + b"x" * 2_000_000 + b"\n"
    record = machine.records / "hosts_entries.json"
    for attempt in range(8):
        machine.hosts.write_bytes(big)
        child = subprocess.Popen(machine.command(mounted=True), env=environment(), stdout=subprocess.DEVNULL)
        while child.poll() is None and not record.exists():
            time.sleep(0.0005)
        time.sleep(random.uniform(0, 0.004))
        child.kill()
        child.wait()
        wanted = machine.hosts.read_bytes() not in (big, big.replace(OLD, NEW))
        result = machine.run(mounted=True)
        assert result["repaired"] is wanted
        assert machine.hosts.read_bytes() == big.replace(OLD, NEW)
        assert machine.left() == (["hosts"], None)


@needs_mounts
def test_a_torn_mounted_file_is_repaired_by_the_module(machine):
    assert replace_in_place_until(machine.hosts, machine.records, NEW, 60)
    torn = machine.hosts.read_bytes()
    assert torn not in (OLD, NEW)
    planned = machine.run(mounted=True, _ansible_check_mode=True)
    assert planned["changed"] and planned["repaired"] and planned["diff"]["before"] == torn.decode()
    assert machine.hosts.read_bytes() == torn
    repaired = machine.run(mounted=True, entries=[])
    assert (repaired["changed"], repaired["repaired"], repaired["written"]) == (True, True, "in_place")
    assert "torn by a run that was ended" in repaired["msg"]
    assert machine.hosts.read_bytes() == OLD
    assert machine.left() == (["hosts"], None)


@needs_mounts
def test_the_machine_answers_with_the_planned_addresses(machine):
    """The scratch file mounted over /etc/hosts, so that libc reads it; the real one is not touched."""
    script = 'mount --bind "$0" /etc/hosts; exec "$@"'

    def run(**options):
        command = machine.command(path="/etc/hosts", **options)
        program = ["unshare", "--mount", "--propagation", "private", "sh", "-ec", script, str(machine.hosts), *command]
        return json.loads(
            subprocess.run(program, env=environment(), capture_output=True, text=True, check=False).stdout
        )

    real = pathlib.Path("/etc/hosts").read_bytes()
    result = run()
    assert [entry["resolved"] for entry in result["entries"]] == [
        {"kobuki1computer": ["192.168.1.229"]},
        {"kobuki2computer": ["192.168.1.239"]},
    ]
    assert result["unresolved"] == []
    assert run(_ansible_check_mode=True)["entries"][0]["resolved"] == {}
    assert pathlib.Path("/etc/hosts").read_bytes() == real


def test_no_name_is_asked_for_after_the_time():
    bindings = bindings_of(ENTRIES)
    assert list(hosts_file.resolve(bindings, seconds=0)) == [{}, {}]


def test_a_pipe_in_the_place_of_the_file_is_named_without_a_hang(machine):
    machine.hosts.unlink()
    os.mkfifo(str(machine.hosts))
    assert f"{machine.hosts} cannot be read (Is a pipe (FIFO))" in machine.run()["msg"]


@pytest.mark.parametrize(
    "content", ['{"FILE": 5}', '{"FILE": {"before": "a"}}', '{"FILE": {"before": "a", "after": "\\u1234"}}']
)
def test_a_malformed_record_is_one_sentence(machine, content):
    machine.records.mkdir()
    (machine.records / "hosts_entries.json").write_text(content.replace("FILE", str(machine.hosts)))
    result = machine.run()
    assert result["failed"] and mentions(result["msg"], "hosts_entries.json")
    assert machine.hosts.read_bytes() == OLD


def test_extended_attributes_are_kept(machine):
    os.setxattr(str(machine.hosts), "user.colour", b"blue")
    assert machine.run()["written"] == "rename"
    assert machine.run(entries=[])["changed"]
    assert os.getxattr(str(machine.hosts), "user.colour") == b"blue"


@pytest.mark.parametrize("check", [True, False])
def test_an_immutable_file_is_refused_with_the_command_in_checks(machine, check):
    if subprocess.run(["chattr", "+i", str(machine.hosts)], capture_output=True, check=False).returncode:
        pytest.skip("no flags on this file system")
    try:
        result = machine.run(_ansible_check_mode=check)
    finally:
        subprocess.run(["chattr", "-i", str(machine.hosts)], check=True)
    assert result["failed"] and f"run 'chattr -i {machine.hosts}'" in result["msg"]
    assert "become" not in result["msg"]


def test_a_copy_is_kept_where_one_is_asked_for(machine):
    assert machine.run(_ansible_check_mode=True, backup=True)["backup_file"] == ""
    kept = machine.run(backup=True)["backup_file"]
    assert os.path.dirname(kept) == str(machine.hosts.parent) and pathlib.Path(kept).read_bytes() == OLD
    assert machine.run(backup=True)["backup_file"] == ""
    os.unlink(kept)


def test_names_with_underscores_are_bound(machine):
    assert machine.run(entries=[{"address": "192.168.1.229", "names": ["my_robot", "_x_.lan"]}])["changed"]
    assert b"192.168.1.229\tmy_robot _x_.lan # rosfleet.multimaster\n" in machine.hosts.read_bytes()
