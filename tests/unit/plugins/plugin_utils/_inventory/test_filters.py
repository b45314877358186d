# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Files of the nodes that the controller takes from there. What they do is tested in tests/unit/nodes/protocol."""

import ast
import pathlib
import sys

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base import hosts, plain_text
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory import exports, filters

ROOT = pathlib.Path(__file__).resolve().parents[5]
PROTOCOL = ROOT / "roles/nodes/files/python/rosfleet_multimaster/protocol"
TAKEN = {"filters": filters.Filters, "plain_text": plain_text.plain, "tcpros/hosts": hosts.place_of}
NEEDED = [*TAKEN, "members", "parameters"]


@pytest.mark.parametrize("name", TAKEN)
def test_the_never_exchanged_are_those_of_the_nodes(name):
    file = pathlib.Path(sys.modules[TAKEN[name].__module__].__file__)
    assert file.read_bytes() == (PROTOCOL / f"{name}.py").read_bytes()


@pytest.mark.parametrize("name", NEEDED)
def test_it_needs_the_standard_library_only(name):
    tree = ast.parse((PROTOCOL / f"{name}.py").read_text(encoding="utf-8"))
    imports = [node for node in ast.walk(tree) if isinstance(node, (ast.Import, ast.ImportFrom))]
    names = {alias.name for node in imports if isinstance(node, ast.Import) for alias in node.names}
    names |= {node.module for node in imports if isinstance(node, ast.ImportFrom) and not node.level}
    assert {name.partition(".")[0] for name in names} <= sys.stdlib_module_names | {"sre_compile", "sre_parse"}
    modules = {node.module.replace(".", "/") for node in imports if isinstance(node, ast.ImportFrom) and node.level}
    assert modules <= set(NEEDED)


def test_every_filter_of_the_fleet_is_a_parameter_of_the_nodes():
    assert set(exports.FILTERS.values()) == {*filters.NAMES, *filters.HOSTS} - {"do_not_sync"}
