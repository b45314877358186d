# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The pages: each link leads somewhere, each page that a file names is there, the index has them all; the README's inventory works."""

import configparser
import os
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
FILES = subprocess.run(
    ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
    cwd=ROOT,
    capture_output=True,
    text=True,
    check=True,
).stdout.split("\0")
THERE = {name for name in FILES if name and (ROOT / name).is_file()}
FOLDERS = {str(folder) for name in THERE for folder in Path(name).parents}
PAGES = sorted(name for name in THERE if name.endswith(".md"))

FENCED = re.compile(r"^( *)```.*?^\1```$", re.DOTALL | re.MULTILINE)
CODE = re.compile(r"`[^`\n]+`")
INLINE = re.compile(r"\]\(([^()\s]+)\)")
DEFINED = re.compile(r"^\[[^\]]+\]: (\S+)", re.MULTILINE)
HEADING = re.compile(r"^#+ (.+)$", re.MULTILINE)
NAMED = re.compile(r"`([\w./-]+\.(?:py|yml|md|txt|in|json))`")
#: Files that docs/develop/adding.md tells to write.
EXAMPLES = {"freebsd.py", "dhcpcd.py", "test_dhcpcd.py", "NAME.py", "test_NAME.py", "two.txt"}
MENTION = re.compile(r"(?<![\w./-])docs/[\w/-]+(?:\.\w+)*")

#: These two lay down pages that are not there.
OF_TESTS = {"tests/unit/test_documents.py", "tests/unit/test_shipped.py"}
#: The unit of the roscore has the former name of its page: with another text, the roscores of all robots would start anew.
OF_THE_UNIT = {"plugins/plugin_utils/_plan/units.py", "tests/unit/golden/providers/bundled.txt"}


def text(name):
    return (ROOT / name).read_text(encoding="utf-8")


def without_code(page):
    return CODE.sub("", FENCED.sub("", page))


def anchors(page):
    """The names of the headings, as GitHub makes them."""
    found, seen = set(), Counter()
    for title in HEADING.findall(FENCED.sub("", page)):
        title = re.sub(r"\[([^\]]+)\]\([^)]+\)", r"\1", title)
        name = re.sub(r"[^\w\- ]", "", title.strip().lower()).replace(" ", "-")
        found.add(f"{name}-{seen[name]}" if seen[name] else name)
        seen[name] += 1
    return found


def leads(page, link):
    """The fault of a relative link of a page; "" if it leads to a file, and to a heading in it."""
    path, _hash, anchor = link.partition("#")
    target = os.path.normpath(os.path.join(os.path.dirname(page), path)) if path else page
    if target not in THERE and target not in FOLDERS:
        return f"{page}: {link} leads to {target}, which is not there"
    if anchor and anchor not in anchors(text(target)):
        return f"{page}: {link} leads to a heading that {target} does not have"
    return ""


def links(page):
    """The relative links of a page: inline ones, pictures, and those defined at its end."""
    written = without_code(text(page))
    found = [*INLINE.findall(written), *DEFINED.findall(written)]
    return [link for link in found if not re.match(r"[a-z]+:", link)]


def test_each_link_of_a_page_leads_to_a_file_and_a_heading():
    found = [(page, link) for page in PAGES for link in links(page)]
    assert len(found) > 200 and sum("#" in link for _page, link in found) > 20
    assert list(filter(None, (leads(page, link) for page, link in found))) == []


@pytest.mark.parametrize("ending", [".md", ".py", ".yml", "Makefile", ".sh", ".txt", ".toml", ".in"])
def test_each_page_that_a_file_names_is_there(ending):
    """In prose, in comments, in what users are told."""
    lost = []
    for name in sorted(name for name in THERE - OF_TESTS if name.endswith(ending)):
        named = {mention.rstrip("/") for mention in MENTION.findall(text(name))}
        former = {"docs/roscore.md"} if name in OF_THE_UNIT else set()
        lost += [f"{name}: {mention}" for mention in sorted(named - THERE - FOLDERS - former)]
    assert lost == []


@pytest.mark.parametrize("page", ["docs/develop/adding.md", "CONTRIBUTING.md"])
def test_each_file_that_a_page_for_developers_names_is_there(page):
    """By its path, or by its end, such as `_verify/components/component.py`."""
    named = {name for name in NAMED.findall(FENCED.sub("", text(page))) if Path(name).name not in EXAMPLES}
    ends = tuple(f"/{name}" for name in THERE)
    lost = [name for name in named if not any(end.endswith(f"/{name}") for end in ends)]
    assert len(named) > 3 and lost == []


def test_the_index_has_each_page_once():
    listed = Counter(os.path.normpath(f"docs/{link}") for link in links("docs/README.md"))
    pages = {name for name in PAGES if re.fullmatch(r"docs/\w+/\w+\.md", name)}
    assert len(pages) > 20 and {page: listed[page] for page in pages} == dict.fromkeys(pages, 1)


def test_the_inventory_of_the_readme_is_the_shipped_one():
    """`test_inventories.py` plans that one; tests/systems/test_readme.py sets up a fleet with it."""
    blocks = re.findall(r"^```yaml\n# ([\w./]+\.yml)\b.*\n((?s:.*?))^```$", text("README.md"), re.MULTILINE)
    folder = ROOT / "inventory/single_computer"
    shipped = {str(path.relative_to(folder)): yaml.safe_load(path.read_text()) for path in folder.rglob("*.yml")}
    assert len(blocks) == 2 == text("README.md").count("```yaml")
    written = {name: yaml.safe_load(block) for name, block in blocks}
    assert written == shipped


INSTALL = re.compile(r"ansible-galaxy collection install ([^`\n]*)")
SMALL = "namespace: rosfleet\nname: multimaster\nversion: 0.0.1\nreadme: README.md\nauthors: [somebody]\n"


@pytest.mark.whole
def test_the_collection_is_installed_where_ansible_looks_from_everywhere(tmp_path):
    """Also in a clone, whose ansible.cfg has a folder of the clone first: by the command of the README, with a small repository."""
    found = {
        page: options for page in PAGES for options in INSTALL.findall(text(page)) if not page.startswith("changelogs")
    }
    assert {"README.md", "docs/start/first_fleet.md", "docs/start/machines.md"} <= set(found)
    assert all(options.startswith("-p ~/.ansible/collections ") for options in found.values()), found
    clone, small = tmp_path / "clone", tmp_path / "small"
    for folder in (clone, small):
        folder.mkdir()
    (clone / "ansible.cfg").write_text(text("ansible.cfg"))
    for name, content in (("galaxy.yml", SMALL), ("README.md", "# small\n")):
        (small / name).write_text(content)
    git = "git -c user.name=test -c user.email=test@localhost"
    subprocess.run(f"git init -q && git add -A && {git} commit -q -m test", shell=True, cwd=small, check=True)
    url = re.search(r"git\+\S+", found["README.md"]).group()
    command = f"ansible-galaxy collection install {found['README.md']}".replace(url, f"git+file://{small}")
    environment = {name: value for name, value in os.environ.items() if not name.startswith("ANSIBLE_")}
    environment.update(HOME=str(tmp_path), PATH=f"{Path(sys.executable).parent}:{os.environ['PATH']}")
    done = subprocess.run(
        ["bash", "-c", command], cwd=clone, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert (tmp_path / ".ansible/collections/ansible_collections/rosfleet/multimaster/README.md").exists()
    assert [path.name for path in clone.iterdir()] == ["ansible.cfg"]


def test_the_table_of_the_playbooks_has_each_one():
    listed = set(re.findall(r"^\| `rosfleet.+?\|", text("docs/start/playbooks.md"), re.MULTILINE))
    names = {name for row in listed for name in re.findall(r"rosfleet\.multimaster\.(\w+)", row)}
    assert names == {Path(name).stem for name in THERE if re.fullmatch(r"playbooks/\w+\.yml", name)}

    (row,) = (row for row in text("docs/start/playbooks.md").splitlines() if "begin with it" in row)
    first = {
        Path(name).stem
        for name in THERE
        if name.startswith("playbooks/") and "import_playbook: has_robots" in text(name)
    }
    assert set(re.findall(r"`(\w+)`", row.partition("without robots. ")[2])) == first


def test_a_page_calls_playbooks_by_their_installed_names():
    pages = {page: text(page) for page in PAGES if not page.startswith("docs/develop/")}
    command = re.compile(r"ansible-(?:playbook|navigator) [^\n`]*?(?<![\w/])(?:playbooks/\w+|site)\.yml.*")
    assert {page: found for page, words in pages.items() if (found := command.findall(words))} == {}


def test_the_settings_for_users_are_those_of_the_checkout():
    (block,) = re.findall(r"^```ini\n(.*?)^```$", text("docs/start/playbooks.md"), re.DOTALL | re.MULTILINE)
    told, own = configparser.ConfigParser(), configparser.ConfigParser()
    told.read_string(block)
    own.read_string(text("ansible.cfg"))
    assert [told[part] for part in told] and all(told[part].items() <= own[part].items() for part in told)
