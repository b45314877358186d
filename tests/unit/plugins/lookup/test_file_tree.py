# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The lookup file_tree, as Ansible calls it."""

import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from ansible.errors import AnsibleError
from ansible_collections.rosfleet.multimaster.plugins.lookup import file_tree

pytestmark = pytest.mark.whole


@pytest.fixture(name="source")
def _source(tmp_path):
    texts = {
        "python/p/__init__.py": "",
        "python/p/a.py": "x = 'ä'\r\n",
        "share/p.sh": "#!/bin/sh\n",
        "python/p/__pycache__/a.cpython-311.pyc": "no",
        "python/p/stray.pyc": "no",
        "python/p/a.py~": "no",
        "python/p/.a.py.swp": "no",
        "python/p/#a.py#": "no",
        ".git/config": "no",
    }
    for name, content in texts.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content.encode())
    (tmp_path / "share" / "p.sh").chmod(0o755)
    return tmp_path


def test_text_files_sorted_with_modes_and_without_rubbish(source):
    assert file_tree.read_tree(str(source), "/usr/local/lib/x") == [
        {"path": "/usr/local/lib/x/python/p/__init__.py", "content": "", "mode": "0644"},
        {"path": "/usr/local/lib/x/python/p/a.py", "content": "x = 'ä'\r\n", "mode": "0644"},
        {"path": "/usr/local/lib/x/share/p.sh", "content": "#!/bin/sh\n", "mode": "0755"},
    ]


def test_links_to_files_are_read_and_broken_ones_skipped(source):
    (source / "link.py").symlink_to("python/p/a.py")
    (source / "broken.py").symlink_to("nowhere")
    assert [file["path"] for file in file_tree.read_tree(str(source), "/x")][0] == "/x/link.py"
    assert len(file_tree.read_tree(str(source), "/x")) == 4


@pytest.mark.parametrize("destination", ["relative", "/x/", "/x/../y", ""])
def test_a_bad_destination_is_a_sentence(source, destination):
    with pytest.raises(AnsibleError, match="destination"):
        file_tree.read_tree(str(source), destination)


def test_a_missing_folder_and_a_binary_file_are_sentences(source):
    with pytest.raises(AnsibleError, match="no folder of the controller"):
        file_tree.read_tree(str(source / "missing"), "/x")
    (source / "image.png").write_bytes(b"\x89PNG")
    with pytest.raises(AnsibleError, match=r"image\.png is no UTF-8 text"):
        file_tree.read_tree(str(source), "/x")


def ansible(source, expression):
    """The text that Ansible itself makes of a template."""
    collections = next(parent for parent in Path(file_tree.__file__).parents if parent.name == "ansible_collections")
    argument = json.dumps({"msg": "{{ %s }}" % expression.replace("SOURCE", f"'{source}'")})
    answer = subprocess.run(
        [
            sys.executable,
            "-m",
            "ansible",
            "adhoc",
            "localhost",
            "-c",
            "local",
            "-m",
            "ansible.builtin.debug",
            "-a",
            argument,
        ],
        env=dict(os.environ, ANSIBLE_COLLECTIONS_PATH=str(collections.parent), ANSIBLE_LOCALHOST_WARNING="false"),
        cwd=source,  # away from any ansible.cfg
        capture_output=True,
        text=True,
        check=False,
    )
    return answer.stdout + answer.stderr


def test_query_gives_the_list_that_managed_files_wants(source):
    said = ansible(source, "query('rosfleet.multimaster.file_tree', SOURCE ~ '/share', destination='/x')")
    assert json.loads(said[said.index("{") : said.rindex("}") + 1])["msg"] == [
        {"path": "/x/p.sh", "content": "#!/bin/sh\n", "mode": "0755"}
    ]


def test_without_a_destination_it_says_so(source):
    assert "destination" in ansible(source, "query('rosfleet.multimaster.file_tree', SOURCE)")


def test_digests_in_place_of_contents(source):
    for file, summed in zip(
        file_tree.read_tree(str(source), "/x"), file_tree.read_tree(str(source), "/x", content=False)
    ):
        digest = hashlib.sha256(file.pop("content").encode()).hexdigest()
        assert summed == {**file, "sha256": digest}
