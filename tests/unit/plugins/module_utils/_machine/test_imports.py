# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Imports are tried by a user without rights, and the answer is that of a stranger."""

import os
import pathlib
import shutil
import tempfile

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import imports
from ansible_collections.rosfleet.multimaster.plugins.module_utils._process.commands import Answer

PYTHON = "/usr/bin/python3"
pytestmark = pytest.mark.skipif(not os.path.exists(PYTHON), reason=f"there is no {PYTHON}")


@pytest.fixture(name="package")
def fixture_package():
    """A module that others may read; its code says what is tried."""
    folder = pathlib.Path(tempfile.mkdtemp())
    folder.chmod(0o755)
    package = folder / "rospy"
    package.mkdir()
    (package / "__init__.py").write_text("")
    yield package
    shutil.rmtree(folder)


def tried(package, *modules):
    environment = {"PYTHONPATH": str(package.parent), "PATH": "/usr/bin:/bin", "PYTHONDONTWRITEBYTECODE": "1"}
    return imports.attempt(PYTHON, modules or ("rospy",), environment)


def test_modules_that_are_there(package):
    found = tried(package, "rospy", "json")
    assert (found.missing, found.error) == ([], "") and found.version.startswith("3.")


def test_a_module_that_fails_is_missing(package):
    (package / "__init__.py").write_text("import nothing\n")
    assert tried(package, "rospy", "json", "not_there").missing == ["rospy", "not_there"]


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can lose its rights")
def test_no_code_of_it_runs_as_root(package):
    (package / "__init__.py").write_text("import os\nassert os.getuid() != 0 and os.geteuid() != 0\n")
    assert tried(package).missing == []


def test_what_it_prints_is_not_the_answer(package):
    (package / "__init__.py").write_text('print(\'{"version": "3.1.1", "missing": []}\')\nimport nothing\n')
    assert tried(package).missing == ["rospy"]


@pytest.mark.parametrize(
    "answer", [b"", b"[]", b'{"version": 3, "missing": []}', b'{"version": "3.9\\n", "missing": []}']
)
def test_no_answer_is_said(package, monkeypatch, answer):
    monkeypatch.setattr(imports, "foreign", lambda *words: Answer(1, answer, "what\nit said \x1b[0m"))
    assert tried(package) == imports.Trial("", [], "it said \\x1b[0m")
