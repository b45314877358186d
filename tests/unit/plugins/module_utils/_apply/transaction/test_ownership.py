# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Modes as chmod(1) of this machine makes them of 0644, and owners by name and number."""

import os
import subprocess

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.transaction.ownership import (
    find_owner,
    parse_mode,
)
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem


@pytest.mark.parametrize(
    "text",
    [
        *(
            "0644",
            "755",
            "4755",
            "02750",
            "1777",
            "000",
            "u=rw,g=r,o=",
            "u=rwx,go=rx",
            "a+x",
            "+x",
            "go-r",
            "u+s,g+s",
            "=r",
        ),
        *("u=rw,g=u,o=g", "ug+rw-x,o=", "a=rX", "u+x,a+X", "o+t", "u=rws,g=xs", "u+st", "g=,o=rwx", "u-w+x", "o=rt"),
    ],
)
def test_a_mode_is_what_chmod_makes_of_it(tmp_path, text):
    path = tmp_path / "file"
    path.touch()
    path.chmod(0o644)
    subprocess.run(["chmod", text, str(path)], check=True)
    assert parse_mode(text) == path.stat().st_mode & 0o7777


def test_an_octal_number_of_yaml_is_taken():
    assert parse_mode(0o644) == 0o644
    assert [parse_mode(given) for given in (644, 755, -1, True)] == [None] * 4


@pytest.mark.parametrize(
    "text", ["", "64", "0999", "u=q", "z+r", "u", "rw-r--r--", "0o", "123456", "77777", "preserve"]
)
def test_anything_else_is_no_mode(text):
    assert parse_mode(text) is None


def test_owners_are_names_or_numbers():
    assert find_owner("/a", None, None) is None
    assert find_owner("/a", "root", None) == (0, os.getegid())
    assert find_owner("/a", None, "0") == (os.geteuid(), 0)
    assert find_owner("/a", "1234567", "root") == (1234567, 0)
    for owner in ("nobody-here", "-1", "", "4294967295", "a\0b"):
        with pytest.raises(Problem, match="of /a is not known on this computer"):
            find_owner("/a", owner, None)
