# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Imports from an archive after once.py compile once, and are what they are without."""

import json
import pathlib
import subprocess
import sys
import zipfile

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[5]
ONCE = ROOT / "plugins/module_utils/_archive/once.py"
MODULES = ROOT / "plugins/modules"

PROGRAM = """
import collections, json, sys
compiled = collections.Counter()
def hear(event, arguments):
    if event == "compile" and arguments[1]:
        name = arguments[1].decode() if isinstance(arguments[1], bytes) else str(arguments[1])
        compiled[name.partition(".zip/")[2]] += 1
sys.addaudithook(hear)
sys.path[:0] = sys.argv[2:]
if sys.argv[1] == "once":
    import once
import inspect
import room.code, missing_or_not
print(json.dumps({
    "compiled": compiled,
    "files": [room.__file__, room.code.__file__, missing_or_not.__file__],
    "source": inspect.getsource(room.code.double),
    "value": room.code.double(2),
}))
"""


@pytest.fixture
def archives(tmp_path):
    """Two archives: one with once.py, and another one."""
    with zipfile.ZipFile(tmp_path / "ours.zip", "w") as archive:
        archive.write(ONCE, "once.py")
        archive.writestr("room/__init__.py", "")
        archive.writestr("room/code.py", "def double(number):\n    return 2 * number\n")
    with zipfile.ZipFile(tmp_path / "theirs.zip", "w") as archive:
        archive.writestr("missing_or_not.py", "")
    return [str(tmp_path / "ours.zip"), str(tmp_path / "theirs.zip")]


def run(how, archives):
    command = [sys.executable, "-c", PROGRAM, how, *archives]
    return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


def test_each_source_is_compiled_once(archives):
    without, answer = run("as it is", archives), run("once", archives)
    assert answer["compiled"]["room/code.py"] == answer["compiled"]["room/__init__.py"] == 1
    assert without["compiled"]["room/code.py"] > 1  # else Python has learned it, and once.py may go
    assert without["compiled"]["missing_or_not.py"] == answer["compiled"]["missing_or_not.py"]  # of another archive
    for same in ("files", "source", "value"):
        assert answer[same] == without[same]


def test_a_module_that_is_not_there_is_missing_as_always(archives):
    lines = "import sys; sys.path[:0] = sys.argv[1:]; import once\ntry:\n  import room.nothing\nexcept ImportError as e: print(e.name)"
    done = subprocess.run([sys.executable, "-c", lines, *archives], check=True, capture_output=True, text=True)
    assert done.stdout == "room.nothing\n"


@pytest.mark.parametrize("path", sorted(MODULES.glob("*.py")), ids=lambda path: path.stem)
def test_a_module_imports_it_before_its_others(path):
    ours = [
        line
        for line in path.read_text().splitlines()
        if "module_utils._" in line and line.startswith(("from", "import"))
    ]
    assert not ours or "._archive import once" in ours[0]
