# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Writes which files the collection ships, by name, and builds it.

python tools/package.py            writes tests/unit/shipped.txt, and with it `manifest` in galaxy.yml

The list is made of the files that git has and that are of a kind that is shipped: `git add` a new one first, and look at the
difference of the list before you commit it. What else lies in the folder is not shipped, whatever its name: nothing in
galaxy.yml stands for several files.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tarfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LIST = ROOT / "tests" / "unit" / "shipped.txt"
GALAXY = ROOT / "galaxy.yml"
DIRECTIVES = "  directives:\n"  # the last key of galaxy.yml
# What is shipped, of the files that git has: `*` is any text without a slash, `**/` any folders. No pictures: they would be
# half of the archive, and nothing shows them where a collection is installed.
KINDS = """
README.md CONTRIBUTING.md REUSE.toml
CHANGELOG.rst CODE_OF_CONDUCT.md MAINTAINERS.md SECURITY.md
meta/runtime.yml meta/execution-environment.yml
changelogs/changelog.yaml changelogs/config.yaml
docs/README.md docs/start/*.md docs/operate/*.md docs/understand/*.md docs/develop/*.md docs/grafana/*.json
LICENSES/*.txt
playbooks/*.yml playbooks/tasks/*.yml
inventory/single_computer/**/*.yml inventory/multi_computer/**/*.yml inventory/tunnel/**/*.yml inventory/identical_robots/**/*.yml
plugins/**/*.py plugins/**/*.yml plugins/**/*.j2
roles/**/*.yml roles/*/README.md
roles/nodes/files/**/*.py roles/nodes/files/**/*.conf roles/nodes/files/**/*.msg roles/nodes/files/**/*.srv
roles/nodes/files/**/package.xml
""".split()


def _pattern(kind: str) -> str:
    words = {"**/": r"(?:[^/.][^/]*/)*", "*": r"[^/.][^/]*"}
    return "".join(words.get(word) or re.escape(word) for word in re.split(r"(\*\*/|\*)", kind))


_KINDS = re.compile("|".join(map(_pattern, KINDS)))


def ours() -> list[str]:
    """The files that git has and that are of a kind that is shipped."""
    command = ["git", "ls-files", "-z", "--cached"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, check=True).stdout.decode()
    there = {name for name in listed.split("\0") if name and os.path.lexists(ROOT / name)}
    return sorted(name for name in there if _KINDS.fullmatch(name))


def galaxy(names: list[str]) -> str:
    """The text of galaxy.yml with these files."""
    strange = [name for name in names if not re.fullmatch(r"[\w./-]+", name)]
    if strange:
        raise SystemExit(f"{strange[0]!r} has letters that galaxy.yml reads otherwise: give it another name.")
    head, _key, _old = GALAXY.read_text().partition(DIRECTIVES)
    return head + DIRECTIVES + "".join(f"    - include {name}\n" for name in names)


def clean_tree(folder: Path) -> None:
    """Copy the files that git knows, or would know, as they are now; links stay links."""
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        check=True,
    )
    for name in filter(None, listed.stdout.decode().split("\0")):
        if os.path.lexists(ROOT / name):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name, follow_symlinks=False)


def build(tree: Path, target: Path) -> Path:
    """Build the collection of a tree; return the archive."""
    program = Path(sys.executable).with_name("ansible-galaxy")
    command = [str(word) for word in (program, "collection", "build", "--output-path", target, tree)]
    done = subprocess.run(
        command, cwd=tree, capture_output=True, text=True, check=False, env={**os.environ, "LC_ALL": "C.UTF-8"}
    )
    if done.returncode:
        raise SystemExit(f"ansible-galaxy failed: {done.stdout}{done.stderr}")
    return next(target.glob("*.tar.gz"))


def content(archive: Path) -> list[str]:
    """The files in an archive; a link is said to be one."""
    with tarfile.open(archive) as opened:
        return sorted(
            member.name if member.isfile() else f"{member.name} (no file)" for member in opened if not member.isdir()
        )


def main() -> None:
    """Write the list, and galaxy.yml."""
    names = ours()
    LIST.write_text("".join(f"{name}\n" for name in names))
    GALAXY.write_text(galaxy(names))


if __name__ == "__main__":
    main()
