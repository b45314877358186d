# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Shells as people have them: what is told of their variables is what real shells export, and no password is shown."""

import os
import pathlib
import pwd
import re
import shutil
import subprocess
import tempfile

import field
import pytest
import yaml
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import person_shells, shells
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine.person_shells import Person
from hypothesis import given
from hypothesis import strategies as st

pytestmark = [
    pytest.mark.root,
    pytest.mark.skipif(os.geteuid() != 0, reason="to become a person takes root"),
]
NAMES = shells.VARIABLES
NOBODY = pwd.getpwnam("nobody")
CASES = {name.removesuffix(".yml"): yaml.safe_load(content) for name, content in field.read("shells").items()}
MAIN = {"bash": ".bashrc", "zsh": ".zshrc", "fish": ".config/fish/config.fish"}
INSIDE = ["TMUX=/tmp/tmux-1000/default,4242,0", "STY=4242.pts-0.robot", "ZELLIJ=0"]  # of a terminal multiplexer
LITERAL = re.compile(r"""\b(ROS_\w+)(?:=|\s+)(?:"([^"$`]*)"|'([^']*)'|([\w.:/-]+)(?=[\s;})&]|$))""")


def need(shell):
    """Skip a test without the shell of its files."""
    if not shutil.which(shell):
        pytest.skip(f"{shell} is not installed: make setup installs it")


class Home:
    """The home folder of a person with these files, and what is told of the person's shells."""

    def __init__(self, shell, files):
        self.folder = tempfile.TemporaryDirectory(dir="/tmp")
        root = pathlib.Path(self.folder.name)
        for name, content in files.items():
            path = root / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(content)
        for path in [root, *root.rglob("*")]:
            os.chown(path, NOBODY.pw_uid, NOBODY.pw_gid)
            path.chmod(0o755 if path.is_dir() else 0o644)
        self.person = Person("robot", NOBODY.pw_uid, NOBODY.pw_gid, str(root), shutil.which(shell) or f"/bin/{shell}")
        self.files = {str(root / name): content.split("\n") for name, content in files.items()}

    def __enter__(self):
        return self

    def __exit__(self, *_problem):
        self.folder.cleanup()

    def tell(self):
        """Return the rows of the person, and the answers of the shells."""
        files = shells._read_as((NOBODY.pw_uid, NOBODY.pw_gid), self.person.home, "/")
        parsed = [dict(entry, file=path) for path, content in files for entry in shells.assignments(content)]
        answers = person_shells.ask(self.person, NAMES) if person_shells.can_ask(self.person) else {}
        return person_shells.list_rows(self.person, answers, parsed, {}, shells._is_ours), answers

    def export(self, inside=()):
        """Ask the interactive shell as a terminal does, without any of our code: the variables that it exports."""
        words = ["setpriv", f"--reuid={NOBODY.pw_uid}", f"--regid={NOBODY.pw_gid}", "--clear-groups", "env", "-i"]
        words += [f"HOME={self.person.home}", "PATH=/usr/bin:/bin", "TERM=dumb", "USER=robot", "LANG=C.UTF-8", *inside]
        words += ["timeout", "10", self.person.shell, "-i", "-c", "exec env -0"]
        output = subprocess.run(words, cwd=self.person.home, capture_output=True, check=False).stdout.decode(
            errors="replace"
        )
        pairs = (entry.rpartition("\n")[2].partition("=") for entry in output.split("\0"))
        return {name: value for name, _equals, value in pairs if name in NAMES}


def rows_are_true(home, rows, exported):
    """Each row of the interactive shell has the value that it exports, and a line that has the variable in it."""
    of_terminal = {row["variable"]: row for row in rows if row.get("shell") == "interactive"}
    assert {name: row["value"] for name, row in of_terminal.items()} == {
        name: person_shells._spell(value) for name, value in exported.items()
    }
    for row in of_terminal.values():
        assert not row["file"] or row["file"] in home.files
        if not row["file"]:
            continue
        line = home.files[row["file"]][row["line"] - 1]
        if row["variable"] not in line:
            assert "=" in row["text"] or row["text"].endswith("...")  # built at run time, as by eval or by a loop
        # A line that sets other values, and none that the shell alone knows, has not set this one.
        given = ["".join(values) for name, *values in LITERAL.findall(line) if name == row["variable"]]
        assert not given or row["value"] in given or re.search(r"[$`\\\r]|\+=", line), (line, row)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(CASES))
def test_a_persons_shells_are_told_as_they_are(name):
    case = CASES[name]
    if case["shell"] in MAIN:
        need(case["shell"])
    with Home(case["shell"], case["files"]) as home:
        rows, answers = home.tell()
        if case["shell"] in person_shells.FILES:
            assert answers["interactive"].values == case["values"] == home.export(INSIDE if case.get("inside") else ())
            rows_are_true(home, rows, case["values"])
        shown = " ".join(f"{row['value']} {row['text']}" for row in rows)
        assert not [word for word in case.get("hidden", ()) if word in shown]


@st.composite
def homes(draw, shell):
    """Draw the files of a person out of those of several; one of them has been in the hands of another editor."""
    cases = [case for case in CASES.values() if case["shell"] == shell]
    files = {}
    for case in draw(st.lists(st.sampled_from(cases), min_size=2, max_size=4, unique_by=id)):
        for name, content in case["files"].items():
            files[name] = files.get(name, "") + content
    name, slip = draw(st.sampled_from(sorted(files))), draw(st.sampled_from(field.SLIPS))
    files[name] = slip(files[name].encode()).decode("utf-8", "replace")
    return files


@pytest.mark.slow
@pytest.mark.parametrize("shell", sorted(MAIN))
@given(data=st.data())
@field.tries(0.12)
def test_a_mixture_of_files_is_told_as_the_shell_has_it(shell, data):
    need(shell)
    files = data.draw(homes(shell))
    with Home(shell, files) as home:
        rows, answers = home.tell()
        exported = home.export() or home.export(INSIDE)
        if "interactive" in answers:
            rows_are_true(home, rows, exported)
        else:  # a shell that ends in its files, as after `set -e`: what stands there is told
            assert not exported and {row["file"] for row in rows} >= {
                str(pathlib.Path(home.person.home, MAIN[shell]))
                for line in files.get(MAIN[shell], "").splitlines()
                if line.startswith(("export ROS_IP=", "set -gx ROS_IP "))
            }
        assert "hunter2" not in " ".join(f"{row['value']} {row['text']}" for row in rows)
