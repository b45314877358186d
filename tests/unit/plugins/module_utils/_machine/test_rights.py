# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""What a process may do, asked before a change."""

import os
import subprocess
import sys

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import rights


def test_what_can_be_written_is_no_sentence(tmp_path):
    assert rights.unwritable([str(tmp_path / "a"), str(tmp_path / "b/c/d")]) is None


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root to mount")
def test_a_read_only_file_system_is_named_with_its_file(tmp_path):
    program = (
        "from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import rights\n"
        f"print(rights.unwritable(['{tmp_path}/b/c']))"
    )
    mount = f'mount -t tmpfs -o ro none "{tmp_path}" && exec "$@"'
    done = subprocess.run(
        ["unshare", "--mount", "sh", "-c", mount, "sh", sys.executable, "-c", program],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert f"{tmp_path}/b/c cannot be written (Read-only file system)" in done.stdout


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root to be somebody else")
def test_who_may_change_the_network():
    assert rights.may_change_network()
    child = os.fork()
    if child == 0:
        os.setgroups([])
        os.setuid(65534)
        os._exit(int(rights.may_change_network()))
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
