# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Imports from an archive after once.py compile once, and are what they are without."""

import json
import marshal
import os
import pathlib
import shutil
import subprocess
import sys
import zipfile

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[5]
ONCE = ROOT / "plugins/module_utils/_archive/once.py"
MODULES = ROOT / "plugins/modules"
PLACES = ("/run/rosfleet-multimaster", "/var/lib/rosfleet-multimaster")

PROGRAM = """
import collections, json, sys
compiled = collections.Counter()
def hear(event, arguments):
    if event == "compile" and arguments[1]:
        name = arguments[1].decode() if isinstance(arguments[1], bytes) else str(arguments[1])
        compiled[name.rpartition(".zip/")[2]] += 1
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


def set_in(folder):
    """The text of once.py with other folders."""
    text = ONCE.read_text()
    for place, name in zip(PLACES, ("run", "records")):
        assert place in text
        text = text.replace(place, f"{folder}/{name}")
    return text


@pytest.fixture
def archives(tmp_path):
    """Two archives: one with once.py, and another one."""
    with zipfile.ZipFile(tmp_path / "ours.zip", "w") as archive:
        archive.writestr("once.py", set_in(tmp_path))
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


@pytest.fixture
def kept(tmp_path):
    """The folder where compiled code is kept."""
    folder = tmp_path / "run"
    folder.mkdir(mode=0o755)
    (tmp_path / "records").mkdir()
    return folder


def test_what_was_compiled_is_kept_for_the_next_run(archives, kept):
    first, second = run("once", archives), run("once", archives)
    assert first["compiled"]["room/code.py"] == 1
    assert "room/code.py" not in second["compiled"] and second["value"] == first["value"]
    assert second["source"] == first["source"]
    (file,) = kept.iterdir()
    assert file.stat().st_mode & 0o777 == 0o600


def test_another_source_is_compiled_and_kept_beside_it(archives, kept):
    run("once", archives)
    with zipfile.ZipFile(archives[0]) as archive:
        sources = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(archives[0], "w") as archive:
        for name, source in dict(
            sources, **{"room/code.py": "def double(number):\n    return number + number\n"}
        ).items():
            archive.writestr(name, source)
    second = run("once", archives)
    assert second["compiled"]["room/code.py"] == 1 and "number + number" in second["source"]
    assert run("once", archives)["compiled"].get("room/code.py") is None
    assert len(list(kept.iterdir())) == 1


@pytest.mark.parametrize("content", [b"", b"{", b"\x00" * 100, b"i\x01\x00\x00\x00"])
def test_what_is_broken_is_compiled_anew(archives, kept, content):
    run("once", archives)
    (file,) = kept.iterdir()
    file.write_bytes(content)
    answer = run("once", archives)
    assert answer["compiled"]["room/code.py"] == 1 and answer["value"] == 4


def test_nothing_is_kept_where_there_is_no_folder(archives, tmp_path):
    (tmp_path / "records").mkdir()
    assert run("once", archives)["value"] == 4
    assert not (tmp_path / "run").exists()


def test_nothing_is_kept_on_a_computer_that_is_not_set_up(archives, kept, tmp_path):
    (tmp_path / "records").rmdir()
    run("once", archives)
    assert list(kept.iterdir()) == []


def test_one_broken_code_is_compiled_anew_and_heals(archives, kept):
    run("once", archives)
    (file,) = kept.iterdir()
    codes = marshal.loads(file.read_bytes())
    file.write_bytes(marshal.dumps(dict.fromkeys(codes, b"")))
    assert run("once", archives)["compiled"]["room/code.py"] == 1
    assert "room/code.py" not in run("once", archives)["compiled"]


def test_a_traceback_shows_lines_of_the_archive_alone(archives, kept, tmp_path):
    """A relative name would be looked for where the person's shell stands."""
    (tmp_path / "here/room").mkdir(parents=True)
    (tmp_path / "here/room/code.py").write_text("one\nsecrets of root\n")
    lines = "import sys; sys.path[:0] = sys.argv[1:]; import once, room.code, traceback\n"
    lines += "try:\n    room.code.double(None)\nexcept TypeError:\n    traceback.print_exc()\n"
    for _time in range(2):
        done = subprocess.run(
            [sys.executable, "-c", lines, *archives], check=False, capture_output=True, text=True, cwd=tmp_path / "here"
        )
        assert "return 2 * number" in done.stderr and "secrets" not in done.stderr
        assert f'File "{archives[0]}/room/code.py", line 2' in done.stderr


def test_another_level_of_optimization_is_another_code(archives, kept):
    run("once", archives)
    command = [sys.executable, "-O", "-c", PROGRAM, "once", *archives]
    subprocess.run(command, check=True, capture_output=True)
    assert len(list(kept.iterdir())) == 2


def others(path):
    path.chmod(path.stat().st_mode | 0o022)


def chown(path):
    if os.geteuid() != 0:
        pytest.skip("only root can give a file to somebody else")
    shutil.chown(path, "nobody")


@pytest.mark.parametrize("change", [others, chown])
@pytest.mark.parametrize("what", ["folder", "file"])
def test_what_others_could_have_written_is_never_run(archives, kept, change, what):
    run("once", archives)
    (file,) = kept.iterdir()
    change(kept if what == "folder" else file)
    assert run("once", archives)["compiled"]["room/code.py"] == 1


@pytest.mark.parametrize("path", sorted(MODULES.glob("*.py")), ids=lambda path: path.stem)
def test_a_module_imports_it_before_its_others(path):
    ours = [
        line
        for line in path.read_text().splitlines()
        if "module_utils._" in line and line.startswith(("from", "import"))
    ]
    assert not ours or "._archive import once" in ours[0]
