# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""What is in the built collection: the reviewed list, whatever lies in the folder; and it works when it is installed."""

import json
import os
import random
import subprocess
import sys
import tarfile
from pathlib import Path

import pytest

from tools import copies, package

ROOT = Path(__file__).resolve().parents[2]
BIN = Path(sys.executable).parent
# What may lie in the folder of somebody who builds.
DECOYS = """
.vault_pass .env .git/config .work/venv/lib/x.py .work/fleet.yml .pytest_cache/README.md .hypothesis/x .ansible/x.yml
router_config/tibi.txt tests/output/x.json secret.yml id_rsa rosfleet-multimaster-0.0.9.tar.gz
inventory/mine/hosts.yml inventory/mine/group_vars/vault.yml inventory/single_computer/.vault_pass
plugins/.vault_pass plugins/modules/.x.py plugins/modules/__pycache__/x.cpython-311.pyc plugins/modules/x.py~
plugins/modules/x.py.orig roles/hosts/files/key.pem roles/nodes/files/python/__pycache__/x.pyc docs/start/notes.txt docs/start/.x.md
docs/drafts/x.md playbooks/host_vars/x.yml playbooks/.x.yml changelogs/.plugin-cache.yaml meta/x.yml extensions/x.yml
plugins/.venv/x.py roles/hosts/.mine/x.yml inventory/single_computer/.mine/x.yml
inventory/single_computer/vault.yml inventory/single_computer/group_vars/all.yml playbooks/secret.yml docs/start/x.md
""".split()
# Names as secrets have them, and names as files of ours have them.
STRAYS = """
vault.yml all.yml secrets.yml secret.txt hosts.yml inventory.yml x.yml x.yaml vars.json x.md notes.md README.old.md x.py passwords.py
x.j2 x.conf x.msg x.srv package.xml id_rsa id_ed25519 key.pem robot.key x.crt .env .netrc .vault_pass .x.yml .x.py wpa_supplicant.conf
x.png x.txt token bundle.zip fleet.tar.gz main.yml main.yml.bak runtime.yml galaxy.yml MANIFEST.in setup.cfg
""".split()


def strays(seed):
    """Any folder of the tree, and new ones in it, with names of STRAYS: those that are not files of ours."""
    drawn = random.Random(seed)
    own = package.LIST.read_text().split()
    folders = sorted({str(folder) for name in own for folder in Path(name).parents} - {"."})
    found = set()
    for folder in folders:
        for name in drawn.sample(STRAYS, 6):
            inner = drawn.choice(("", "", "mine/", "group_vars/all/", "host_vars/", "files/"))
            found.add(f"{folder}/{inner}{name}")
    return sorted(found - set(own))


SECRET = "hunter2-of-the-builder"


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    tree = tmp_path_factory.mktemp("tree")
    package.clean_tree(tree)
    for name in (*DECOYS, *strays(seed=1)):
        (tree / name).parent.mkdir(parents=True, exist_ok=True)
        (tree / name).write_text(f"{SECRET}\n")
    return package.build(tree, tmp_path_factory.mktemp("target"))


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


@pytest.mark.slow
def test_the_files_are_those_of_the_reviewed_list(archive):
    own = [name for name in package.content(archive) if name not in ("MANIFEST.json", "FILES.json")]
    listed = package.LIST.read_text().splitlines()
    more, less = sorted(set(own) - set(listed)), sorted(set(listed) - set(own))
    assert not more and not less, (
        f"more: {more}, less: {less}; if that is meant: make shipped, and review the difference"
    )


def test_a_file_of_ours_that_the_list_has_not_is_told():
    """And one that is there no more. What git does not have is not ours."""
    listed, ours = package.LIST.read_text().splitlines(), package.ours()
    more, less = sorted(set(ours) - set(listed)), sorted(set(listed) - set(ours))
    assert not more and not less, f"not listed: {more}, gone: {less}; make shipped, and review the difference"
    assert package.GALAXY.read_text() == package.galaxy(listed), "galaxy.yml has another list: make shipped"


def test_no_test_no_tool_no_secret_and_no_link_is_in_it(archive):
    own = package.content(archive)
    assert not [name for name in own if name in DECOYS or name.endswith("(no file)")]
    assert not [
        name for name in own if name.split("/")[0] in ("tests", "tools", "extensions", ".ci", ".github", ".work")
    ]
    assert not [name for name in own if name.endswith(".png") or name.startswith("docs/understand/performance/")]


def test_what_lies_in_any_folder_is_not_in_it(archive):
    """Files with any name that lay there when it was built: neither their names nor what was in them."""
    lay = strays(seed=1)
    assert len(lay) > 500 and not set(lay) & set(package.content(archive))
    with tarfile.open(archive) as opened:
        texts = [opened.extractfile(member).read() for member in opened if member.isfile()]
    assert not [text for text in texts if SECRET.encode() in text]


@pytest.mark.parametrize("name", ["x[1].yml", "a b.yml", "x*.py", "x\ny.py", "#x.yml"])
def test_a_name_that_would_stand_for_several_files_is_refused(name):
    with pytest.raises(SystemExit, match="give it another name"):
        package.galaxy(["README.md", f"plugins/{name}"])


def test_every_python_file_of_the_trees_that_run_is_in_it(archive):
    """A white list that is too short shows here, not on a robot."""
    own = set(package.content(archive))
    tracked = subprocess.run(
        ["git", "ls-files", "plugins", "roles", "playbooks", "meta"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split()
    assert not [name for name in tracked if (ROOT / name).exists() and name not in own]


def test_copies_are_what_their_originals_are():
    assert copies.find_stale_copies() == [], "run make copies"
    links = [
        path for tree in ("plugins", "roles", "playbooks") for path in (ROOT / tree).rglob("*") if path.is_symlink()
    ]
    assert not links, "a link is not shipped: make it a copy, in tools/copies.py"


@pytest.mark.slow
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
    taken = [f"plugins/plugin_utils/_fleet/{name}.py" for name in ("filters", "plain_text")]  # of the nodes
    names = [name[: -len(".py")].replace("/", ".") for name in (*copies.COPIES, *taken)]
    words = "; ".join(f"import ansible_collections.rosfleet.multimaster.{name}" for name in names)
    run(sys.executable, "-c", f"import sys; sys.path.insert(0, {str(folder.parents[2])!r}); {words}")
