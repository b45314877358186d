# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The filter file_sums gives what managed_files computes from the contents."""

import pytest
from ansible.errors import AnsibleFilterError
from ansible_collections.rosfleet.multimaster.plugins.filter.file_sums import file_sums
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction import files

PLANNED = [
    {"path": "/etc/b", "content": "ä\r\n", "mode": "0755"},
    {"path": "/etc/a", "content": ""},
    {"path": "/etc/c", "content": "x", "mode": "0600", "owner": "root", "group": "root"},
]


def test_the_digest_is_that_of_the_module():
    wanted = files.parse_files({"mode": "0644", **file} for file in PLANNED)
    assert file_sums(PLANNED)["digest"] == files.digest(wanted)
    assert file_sums(PLANNED[:1])["digest"] != file_sums([{**PLANNED[0], "content": "a"}])["digest"]


def test_no_content_is_left_and_the_rest_stays():
    sums = file_sums(PLANNED)["files"]
    assert [set(file) for file in sums] == [set(file) - {"content"} | {"sha256"} for file in PLANNED]
    assert sums[1]["sha256"] == "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855"


def test_a_bad_path_is_a_sentence():
    with pytest.raises(AnsibleFilterError, match="file_sums: The path 'etc/a'"):
        file_sums([{"path": "etc/a", "content": ""}])
