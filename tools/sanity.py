# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Runs ansible-test sanity on a copy of the files that git knows or would add.

    python tools/sanity.py [--core LINE] [ARGUMENT OF ansible-test]...

With `--core` ("2.16"), it is that line's own ansible-test, with its ignore file; else the one of the tests' tools.

ansible-test wants a collection at .../ansible_collections/NAMESPACE/NAME, and looks at every file it finds there.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
WORK = ROOT / ".work" / "sanity"
COPY = WORK / "ansible_collections" / "rosfleet" / "multimaster"
INTERPRETERS = ("2.7", *(f"3.{number}" for number in range(6, 14)))  # of robots and controllers, for any line
OF_2_20 = "3.12"  # the Python that ansible-core needs since then; before, it runs on the Python of the tests' tools

# ansible-test fetches a script that puts pip into the virtual environments of its tests. Python brings a pip of its own:
# this stands in for the script, so that nothing but packages is fetched.
GET_PIP = "import ensurepip\n\nensurepip.bootstrap()\n"


def copy() -> None:
    """Make the copy anew."""
    shutil.rmtree(COPY, ignore_errors=True)
    COPY.mkdir(parents=True)
    names = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        check=True,
    ).stdout
    subprocess.run(
        ["rsync", "--archive", "--ignore-missing-args", "--from0", "--files-from=-", f"{ROOT}/", f"{COPY}/"],
        input=names,
        check=True,
    )
    # A repository of its own, or ansible-test asks the one around it, which ignores .work.
    subprocess.run(["git", "init", "--quiet"], cwd=COPY, check=True)


def install(line: str, folder: Path) -> Path:
    """Install the newest release of a line of ansible-core; return the folder of its programs."""
    is_new = [int(part) for part in line.split(".")] >= [2, 20]
    python = folder / f"python{OF_2_20}" if is_new else sys.executable
    venv = WORK / f"core-{line}"
    if not (venv / "bin" / "ansible-test").exists():
        subprocess.run([python, "-m", "venv", "--clear", venv], check=True)
        pip = [str(venv / "bin" / "python"), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        subprocess.run([*pip, f"ansible-core=={line}.*"], check=True)
    return venv / "bin"


def stand_in_for_get_pip(programs: Path) -> None:
    """Put the stand-in in the place of ansible-test's download, unless that is there."""
    requirements = next(
        programs.parent.glob("lib/python3*/site-packages/ansible_test/_internal/python_requirements.py")
    )
    version = re.search(r"pip='([\d.]+)'", requirements.read_text())
    if not version:
        return
    script = Path.home() / ".ansible" / "test" / "cache" / f"get_pip_{version[1].replace('.', '_')}.py"
    if not script.exists():
        script.parent.mkdir(parents=True, exist_ok=True)
        script.write_text(GET_PIP)


def interpreters() -> Path:
    """A folder for PATH with pyenv's interpreters under their plain names; its shims refuse versions that are not selected."""
    folder = WORK / "bin"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    installed = Path(os.environ.get("PYENV_ROOT") or Path.home() / ".pyenv") / "versions"
    for version in INTERPRETERS:
        for found in sorted(installed.glob(f"{version}.*/bin/python{version}"))[-1:]:
            wrapper = folder / f"python{version}"
            wrapper.write_text(f'#!/bin/sh\nexec "{found}" "$@"\n')
            wrapper.chmod(0o755)
    return folder


def main() -> int:
    """Return ansible-test's exit status; other arguments are handed on to it."""
    parser = argparse.ArgumentParser(allow_abbrev=False)
    parser.add_argument("--core", metavar="LINE")
    options, others = parser.parse_known_args()
    copy()
    folder = interpreters()
    programs = install(options.core, folder) if options.core else Path(sys.executable).parent
    stand_in_for_get_pip(programs)
    path = os.pathsep.join([str(folder), str(programs), os.environ["PATH"]])
    command = ["ansible-test", "sanity", "--local", "--color", "no", *others]
    return subprocess.run(command, cwd=COPY, env={**os.environ, "PATH": path}, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
