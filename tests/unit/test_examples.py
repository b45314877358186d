# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The examples of each module can be pasted: one kind of YAML, with every variable that they use."""

import ast
import pathlib
import re

import jinja2
import jinja2.meta
import pytest
import yaml

ROOT = pathlib.Path(__file__).parents[2]
MODULES = sorted((ROOT / "plugins/modules").glob("*.py"))
#: what Ansible itself defines for a task
MAGIC = {"groups", "hostvars", "inventory_hostname", "item", "omit", "query", "lookup", "role_path"}
REGISTERS = re.compile(r"^ *register: (\w+)", re.MULTILINE)


def document(path, name):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    [text] = [node.value.value for node in tree.body if isinstance(node, ast.Assign) and node.targets[0].id == name]
    return yaml.safe_load(text)


def texts(value):
    if isinstance(value, dict):
        value = [entry for pair in value.items() for entry in pair]
    return [text for entry in value for text in texts(entry)] if isinstance(value, list) else [str(value)]


def uses(value):
    """The variables of all templates in a value; of `that`, a bare expression, too."""
    bare = {"{{ " + text + " }}" for text in conditions(value)}
    found = set()
    for text in bare.union(texts(value)):
        # The filters are Ansible's: only the names of variables count.
        plain = re.sub(r"\| *[\w.]+", "| string", text) if "{{" in text else ""
        found |= jinja2.meta.find_undeclared_variables(jinja2.Environment().parse(plain))
    return found


def conditions(value):
    if isinstance(value, list):
        return [text for entry in value for text in conditions(entry)]
    if not isinstance(value, dict):
        return []
    own = value.get("that", [])
    return ([own] if isinstance(own, str) else own) + conditions(list(value.values()))


def provides(value):
    """The variables that the tasks of an example register, and those of the roles that it names."""
    entries = texts(value)
    registered = {after for before, after in zip(entries, entries[1:]) if before == "register"}
    for role in (text.rpartition(".")[2] for before, text in zip(entries, entries[1:]) if before == "role"):
        for part in (role, "preflight"):
            for file in (ROOT / "roles" / part / "tasks").glob("*.yml"):
                registered |= set(REGISTERS.findall(file.read_text(encoding="utf-8")))
    return registered


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.stem)
def test_examples_can_be_pasted(path):
    examples = document(path, "EXAMPLES")
    assert len({"hosts" in entry for entry in examples}) == 1, "plays and tasks in one file"
    missing = uses(examples) - provides(examples) - MAGIC
    assert not missing, missing


@pytest.mark.parametrize("path", MODULES, ids=lambda path: path.stem)
def test_each_module_names_its_neighbours(path):
    entries = [entry.get("module") or entry.get("plugin", "") for entry in document(path, "DOCUMENTATION")["seealso"]]
    ours = {name.rpartition(".")[2] for name in entries if name.startswith("rosfleet.multimaster.")}
    known = {file.stem for kind in ("modules", "lookup", "filter") for file in (ROOT / "plugins" / kind).iterdir()}
    assert ours and ours <= known - {path.stem}


def test_a_variable_of_nowhere_is_found():
    tasks = [{"a": {"b": "{{ x | to_json }}"}, "register": "y"}, {"assert": {"that": ["y.c", "z"]}}]
    assert uses(tasks) - provides(tasks) == {"x", "z"}
