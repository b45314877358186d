# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""An optional feature is in its folders and its rows: without these, what remains imports, lints and passes its tests."""

import ast
import os
import pathlib
import re
import shutil
import subprocess
import sys

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.features import FEATURES

ROOT = pathlib.Path(__file__).parents[2]
COLLECTION = "ansible_collections/rosfleet/multimaster"
NEEDED = (
    *("plugins", "roles", "tests/unit/conftest.py", "tests/unit/test_layers.py", "tests/unit/plugins/plugin_utils"),
    "tests/unit/helpers",
    *("inventory", "ruff.toml", "pytest.ini", "docs/develop/architecture.md", "docs/operate/checks.md"),
)
#: of the rooms that have hooks; those that name the feature are left out
TESTS = (
    *("_base/test_plain.py", "_base/test_features.py", "_inventory/test_contradictions.py", "_inventory/test_kinds.py"),
    *("_inventory/test_read.py", "_plan/test_plan.py", "_plan/test_preflight.py"),
    *("_robot_io/test_summary.py", "_verify/checks/test_engine.py"),
    *("_verify/checks/test_network.py", "_verify/components/test_component.py"),
)
IMPORT_ALL = """
import importlib, pathlib
for path in sorted(pathlib.Path("plugins").rglob("*.py")):
    name = ".".join(path.with_suffix("").parts)
    importlib.import_module("ansible_collections.rosfleet.multimaster." + name.removesuffix(".__init__"))
"""


def remove(root, feature):
    """Take a feature out of a copy of the tree: its folders, the files that Ansible wants at their places, and its rows."""
    for tree in ("plugins", "tests/unit/plugins"):
        for folder in (
            *root.glob(f"{tree}/*/_features/{feature.name}"),
            *(root / tree / room for room in feature.rooms),
        ):
            shutil.rmtree(folder, ignore_errors=not folder.exists())
    shutil.rmtree(root / "roles" / feature.name, ignore_errors=bool(feature.rooms))
    remove_hooks(root, {pathlib.Path(room).name for room in feature.rooms})
    for file in feature.plugins:
        (root / "plugins" / file).unlink()
    table = root / "plugins/plugin_utils/_base/features.py"
    text = table.read_text()
    calls = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Call) and node.args]
    (row,) = (
        ast.get_source_segment(text, node) for node in calls if getattr(node.args[0], "value", None) == feature.name
    )
    table.write_text(text.replace(f"    {row},\n", ""))
    for table in root.glob("plugins/module_utils/_features/*.py"):  # a module packs all that its table imports
        name = feature.name.upper()
        lines = table.read_text().splitlines(keepends=True)
        kept = [line for line in lines if not re.match(rf"from \.{feature.name}\.|    {name}\w*,$", line)]
        table.write_text("".join(kept))


def remove_hooks(root, rooms):
    """Take rooms out of the tables of rooms, and what other features add to them."""
    table = root / "plugins/plugin_utils/_base/features.py"
    for page in root.glob("plugins/*/README.md"):
        lines = page.read_text().splitlines(keepends=True)
        own = [line for line in lines if line.startswith("| `") and line.split("`")[1] in rooms]
        added = [line for line in lines if re.match(r"\| `\w+` \| `(\w+)` \|", line) and line.split("`")[3] in rooms]
        page.write_text("".join(line for line in lines if line not in (*own, *added)))
        for file in (line.split("`")[1] for line in added):
            table.write_text(table.read_text().replace(f', "{file}"', ""))
            for path in root.glob(f"**/_features/*/*{file}.py"):
                path.unlink()


@pytest.mark.slow
@pytest.mark.parametrize(
    "feature",
    [pytest.param(one, marks=[] if one.name == "tunnel" else pytest.mark.costly, id=one.name) for one in FEATURES],
)
def test_without_its_folders_and_rows_the_rest_works(tmp_path, feature):
    root = tmp_path / COLLECTION
    for name in NEEDED:
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        copy(ROOT / name, root / name)
    remove(root, feature)

    def run(*argv):
        environment = {**os.environ, "PYTHONPATH": str(tmp_path), "PYTHONDONTWRITEBYTECODE": "1"}
        return subprocess.run([sys.executable, *argv], cwd=root, env=environment, check=True, timeout=300)

    run("-c", IMPORT_ALL)
    run("-m", "ruff", "check", "--no-cache", "plugins")
    tests = [f"tests/unit/plugins/plugin_utils/{name}" for name in TESTS]
    others = [test for test in tests if feature.name not in (root / test).read_text()]
    assert len(others) > len(tests) / 2
    pytest_alone = ("-m", "pytest", "-q", "-p", "no:cacheprovider", "-W", "ignore")
    run(
        *pytest_alone, "tests/unit/test_layers.py", "-k", "(room or arrow or feature) and not face"
    )  # a face has what the feature imports
    run(*pytest_alone, "-m", "not slow", *others)
