# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Names are things and deeds, as the section "Names" of CONTRIBUTING.md says, which is read here."""

import ast
import collections
import pathlib
import re

import pytest
import yaml

ROOT = pathlib.Path(__file__).parents[2]
TREES = ("plugins", "roles", "lab", "tools")
FUNCTION_WORDS, PARTICIPLES, OTHERS = (
    set(words.split())
    for words in re.findall(r"`([a-z]+(?: [a-z]+){9,})`", (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8"))
)
DEEDS = {"from", "to", "as", "on"}
#: folders of programs, which have nothing in common
PROGRAMS = "lab/nodes"
LONGEST = 60  # letters of the name of a test
#: contracts of a table, the entry of each program, and the classes that Ansible looks for
SHARED = {"main", "BackEnd", "CallbackModule", "ActionModule", "FilterModule", "ModuleDocFragment"}
#: the file of a plugin has the name that users write in their plays
NAMED_BY_USERS = {"plugins/action", "plugins/filter", "plugins/lookup", "plugins/modules"}


def first_words(name):
    """The first word of a name in lower case, and whether others follow."""
    first, *others = re.findall(r"[A-Z]?[a-z0-9]+|[A-Z]+(?![a-z])", name) or [""]
    return first.lower(), bool(others)


def refused(name, is_class=False):
    if name.startswith("__"):  # Python's own
        return False
    first, others = first_words(name)
    if first in FUNCTION_WORDS:
        return not (others and first in DEEDS)
    participle = first in PARTICIPLES or (len(first) > 4 and first.endswith(("ed", "ing")) and first not in OTHERS)
    return participle and not (is_class and others)


def rooms():
    """The Python files of each folder."""
    files = collections.defaultdict(list)
    for tree in TREES:
        for path in sorted((ROOT / tree).rglob("*.py")):
            files[path.parent.relative_to(ROOT).as_posix()].append(path)
    return files


ROOMS = rooms()


@pytest.mark.parametrize("room", ROOMS)
def test_names_are_things_and_deeds(room):
    wrong, public = [], collections.defaultdict(list)
    for path in ROOMS[room]:
        if refused(path.stem) and room not in NAMED_BY_USERS:
            wrong.append(path.name)
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
                if refused(node.name, isinstance(node, ast.ClassDef)):
                    wrong.append(f"{path.name}:{node.lineno} {node.name}")
        for node in tree.body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
                public[node.name].append(path.name)
    twice = {name: files for name, files in public.items() if len(files) > 1 and name not in SHARED}
    if room.startswith(PROGRAMS):
        twice = {}
    assert not wrong and not twice, f"{room}: {', '.join(wrong)}; defined twice: {twice}"


@pytest.mark.parametrize(
    ("name", "is_class", "wrong"),
    [
        ("told", False, True),
        ("_of", False, True),
        ("from_text", False, False),
        ("as", False, True),
        ("ping", False, False),
        ("known_hosts", False, True),
        ("ManagedFile", True, False),
        ("Found", True, True),
        ("HTTPServer", True, False),
        ("__init__", False, False),
        ("read_routes", False, False),
    ],
)
def test_a_word_decides(name, is_class, wrong):
    assert refused(name, is_class) is wrong


MODULES = sorted((ROOT / "plugins/modules").glob("[a-z]*.py"))


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.stem)
def test_a_module_says_by_its_name_where_it_works(path):
    """Code for a computer, or none; documented as one that only reads, or not."""
    text = path.read_text(encoding="utf-8")
    assert path.stem.startswith("fleet_") is ("def main()" not in text)
    reads = "rosfleet.multimaster.attributes.info\n" in text and not path.stem.startswith("fleet_")
    assert path.stem.endswith("_info") is reads


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.stem)
def test_nothing_is_asked_by_state(path):
    text = path.read_text(encoding="utf-8").split('DOCUMENTATION = r"""')[1].split('"""')[0]
    assert "state" not in yaml.safe_load(text).get("options", {})


@pytest.mark.slow
def test_names_of_tests_are_short_and_there_once():
    for path in sorted((ROOT / "tests").rglob("test_*.py")):
        names = [
            node.name for node in ast.parse(path.read_text(encoding="utf-8")).body if isinstance(node, ast.FunctionDef)
        ]
        assert all(len(name) <= LONGEST for name in names if name.startswith("test_")), path
        assert len(names) == len(set(names)), path
