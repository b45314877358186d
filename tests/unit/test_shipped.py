# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The files in the built collection, if other files lie in the folder, too; and it works when it is installed."""

import ast
import itertools
import json
import os
import re
import subprocess
import sys
import tarfile
from pathlib import Path

import pytest
import yaml

from tests.unit.test_documents import DEFINED, INLINE, without_code
from tools import copies, package

pytestmark = pytest.mark.whole

ROOT = Path(__file__).resolve().parents[2]
BIN = Path(sys.executable).parent
#: what people install is all below these, and nothing else; what of it is for developers
SHIPPED = ("LICENSES/", "changelogs/", "docs/", "examples/", "inventory/", "meta/", "playbooks/", "plugins/", "roles/")
PAGES = {
    "CHANGELOG.rst",
    "CODE_OF_CONDUCT.md",
    "CONTRIBUTING.md",
    "MAINTAINERS.md",
    "README.md",
    "REUSE.toml",
    "SECURITY.md",
}
FOR_DEVELOPERS = ("changelogs/fragments/",)
MEASURED = {
    f"docs/understand/performance/{name}" for name in ("crowd.png", "growth.json", "growth.png", "network.json")
}
MADE = {"MANIFEST.json", "FILES.json"}
#: what may lie in the folder of somebody who builds
STRAYS = """
.vault_pass .env .work/fleet.yml secret.yml id_rsa inventory/mine/group_vars/vault.yml inventory/single_computer/.vault_pass
inventory/single_computer/vault.yml plugins/modules/x.py plugins/modules/.x.py roles/hosts/files/key.pem docs/start/notes.md
playbooks/secret.yml meta/x.yml
""".split()


@pytest.fixture(scope="module")
def archive(tmp_path_factory):
    """Built in a clone in which other files lie, too."""
    clone = tmp_path_factory.mktemp("clone")
    package.copy_tree(clone)
    subprocess.run(["git", "init", "--quiet"], cwd=clone, check=True)
    subprocess.run(["git", "add", "--force", "."], cwd=clone, check=True)
    for name in STRAYS:
        (clone / name).parent.mkdir(parents=True, exist_ok=True)
        (clone / name).write_text("a secret of the builder\n")
    target = tmp_path_factory.mktemp("target")
    subprocess.run([sys.executable, clone / "tools/package.py", target], cwd=clone, check=True)
    return next(target.glob("*.tar.gz"))


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


def test_it_holds_what_people_install_and_nothing_else(archive):
    there = set(package.content(archive)) - MADE
    ours = {name for name in package.list_files() if name in PAGES or name.startswith(SHIPPED)}
    expected = {name for name in ours if not name.startswith(FOR_DEVELOPERS)} - MEASURED
    assert (sorted(there - expected), sorted(expected - there)) == ([], [])


VERSION = re.escape(yaml.safe_load((ROOT / "galaxy.yml").read_text(encoding="utf-8"))["version"])
REPOSITORY = re.compile(
    rf"https://(?:github\.com/rosfleet/multimaster/(?:blob|tree)|raw\.githubusercontent\.com/rosfleet/multimaster)/{VERSION}/([^#?]+)"
)


def test_each_link_of_a_shipped_page_leads_somewhere(archive):
    """To a file in the archive, or to one of the repository at the tag; of the README, which Galaxy shows alone, to the latter only."""
    there, tracked, found = package.content(archive), package.list_files(), {"near": 0, "far": 0}
    places = {kind: {*names, *(str(up) for name in names for up in Path(name).parents)} for kind, names in
              {"near": there, "far": tracked}.items()}  # fmt: skip
    with tarfile.open(archive) as opened:
        pages = {name: opened.extractfile(name).read().decode() for name in there if name.endswith(".md")}
    for page, text in pages.items():
        links = [*INLINE.findall(without_code(text)), *DEFINED.findall(without_code(text))]
        for link in links:
            if far := REPOSITORY.match(link):
                assert far[1] in places["far"], (page, link)
                found["far"] += 1
            elif not re.match(r"[a-z]+:|#", link):
                target = os.path.normpath(os.path.join(os.path.dirname(page), link.partition("#")[0]))
                assert target in places["near"] and page != "README.md", (page, link)
                found["near"] += 1
    assert found["near"] > 200 and found["far"] > 60
    pictures = re.findall(r"!\[[^]]*\]\((\S+)\)", pages["README.md"])
    assert [REPOSITORY.match(picture)[1] for picture in pictures] == ["docs/images/programs.svg"]


def test_copies_are_what_their_originals_are():
    assert copies.find_stale_copies() == [], "run make copies"
    links = [
        path for tree in ("plugins", "roles", "playbooks") for path in (ROOT / tree).rglob("*") if path.is_symlink()
    ]
    assert not links, "a link is not shipped: make it a copy, in tools/copies.py"


#: what goes different ways to different computers: each has its own tree alone
TREES = (("plugins/modules", "plugins/module_utils"), ("plugins/plugin_utils", "plugins/action"), (copies.NODES,))
ENOUGH = 200  # characters of a syntax tree: two lines may be alike by chance


def list_definitions(folders):
    """The functions and classes of a tree without their docstrings: (syntax tree, name)."""
    for path in (path for folder in folders for path in (ROOT / folder).rglob("*.py")):
        if str(path.relative_to(ROOT)) in copies.COPIES:
            continue
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                node.body = node.body[ast.get_docstring(node) is not None :]
                if len(text := ast.dump(node)) >= ENOUGH:
                    yield text, node.name


def test_what_trees_share_is_a_copy_of_one_file():
    """Two pieces that are alike by hand today differ tomorrow: they belong into tools/copies.py."""
    found = [dict(list_definitions(folders)) for folders in TREES]
    alike = {one[text] for one, other in itertools.combinations(found, 2) for text in one.keys() & other.keys()}
    assert not alike, "make it a file of its own, and a row of COPIES"


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
    taken = [f"plugins/plugin_utils/{name}.py" for name in ("_inventory/filters", "_base/plain_text")]  # of the nodes
    names = [name[: -len(".py")].replace("/", ".") for name in (*copies.COPIES, *taken)]
    words = "; ".join(f"import ansible_collections.rosfleet.multimaster.{name}" for name in names)
    run("env", f"PYTHONPATH={folder.parents[2]}", sys.executable, "-c", words)
