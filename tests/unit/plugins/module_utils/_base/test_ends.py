# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The ends of a module, as Ansible runs it: a program of its own."""

import json

import pytest

from tests.unit import module_server


@pytest.mark.parametrize(("length", "told"), [(20, "x" * 20), (5000, "(5000 characters)")])
def test_a_long_option_is_not_sent_back(tmp_path, length, told):
    arguments = {
        "bundle": "example",
        "files": [{"path": str(tmp_path / "missing" / "file"), "content": "x" * length}],
        "_ansible_check_mode": True,
    }
    done = module_server.run("managed_files", arguments)
    result = json.loads(done.stdout)
    (file,) = result["invocation"]["module_args"]["files"]
    assert file["content"] == told and file["path"].endswith("missing/file")
