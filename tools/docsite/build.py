# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Builds the site of the documentation: the pages of docs, and every module, role, filter and lookup.

python tools/docsite/build.py        into .work/docsite/html; fails if a link leads nowhere, or the text of a page is malformed

Pages that did not change since the last time are not built again.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tools.docsite import links, pages  # noqa: E402

WORK = ROOT / ".work" / "docsite"
SOURCE, HTML = WORK / "source", WORK / "html"
BIN = Path(sys.executable).parent


def read_tree() -> pages.Tree:
    """The files that git has, or would have."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, check=True).stdout.decode()
    names = frozenset(name for name in listed.split("\0") if name and (ROOT / name).is_file())
    return pages.Tree(names, yaml.safe_load((ROOT / "galaxy.yml").read_text(encoding="utf-8"))["repository"])


def write_pages(tree: pages.Tree) -> None:
    """The pages of the tree; one that is the same stays, so Sphinx does not read it again."""
    made = {name: (ROOT / name).read_bytes() for name in tree.list_shown()}
    for name in made:
        if name.endswith(".md"):
            made[name] = tree.turn_page(name, made[name].decode()).encode()
    front = tree.turn_page(pages.FRONT, (ROOT / pages.FRONT).read_text(encoding="utf-8"))
    shelves = pages.list_shelves((ROOT / pages.INDEX).read_text(encoding="utf-8"))
    made["index.md"] = (front + pages.write_contents(shelves)).encode()
    for path in SOURCE.rglob("*"):
        name = path.relative_to(SOURCE).as_posix()
        if path.is_file() and name not in made and not name.startswith(f"{pages.REFERENCE}/"):
            path.unlink()
    for name, content in made.items():
        path = SOURCE / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.is_file() or path.read_bytes() != content:
            path.write_bytes(content)


def run(program: str, *words: str | Path) -> None:
    """One of the programs of this virtual environment. Its mistakes end this one."""
    environment = {
        **os.environ,
        "ANSIBLE_COLLECTIONS_PATH": str(ROOT / ".work" / "collections"),
        "PATH": f"{BIN}{os.pathsep}{os.environ['PATH']}",
        "LC_ALL": "C.UTF-8",
    }
    done = subprocess.run([BIN / program, *words], cwd=ROOT, env=environment, check=False)
    if done.returncode:
        raise SystemExit(f"{program} failed; the site is not as it should be.")


def write_reference() -> None:
    """The pages of modules, roles, filters and lookups, out of their own texts."""
    folder = SOURCE / pages.REFERENCE
    folder.mkdir(parents=True, exist_ok=True)
    collection = yaml.safe_load((ROOT / "galaxy.yml").read_text(encoding="utf-8"))
    run(
        *(
            "antsibull-docs",
            "--config-file",
            Path(__file__).with_name("antsibull-docs.cfg"),
            "collection",
            "--use-current",
        ),
        *("--squash-hierarchy", "--fail-on-error", "--cleanup", "similar-files", "--dest-dir", folder),
        f"{collection['namespace']}.{collection['name']}",
    )


def write_html() -> None:
    """Let Sphinx write the site. After a change of this folder it reads all pages again, which it does not see by itself."""
    here, kept = Path(__file__).parent, WORK / "doctrees"
    pickle = kept / "environment.pickle"
    last = max(path.stat().st_mtime for path in here.glob("*.py"))
    if not pickle.is_file() or pickle.stat().st_mtime < last:
        shutil.rmtree(kept, ignore_errors=True)
        shutil.rmtree(HTML, ignore_errors=True)
    words = ("--quiet", "--fail-on-warning", "--keep-going", "--jobs=auto", "--builder=html")
    run("sphinx-build", *words, "--conf-dir", here, "--doctree-dir", kept, SOURCE, HTML)


def main() -> None:
    """Build the site, and look at its links."""
    write_pages(read_tree())
    write_reference()
    write_html()
    lost = list(links.find_lost_links(HTML))
    if lost:
        raise SystemExit("\n".join([*lost, f"{len(lost)} links lead nowhere."]))
    print(f"{links.count_pages(HTML)} pages, each link within them leads somewhere: {HTML / 'index.html'}")


if __name__ == "__main__":
    main()
