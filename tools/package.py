# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Builds the collection out of the files that git has, so that nothing else in the folder is shipped.

python tools/package.py FOLDER     writes the archive into the folder

`build_ignore` in galaxy.yml says which of them are for development only. Pages link to files beside them; in the archive, a link to a
file that is not shipped leads to the repository, at the tag of the version. So does each link and picture of the README: Galaxy shows
it in a place of its own, where no other file is.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Collection
from fnmatch import fnmatchcase
from pathlib import Path, PurePosixPath
from typing import Any

import yaml

ROOT = Path(__file__).resolve().parents[1]
RAW = "https://raw.githubusercontent.com/"
ALONE = "README.md"  # it is shown without the other files
_CODE = re.compile(r"(^ *```.*?^ *```$|`[^`\n]+`)", re.DOTALL | re.MULTILINE)
_LINK = re.compile(r"(\]\(|^\[[^\]]+\]: )(?![a-z]+:|#)([^()\s]+)", re.MULTILINE)


def list_files() -> list[str]:
    """The files that git has and that are there."""
    command = ["git", "ls-files", "-z", "--cached"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, check=True).stdout.decode()
    return sorted(name for name in listed.split("\0") if name and os.path.lexists(ROOT / name))


def copy_tree(folder: Path) -> None:
    """Copy these files as they are now; links stay links."""
    for name in list_files():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, folder / name, follow_symlinks=False)


def list_shipped(names: Collection[str], metadata: dict[str, Any]) -> set[str]:
    """Return the files that `build_ignore` leaves, as ansible-galaxy reads its patterns: each is of a file or a folder."""
    patterns = metadata["build_ignore"]

    def is_shipped(name: str) -> bool:
        paths = [name, *map(str, list(PurePosixPath(name).parents)[:-1])]
        return not any(fnmatchcase(path, pattern) for path in paths for pattern in patterns)

    return set(filter(is_shipped, names))


def fix_links(page: str, text: str, near: Collection[str], metadata: dict[str, Any]) -> str:
    """Return a page in which links to files that are not `near` lead to the repository, and its pictures to their bytes there."""
    repository, version = metadata["repository"], metadata["version"]
    raw = repository.replace("https://github.com/", RAW)
    folders = {str(parent) for name in near for parent in PurePosixPath(name).parents}

    def fix(link: re.Match[str]) -> str:
        path, mark, anchor = link[2].partition("#")
        target = os.path.normpath(os.path.join(os.path.dirname(page), path))
        if target in near or target in folders:
            return link[0]
        kind = PurePosixPath(target).suffix
        if kind in (".png", ".svg"):
            return (
                f"{link[1]}{raw}/{version}/{target}{'?sanitize=true' * (kind == '.svg')}"  # else GitHub may send a text
            )
        return f"{link[1]}{repository}/{'blob' if kind else 'tree'}/{version}/{target}{mark}{anchor}"

    # After a split by a group, every second piece is code.
    parts = _CODE.split(text)
    return "".join(part if number % 2 else _LINK.sub(fix, part) for number, part in enumerate(parts))


def fix_pages(tree: Path) -> None:
    """Write the pages of a copy of the tree as they are shipped."""
    metadata = yaml.safe_load((tree / "galaxy.yml").read_text(encoding="utf-8"))
    shipped = list_shipped(list_files(), metadata)
    for name in shipped:
        if name.endswith(".md"):
            text = (tree / name).read_text(encoding="utf-8")
            near = () if name == ALONE else shipped
            (tree / name).write_text(fix_links(name, text, near, metadata), encoding="utf-8")


def build(tree: Path, target: Path) -> Path:
    """Build the collection of a tree; return the archive."""
    program = Path(sys.executable).with_name("ansible-galaxy")
    command = [str(word) for word in (program, "collection", "build", "--force", "--output-path", target, tree)]
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
    """Build it, and print the path of the archive."""
    target = Path(sys.argv[1]).absolute()
    with tempfile.TemporaryDirectory() as folder:
        copy_tree(Path(folder))
        fix_pages(Path(folder))
        print(build(Path(folder), target))


if __name__ == "__main__":
    main()
