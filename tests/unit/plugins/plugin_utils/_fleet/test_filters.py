# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""One file for the nodes and the controller. What it does is tested in tests/unit/nodes/protocol/test_filters.py."""

import ast
import pathlib
import sys

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet import exports, filters

ROOT = pathlib.Path(__file__).resolve().parents[5]
NODES = "roles/nodes/files/python/rosfleet_multimaster/protocol/filters.py"


def test_the_never_exchanged_are_those_of_the_nodes():
    assert pathlib.Path(filters.__file__).read_bytes() == (ROOT / NODES).read_bytes()


def test_it_needs_the_standard_library_only():
    tree = ast.parse((ROOT / NODES).read_text(encoding="utf-8"))
    imports = [node for node in ast.walk(tree) if isinstance(node, (ast.Import, ast.ImportFrom))]
    names = {alias.name for node in imports if isinstance(node, ast.Import) for alias in node.names}
    names |= {node.module for node in imports if isinstance(node, ast.ImportFrom)}
    assert names <= sys.stdlib_module_names | {"sre_compile", "sre_parse"}


def test_every_filter_of_the_fleet_is_a_parameter_of_the_nodes():
    assert set(exports.FILTERS.values()) == {*filters.NAMES, *filters.HOSTS} - {"do_not_sync"}
