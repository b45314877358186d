# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Files that cannot be written are named before anything changes, with the advice."""

import os
import subprocess
import sys

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction import atomic
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction.writable import (
    lock_flag,
    obstacle,
    obstacles,
)
from mentioned import mentions
from processes import with_paths

needs_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root gives rights away")


@pytest.fixture(params=["i", "a"])
def flagged(request, tmp_path):
    """Sets a flag of chattr(1) on a path, and takes it away at the end."""
    set_on = []

    def set_flag(path):
        done = subprocess.run(["chattr", f"+{request.param}", str(path)], capture_output=True, check=False)
        if done.returncode:
            pytest.skip(f"no flags here: {done.stderr}")
        set_on.append(path)
        return request.param

    yield set_flag
    for path in set_on:
        subprocess.run(["chattr", f"-{request.param}", str(path)], check=True)


def test_a_usual_or_missing_file_or_folder_is_no_obstacle(tmp_path):
    (tmp_path / "file").write_bytes(b"")
    os.mkfifo(str(tmp_path / "pipe"))
    for name in ("file", "missing", "a/b/c", "pipe"):
        assert obstacle(str(tmp_path / name)) == ""


def test_a_file_locked_by_a_flag_is_named_with_the_command(tmp_path, flagged):
    path = tmp_path / "file"
    path.write_bytes(b"")
    letter = flagged(path)
    assert lock_flag(str(path)) == {"i": "immutable", "a": "append-only"}[letter]
    assert f"run 'chattr -{letter} {path}'" in obstacle(str(path))
    assert obstacle(str(path), in_place=True) == obstacle(str(path))
    assert obstacles([str(path), str(path)]) == [obstacle(str(path))]


def test_a_folder_locked_by_a_flag_is_named_with_the_command(tmp_path, flagged):
    letter = flagged(tmp_path)
    assert f"run 'chattr -{letter} {tmp_path}'" in obstacle(str(tmp_path / "file"))


@needs_root
def test_a_user_without_rights_is_told_to_become_root(tmp_path):
    folder = tmp_path / "closed"
    folder.mkdir(mode=0o755)
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os.setuid(65534)
        os.write(writer, obstacle(str(folder / "file")).encode())
        os._exit(0)
    os.waitpid(child, 0)
    said = os.read(reader, 1000).decode()
    assert "not writable for the user 65534" in said and said.endswith("run as root (become: true).")


@pytest.mark.root
@pytest.mark.parametrize(
    "path", ["/proc/x", "/proc/self/x", "/proc/sys/net/x", "/sys/x", "/sys/kernel/x/y", "/dev/pts/x"]
)
def test_a_view_into_the_kernel_is_no_place_for_files(path):
    assert "is no place for files" in obstacle(path)


def test_a_name_without_room_for_its_neighbour_is_too_long(tmp_path):
    assert obstacle(str(tmp_path / ("x" * 200))) == ""
    for length in (240, 255, 300):
        path = tmp_path / ("x" * length)
        assert "is longer than the" in obstacle(str(path))
        with pytest.raises(OSError, match="File name too long"):
            atomic.write_by_rename(str(path), b"")


@needs_root
def test_a_file_that_is_mounted_by_itself_cannot_be_replaced(tmp_path):
    (tmp_path / "a file").touch()
    program = (
        "from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction.writable import obstacle\n"
        f"print(obstacle('{tmp_path}/a file'))"
    )
    mount = f'mount --bind /etc/passwd "{tmp_path}/a file" && exec "$@"'
    done = subprocess.run(
        ["unshare", "--mount", "sh", "-c", mount, "sh", sys.executable, "-c", program],
        env=with_paths(),
        capture_output=True,
        text=True,
        check=False,
    )
    if "permission denied" in done.stderr:
        pytest.skip("needs the right to mount")
    assert mentions(done.stdout, f"{tmp_path}/a", "unmount")
