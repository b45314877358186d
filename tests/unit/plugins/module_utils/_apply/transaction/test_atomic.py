# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Files written by rename: what the old file had beside its content."""

import errno
import os
import struct
import subprocess
import sys

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction import atomic
from killed import UNTIL

ACL, DEFAULT = "system.posix_acl_access", "system.posix_acl_default"


def acl(group, mask):
    """An ACL as the kernel stores it (acl(5)): owner rw, user 1234 rw, the group, others r."""
    nobody = 0xFFFFFFFF
    entries = [(1, 6, nobody), (2, 6, 1234), (4, group, nobody), (16, mask, nobody), (32, 4, nobody)]
    return struct.pack("<I", 2) + b"".join(struct.pack("<HHI", *entry) for entry in entries)


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"old")
    try:
        os.setxattr(str(path), "user.colour", b"blue")
        os.setxattr(str(path), ACL, acl(group=4, mask=6))
    except OSError as problem:
        pytest.skip(f"this file system has no extended attributes ({problem})")
    return path


def test_extended_attributes_and_the_acl_are_kept(path):
    before = path.stat()
    assert before.st_mode & 0o777 == 0o664  # of which the middle digit is the mask of the ACL
    atomic.write_by_rename(str(path), b"new", before.st_mode & 0o777)
    assert path.read_bytes() == b"new" and path.stat().st_ino != before.st_ino
    assert os.getxattr(str(path), "user.colour") == b"blue"
    assert os.getxattr(str(path), ACL) == acl(group=4, mask=6)
    assert path.stat().st_mode == before.st_mode


def test_the_mode_bounds_an_acl(path):
    atomic.write_by_rename(str(path), b"secret", 0o600)
    assert os.getxattr(str(path), ACL)[4:] == acl(group=4, mask=0)[4:-8] + struct.pack("<HHI", 32, 0, 0xFFFFFFFF)


def test_a_file_without_acl_gets_none_from_its_folder(path):
    os.removexattr(str(path), ACL)
    os.setxattr(str(path.parent), DEFAULT, acl(group=4, mask=6))
    atomic.write_by_rename(str(path), b"new", 0o644)
    assert os.listxattr(str(path)) == ["user.colour"]


def test_what_the_kernel_computes_from_the_content_is_not_kept(path, monkeypatch):
    real = os.listxattr
    monkeypatch.setattr(os, "listxattr", lambda *words, **more: [*real(*words, **more), "security.ima"])
    assert "security.ima" not in atomic.attributes(str(path))


def test_an_attribute_that_cannot_be_kept_stops_the_change(path, monkeypatch):
    def refused(*words, **more):
        raise OSError(errno.EPERM, "Operation not permitted")

    monkeypatch.setattr(os, "setxattr", refused)
    with pytest.raises(OSError, match=f"extended attribute {ACL} cannot be kept: Operation not permitted") as caught:
        atomic.write_by_rename(str(path), b"new")
    assert caught.value.filename == str(path)
    assert path.read_bytes() == b"old"
    assert os.listdir(str(path.parent)) == ["file"]


def test_a_link_and_a_missing_file_have_none(path):
    (path.parent / "link").symlink_to("file")
    assert atomic.attributes(str(path.parent / "link")) == atomic.attributes(str(path.parent / "none")) == {}


@pytest.mark.parametrize("call", ["fdopen", "fchown", "fchmod", "fsync", "rename", "listxattr"])
def test_a_failure_names_the_file_and_not_its_neighbour(tmp_path, monkeypatch, call):
    def full(*_arguments, **_options):
        raise OSError(errno.ENOSPC, "No space left on device")

    path = tmp_path / "file"
    monkeypatch.setattr(atomic.os, call, full)
    with pytest.raises(OSError, match="No space left") as problem:
        atomic.write_by_rename(str(path), b"x", owner=(os.geteuid(), os.getegid()), kept={})
    monkeypatch.undo()
    assert problem.value.filename == str(path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("is_there", [True, False])
def test_a_removal_is_synced_also_where_a_killed_run_has_removed_the_file(tmp_path, is_there, synced):
    """A loss of power brings it back until then."""
    (tmp_path / "file").write_text("x" if is_there else "")
    if not is_there:
        (tmp_path / "file").unlink()
    atomic.remove_for_good(str(tmp_path / "file"))
    assert synced == [str(tmp_path)] and not (tmp_path / "file").exists()
    atomic.remove_for_good(str(tmp_path / "none" / "file"))


def test_a_run_can_be_killed_before_each_change_of_a_file():
    """A change that is not among them is one before which no test kills a run."""
    program = f"""{UNTIL}
changes = {{"unlink", "rename", "mkdir", "rmdir"}}
codes = {{name: getattr(one, "__code__", None) for name, one in vars(atomic).items()}}
print([name for name, code in codes.items() if code and changes & set(code.co_names)])
"""
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert (ended.stdout.strip(), ended.stderr) == ("[]", "")
