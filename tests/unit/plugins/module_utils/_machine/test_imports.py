# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The proof that modules can be imported: it is worth nothing as soon as one file is another one."""

import json
import os
import pathlib
import shutil
import tempfile
import time

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import imports
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.commands import Answer

PYTHON = "/usr/bin/python3"
pytestmark = pytest.mark.skipif(not os.path.exists(PYTHON), reason=f"there is no {PYTHON}")


class House:
    """A folder with a module that others may read, and a file for the proof."""

    def __init__(self, folder):
        self.folder = folder
        self.modules = folder / "python"
        self.proof = folder / "run/imports.json"
        self.package = self.modules / "rospy"
        self.package.mkdir(parents=True)
        (self.package / "__init__.py").write_text("from rospy import core\n")
        (self.package / "core.py").write_text("import os\nWHO = os.getuid()\n")

    def environment(self):
        return {"PYTHONPATH": str(self.modules), "PATH": "/usr/bin:/bin", "PYTHONDONTWRITEBYTECODE": "1"}

    def tried(self, keep=True, modules=("rospy",)):
        return imports.tried(PYTHON, modules, self.environment(), str(self.proof), keep)


@pytest.fixture(name="house")
def fixture_house(monkeypatch):
    folder = pathlib.Path(tempfile.mkdtemp())
    folder.chmod(0o755)
    monkeypatch.setattr(imports, "_OF_THE_SANDBOX", ("/proc", "/dev"))  # the folder is below /tmp
    monkeypatch.setattr(imports, "_SETTLED", -(10**12))  # and has been there for no time
    yield House(folder)
    shutil.rmtree(folder)


@pytest.fixture(name="asked")
def fixture_asked(monkeypatch):
    """Counts the imports that are really tried."""
    counted = []
    real = imports.foreign
    monkeypatch.setattr(imports, "foreign", lambda *words: counted.append(words) or real(*words))
    return counted


def test_what_was_proved_is_not_tried_again(house, asked):
    first = house.tried()
    assert first.version.startswith("3.") and first.missing == []
    assert house.tried() == first
    assert len(asked) == 1
    assert house.proof.stat().st_mode & 0o777 == 0o600
    assert [path.name for path in house.proof.parent.iterdir()] == ["imports.json"]


def test_without_leave_nothing_is_kept(house, asked):
    house.tried(keep=False)
    house.tried(keep=False)
    assert len(asked) == 2 and not house.proof.parent.exists()


def test_code_that_others_can_change_proves_nothing(house, asked):
    house.tried()
    imports.tried(PYTHON, ("rospy",), house.environment(), "", True)
    assert len(asked) == 2


def aged(path):
    """Write other bytes of the same length, and give the file its old time."""
    before = path.stat()
    path.write_text(path.read_text().replace("getuid", "getgid"))
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))


def moved(house):
    shutil.copytree(house.package, house.folder / "other")
    shutil.rmtree(house.package)
    (house.folder / "other").rename(house.package)


CHANGES = {
    "a file that was read has other bytes": lambda house: (house.package / "core.py").write_text("import nothing\n"),
    "a file that was read is gone": lambda house: (house.package / "core.py").unlink(),
    "a folder on the way has another mode": lambda house: house.folder.chmod(0o711),
    "a module of the same name comes before it": lambda house: (house.modules / "json.py").write_text(
        "raise OSError\n"
    ),
    "a file beside it": lambda house: (house.package / "core.cpython-39.so").write_text(""),
    "a line for all of Python": lambda house: (house.modules / "early.pth").write_text("import nothing\n"),
    "the same file with the time of before": lambda house: aged(house.package / "core.py"),
    "the folder is another one with the same files": moved,
}


def test_a_link_and_what_it_leads_to_count(house, asked):
    """An installation may stand on another disk, and /usr/bin/python3 is a link that somebody turns elsewhere."""
    disk = house.folder / "disk"
    (disk / "ros").mkdir(parents=True)
    house.modules.rename(disk / "ros/python")
    house.modules.symlink_to(disk / "ros/python")
    house.tried()
    house.tried()
    assert len(asked) == 1
    disk.chmod(0o700)
    assert house.tried().missing == ["rospy"] and len(asked) == 2


def test_a_turned_python_counts(house, asked):
    link = house.folder / "python3"
    link.symlink_to(PYTHON)

    def tried():
        return imports.tried(str(link), ("rospy",), house.environment(), str(house.proof), True)

    assert tried() == tried() and len(asked) == 1
    link.unlink()
    link.symlink_to("/bin/false")
    assert tried().version == "" and len(asked) == 2


def test_a_library_that_comes_first_counts(house, asked):
    (house.folder / "lib").mkdir()
    environment = dict(house.environment(), LD_LIBRARY_PATH=f"{house.folder}/lib")
    for _time in range(2):
        imports.tried(PYTHON, ("rospy",), environment, str(house.proof), True)
    assert len(asked) == 1
    time.sleep(0.02)  # the clock of files
    (house.folder / "lib/libffi.so.8").write_text("")
    imports.tried(PYTHON, ("rospy",), environment, str(house.proof), True)
    assert len(asked) == 2


def test_a_package_that_several_folders_make_up(house, asked):
    (house.modules / "many").mkdir()
    (house.modules / "many/part.py").write_text("")
    (house.package / "core.py").write_text("import many.part\n")
    house.tried()
    house.tried()
    assert len(asked) == 1
    time.sleep(0.02)  # the clock of files
    (house.modules / "many/__init__.py").write_text("raise ImportError\n")
    assert house.tried().missing == ["rospy"]


@pytest.mark.parametrize(
    "code",
    [
        "import sys, types\nclass Lazy(types.ModuleType):\n    def __getattr__(self, name):\n        raise ImportError(name)\n"
        "sys.modules['lazy'] = Lazy('lazy')\n",
        "import sys\nsys.modules['none'] = None\n",
        "import sys, types\nsys.modules.update((f'm{n}', types.ModuleType('m')) for n in range(5000))\n"
        "for n in range(5000):\n    sys.modules[f'm{n}'].__file__ = '/nowhere/' + 'long' * 20 + str(n)\n",
    ],
    ids=["lazy", "none", "very many"],
)
def test_what_cannot_be_collected_is_still_imported(house, code):
    (house.package / "core.py").write_text(code)
    assert house.tried().missing == []


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a file to somebody else")
def test_a_file_in_other_hands_proves_nothing(house):
    shutil.chown(house.package / "core.py", "nobody")
    assert house.tried().missing == []
    assert not house.proof.exists()


def test_a_full_disk_leaves_nothing(house, monkeypatch):
    def full(*_words, **_more):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(imports.json, "dump", full)
        house.tried()
    assert list(house.proof.parent.iterdir()) == []
    house.tried()
    (house.proof.parent / "imports.json.4711").write_text("{")  # of a killed run
    imports.forget(str(house.proof))
    assert not house.proof.parent.exists()


@pytest.mark.parametrize("change", CHANGES.values(), ids=CHANGES)
def test_after_any_change_it_is_tried_again(house, asked, change):
    house.tried()
    time.sleep(0.02)  # the clock of files
    change(house)
    house.tried()
    assert len(asked) == 2


def test_a_module_that_fails_is_missing_and_never_kept(house):
    (house.package / "core.py").write_text("import nothing\n")
    assert house.tried().missing == ["rospy"]
    assert not house.proof.exists()
    (house.package / "core.py").write_text("")
    assert house.tried().missing == []


def test_another_question_has_another_answer(house, asked):
    house.tried()
    house.tried(modules=("rospy", "json"))
    assert len(asked) == 2


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a file to somebody else")
def test_the_proof_of_somebody_else_is_none(house, asked):
    house.tried()
    shutil.chown(house.proof, "nobody")
    house.tried()
    assert len(asked) == 2


@pytest.mark.parametrize("content", ["", "{", "[]", '{"version": "3.11.2"}', "\xff", '{"states": 1}'])
def test_a_broken_proof_is_none(house, asked, content):
    house.tried()
    house.proof.write_bytes(content.encode("latin-1"))
    assert house.tried().missing == []
    assert len(asked) == 2


def test_what_changed_meanwhile_is_not_kept(house, monkeypatch):
    monkeypatch.setattr(imports, "_SETTLED", 10**9)
    house.tried()
    assert not house.proof.exists()


def test_what_only_the_sandbox_sees_is_not_kept(house, monkeypatch):
    monkeypatch.setattr(imports, "_OF_THE_SANDBOX", (str(house.folder.parent),))
    house.tried()
    assert not house.proof.exists()


HOSTILE = {
    "no list": {"version": "3.9.1", "missing": [], "read": "/etc"},
    "a relative path": {"version": "3.9.1", "missing": [], "read": ["etc/passwd"]},
    "an escape": {"version": "3.9.1", "missing": [], "read": ["/\x1b[2J"]},
    "a NUL": {"version": "3.9.1", "missing": [], "read": ["/etc\0"]},
    "too many": {"version": "3.9.1", "missing": [], "read": [f"/{number}" for number in range(imports._MOST + 1)]},
    "a number": {"version": "3.9.1", "missing": [], "read": [7]},
}


@pytest.mark.parametrize("told", HOSTILE.values(), ids=HOSTILE)
def test_an_answer_of_strangers_is_not_kept(house, monkeypatch, told):
    monkeypatch.setattr(imports, "foreign", lambda *words: Answer(0, json.dumps(told).encode(), ""))
    assert house.tried() == imports.Imported("3.9.1", [])
    assert not house.proof.exists()


@pytest.mark.parametrize(
    "answer", [b"", b"[]", b'{"version": 3, "missing": []}', b'{"version": "3.9\\n", "missing": []}']
)
def test_no_answer_is_said(house, monkeypatch, answer):
    monkeypatch.setattr(imports, "foreign", lambda *words: Answer(1, answer, "what\nit said \x1b[0m"))
    assert house.tried() == imports.Imported("", [], "it said \\x1b[0m")


def test_forgotten(house):
    house.tried()
    imports.forget(str(house.proof))
    assert not house.proof.parent.exists()
    imports.forget(str(house.proof))


def test_all_that_python_reads_is_in_it(house):
    house.tried()
    states = json.loads(house.proof.read_text())["states"]
    for path in (house.package / "core.py", house.package, house.modules, house.folder, pathlib.Path("/")):
        assert states[str(path)], path
    assert any("/libc" in path for path in states) and os.path.realpath(PYTHON) in states
