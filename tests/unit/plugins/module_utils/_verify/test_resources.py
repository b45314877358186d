# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The clock and the disks of this machine."""

import os
import subprocess

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._verify import resources

root = pytest.mark.skipif(os.geteuid() != 0, reason="mounts need root")


def test_the_kernel_tells_if_the_clock_is_kept_right():
    assert resources.clock()["synchronised"] in (True, False, None)


def test_each_file_system_is_counted_once(tmp_path):
    (tmp_path / "a").mkdir()
    folders = [str(tmp_path), str(tmp_path / "a"), str(tmp_path / "missing")]
    (found,) = resources.disks([], folders)
    assert found["path"] == str(tmp_path) and found["free_bytes"] > 0


@root
def test_a_full_file_system(tmp_path):
    full = tmp_path / "full"
    full.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "none", str(full)], check=True)
    try:
        with open(full / "data", "wb") as file:
            file.write(bytes(64 << 10))
        found = resources.disks([], [str(tmp_path), str(full)])
    finally:
        subprocess.run(["umount", str(full)], check=True)
    assert [entry["path"] for entry in found] == [str(tmp_path), str(full)]
    assert found[1]["free_bytes"] == 0
