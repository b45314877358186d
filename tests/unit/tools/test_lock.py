# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The packages of the lab and of the tests: each asked for is locked, each locked has hashes, and none says where it comes from."""

import ast
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
LAB, DEV, QUICK = "requirements-lab", "requirements-dev", "requirements-quick"
PINNED = re.compile(r"^([A-Za-z0-9._-]+)==([^\s;]+)", re.MULTILINE)
IMPORTED = {"yaml": "pyyaml", "ansible": "ansible-core"}  # packages that are imported by a name of another spelling


def text(name):
    return (ROOT / name).read_text()


def pins(lines):
    """The version of each package; that for Python 3.10 alone does not count."""
    lines = re.sub(r"(?m)^.*python(?:_full)?_version < .3\.11.*$", "", lines)
    return {name.lower().replace("_", "-"): version for name, version in PINNED.findall(lines)}


@pytest.mark.parametrize("name", [LAB, DEV, QUICK])
def test_every_requested_package_is_locked_in_its_version(name):
    asked, locked = pins(text(f"{name}.in")), pins(text(f"{name}.txt"))
    assert asked and not {name: version for name, version in asked.items() if locked.get(name) != version}, "make lock"


@pytest.mark.parametrize("name, least", [(LAB, 6), (DEV, 50), (QUICK, 20)])
def test_every_locked_package_has_hashes_and_no_place(name, least):
    packages = [block for block in re.split(r"\n(?=\S)", text(f"{name}.txt")) if not block.startswith("#")]
    assert len(packages) > least
    assert not [block for block in packages if not re.search(r" --hash=sha256:[0-9a-f]{64}", block)]
    assert not re.findall(r"(?i)://|--index|--find-links|--extra|@ ", text(f"{name}.txt"))


@pytest.mark.parametrize("name", [LAB, QUICK])
def test_tests_have_the_packages_of_others_in_the_same_versions(name):
    assert pins(text(f"{name}.txt")).items() < pins(text(f"{DEV}.txt")).items(), "make lock"


def test_setup_installs_nothing_without_its_hash():
    (line,) = [line for line in text("tools/setup.sh").splitlines() if "pip install" in line]
    assert '--require-hashes --requirement "$2.txt"' in line


def imports(path):
    """The top packages that a file imports."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield (node.module or "").partition(".")[0]


@pytest.mark.slow
def test_lab_and_plugins_import_packages_of_the_lab_alone():
    of_faults = [
        ROOT / "tests/faults" / name for name in ("catalogue.py", "judge.py")
    ]  # lab/rehearsals/cast.py reads these
    files = [*(ROOT / "lab").glob("*.py"), *(ROOT / "lab").glob("*/*.py"), *of_faults]
    files += [
        path
        for room in ("action", "filter", "lookup", "plugin_utils")
        for path in (ROOT / "plugins" / room).rglob("*.py")
    ]
    here = {name for path in files for name in (path.stem, path.parent.name)}
    allowed = set(pins(text(f"{LAB}.txt"))) | sys.stdlib_module_names | here | {"ansible_collections"}
    found = {name: path.name for path in files for name in imports(path) if IMPORTED.get(name, name) not in allowed}
    assert len(files) > 50 and not found, "put it into requirements-lab.in, and make lock"
