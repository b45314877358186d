# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""What is in the built collection: the reviewed list, whatever lies in the folder; and it works when it is installed."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tools"))

import copies  # noqa: E402
import shipped  # noqa: E402

BIN = Path(sys.executable).parent
# What may lie in the folder of somebody who builds.
DECOYS = """
.vault_pass .env .git/config .work/venv/lib/x.py .work/fleet.yml .pytest_cache/README.md .hypothesis/x .ansible/x.yml
router_config/tibi.txt tests/output/x.json secret.yml id_rsa rosfleet-multimaster-0.0.9.tar.gz
inventory/mine/hosts.yml inventory/mine/group_vars/vault.yml inventory/single_computer/.vault_pass
plugins/.vault_pass plugins/modules/.x.py plugins/modules/__pycache__/x.cpython-311.pyc plugins/modules/x.py~
plugins/modules/x.py.orig roles/hosts/files/key.pem roles/nodes/files/python/__pycache__/x.pyc docs/notes.txt docs/.x.md
docs/drafts/x.md playbooks/host_vars/x.yml playbooks/.x.yml changelogs/.plugin-cache.yaml meta/x.yml extensions/x.yml
plugins/.venv/x.py roles/hosts/.mine/x.yml inventory/single_computer/.mine/x.yml
""".split()


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    tree = tmp_path_factory.mktemp("tree")
    shipped.clean_tree(tree)
    for name in DECOYS:
        (tree / name).parent.mkdir(parents=True, exist_ok=True)
        (tree / name).write_text("secret\n")
    return shipped.build(tree, tmp_path_factory.mktemp("target"))


@pytest.fixture(scope="module")
def installed(archive, tmp_path_factory):
    """The folder of collections in which it is installed, and a run of a program with it."""
    folder = tmp_path_factory.mktemp("collections")

    def run(program, *words):
        variables = {
            "ANSIBLE_COLLECTIONS_PATH": str(folder),
            "ANSIBLE_CONFIG": str(folder / "none.cfg"),
            "LC_ALL": "C.UTF-8",
        }
        kept = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH",)}
        done = subprocess.run(
            [program, *words], cwd=folder, env={**kept, **variables}, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    run(BIN / "ansible-galaxy", "collection", "install", "--offline", "--collections-path", folder, archive)
    return folder / "ansible_collections" / "rosfleet" / "multimaster", run


def test_the_files_are_those_of_the_reviewed_list(archive):
    own = [name for name in shipped.content(archive) if name not in ("MANIFEST.json", "FILES.json")]
    listed = [name for name in shipped.LIST.read_text().splitlines() if name not in ("MANIFEST.json", "FILES.json")]
    more, less = sorted(set(own) - set(listed)), sorted(set(listed) - set(own))
    assert not more and not less, (
        f"more: {more}, less: {less}; if that is meant: make shipped, and review the difference"
    )


def test_no_test_no_tool_no_secret_and_no_link_is_in_it(archive):
    own = shipped.content(archive)
    assert not [name for name in own if name in DECOYS or name.endswith("(no file)")]
    assert not [name for name in own if name.split("/")[0] in ("tests", "tools", "extensions", ".ci", ".work")]


def test_every_python_file_of_the_trees_that_run_is_in_it(archive):
    """A white list that is too short shows here, not on a robot."""
    own = set(shipped.content(archive))
    tracked = subprocess.run(
        ["git", "ls-files", "plugins", "roles", "playbooks", "meta"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split()
    assert not [name for name in tracked if (ROOT / name).exists() and name not in own]


def test_copies_are_what_their_originals_are():
    assert copies.differing() == [], "run make copies"
    links = [
        path for tree in ("plugins", "roles", "playbooks") for path in (ROOT / tree).rglob("*") if path.is_symlink()
    ]
    assert not links, "a link is not shipped: make it a copy, in tools/copies.py"


def test_the_installed_playbooks_and_the_plan_work(installed):
    folder, run = installed
    inventory = folder / "inventory" / "single_computer"
    for playbook in ("site", "verify", "teardown", "router_config"):
        run(BIN / "ansible-playbook", "--syntax-check", "-i", inventory, f"rosfleet.multimaster.{playbook}")
    play = folder.parents[2] / "plan.yml"
    task = {"rosfleet.multimaster.fleet_plan": {}, "register": "plan", "run_once": True}
    play.write_text(json.dumps([{"hosts": "robots", "gather_facts": False, "tasks": [task]}]))
    assert "failed=0" in run(BIN / "ansible-playbook", "-i", inventory, str(play))


def test_the_installed_files_that_are_copies_can_be_imported(installed):
    folder, run = installed
    names = [name[: -len(".py")].replace("/", ".") for name in copies.COPIES]
    words = "; ".join(f"import ansible_collections.rosfleet.multimaster.{name}" for name in names)
    run(sys.executable, "-c", f"import sys; sys.path.insert(0, {str(folder.parents[2])!r}); {words}")
