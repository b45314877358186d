# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Runs ansible-test sanity on a copy of the files that git knows or would add.

ansible-test wants a collection at .../ansible_collections/NAMESPACE/NAME, and looks at every file it finds there.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
WORK = ROOT / ".work" / "sanity"
COPY = WORK / "ansible_collections" / "rosfleet" / "multimaster"
INTERPRETERS = ("3.8", "3.9", "3.10", "3.11", "3.12", "3.13")

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


def stand_in_for_get_pip() -> None:
    """Put the stand-in where ansible-test keeps its download, unless that is there."""
    import ansible_test._internal.python_requirements as requirements

    version = re.search(r"pip='([\d.]+)'", Path(requirements.__file__).read_text())
    if not version:
        return
    script = Path.home() / ".ansible" / "test" / "cache" / f"get_pip_{version[1].replace('.', '_')}.py"
    if not script.exists():
        script.parent.mkdir(parents=True, exist_ok=True)
        script.write_text(GET_PIP)


def interpreters() -> Path:
    """A folder for PATH with pyenv's interpreters under their plain names; its shims refuse what is not selected."""
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
    """Return ansible-test's exit status; arguments are handed on to it."""
    copy()
    stand_in_for_get_pip()
    path = os.pathsep.join([str(interpreters()), str(Path(sys.executable).parent), os.environ["PATH"]])
    command = ["ansible-test", "sanity", "--local", "--color", "no", *sys.argv[1:]]
    return subprocess.run(command, cwd=COPY, env={**os.environ, "PATH": path}, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
