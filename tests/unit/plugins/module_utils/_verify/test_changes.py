# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""When this computer was changed last."""

import os
import re
import time

from ansible_collections.rosfleet.multimaster.plugins.module_utils._verify import changes

WHEN = "2001-09-09 01:46:40 UTC"


def write(path, when):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("content\n")
    os.utime(path, (0, when))


def test_the_last_changed_file_of_a_group_is_named(tmp_path):
    write(tmp_path / "etc" / "hosts", 1_000_000_000)
    write(tmp_path / "etc" / "sysctl.d" / "1.conf", 1_000_000_000)
    write(tmp_path / "etc" / "sysctl.conf", 900_000_000)
    found = [entry for entry in changes.changes(str(tmp_path)) if entry["about"] in ("names", "settings", "network")]
    assert [(entry["about"], entry["what"], entry["when"]) for entry in found] == [
        ("names", str(tmp_path / "etc" / "hosts"), WHEN),
        ("settings", str(tmp_path / "etc" / "sysctl.d" / "1.conf"), WHEN),
    ]


def test_the_start_of_this_computer():
    (found,) = changes.start_rows()
    assert found["about"] == "start" and re.fullmatch(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d UTC", found["when"])
    assert found["when"] <= time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime(time.time() + 2))


def test_without_a_kernel_that_tells_it_there_is_no_start(tmp_path):
    assert changes.start_rows(str(tmp_path)) == []


def test_an_interface_without_a_line_in_the_journal_has_none():
    assert changes.carrier("no-such-interface.0") == ""
