# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The collection as a stranger installs it, with each version of ansible-core on each Python. About a minute for each pair.

The stranger is the user nobody in an empty folder, and has a virtual environment of their own. The collection comes from
the built archive, and from a repository of git. No server of Galaxy is there. Nothing of it connects to a computer.
"""

import json
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

import pytest

from tools import package

ROOT = Path(__file__).resolve().parents[2]
NOBODY = 65534
NEWEST = "newest"
#: versions of ansible-core, and the Pythons that each supports on a controller
CONTROLLERS = {
    "2.16": ("3.10", "3.11", "3.12"),
    "2.18": ("3.11", "3.12", "3.13"),
    "2.19": ("3.11", "3.12", "3.13"),
    NEWEST: ("3.12", "3.13"),
}
NAME = "rosfleet.multimaster"
PLAYBOOKS = ("site", "verify", "teardown", "predict", "adopt", "report", "router_config")
PLAN = [
    {
        "name": "Compute the plan",
        "hosts": "robots",
        "gather_facts": False,
        "tasks": [
            {f"{NAME}.fleet_plan": {}, "register": "plan", "run_once": True},
            {
                "ansible.builtin.debug": {"msg": "masters: {{ plan.masters | map(attribute='uri') | join(' ') }}"},
                "run_once": True,
            },
        ],
    }
]
MASTERS = "masters: http://kobuki1computer:11311/ http://kobuki2computer:11311/"

pytestmark = pytest.mark.skipif(os.geteuid() != 0, reason="only root can become another user")


def find_python(version):
    """The interpreter of a version, of pyenv or of the system; None if this machine has none."""
    pyenv = Path(os.environ.get("PYENV_ROOT") or Path.home() / ".pyenv") / "versions"
    found = sorted(pyenv.glob(f"{version}.*/bin/python{version}"))
    system = shutil.which(f"python{version}", path="/usr/local/bin:/usr/bin")
    return found[-1] if found else Path(system) if system else None


def list_complaints(said):
    """The lines of an output that complain, but for those of ansible-core 2.21 about a collection of its own."""
    lines = [line for line in said.splitlines() if any(word in line for word in ("ERROR", "WARNING", "DEPRECATION"))]
    return [line for line in lines if "_protomatter" not in line]


class Stranger:
    """A user with a home of their own, who runs commands in a new terminal each time."""

    def __init__(self, home):
        self.home = home
        self.libraries = {}
        home.mkdir()
        os.chown(home, NOBODY, NOBODY)

    def run(self, *words, cwd=None):
        """Run a command; returns its output. It has nothing of the environment of this test but the way to PyPI."""
        variables = {
            "HOME": str(self.home),
            "PATH": f"{self.home}/rosfleet/bin:/usr/local/bin:/usr/bin:/bin",
            "LC_ALL": "C.UTF-8",
            "ANSIBLE_GALAXY_SERVER": "http://127.0.0.1:9",  # nobody answers there
            "GIT_CONFIG_NOSYSTEM": "1",
            **self.libraries,
            **{name: value for name, value in os.environ.items() if name.startswith("PIP_")},
        }
        done = subprocess.run(
            [str(word) for word in words],
            cwd=cwd or self.home,
            env=variables,
            user=NOBODY,
            group=NOBODY,
            extra_groups=[],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=600,
            check=False,
        )
        assert done.returncode == 0, f"{' '.join(map(str, words))}: {done.stdout}{done.stderr}"
        return done.stdout + done.stderr

    def take_python(self, python):
        """The interpreter as this user can run it: a copy, if it lies where only root may look."""
        if all(path.stat().st_mode & 0o001 for path in python.resolve().parents):
            return python
        prefix, version = python.resolve().parents[1], python.name
        copy = self.home / "python"
        (copy / "bin").mkdir(parents=True)
        shutil.copy2(python.resolve(), copy / "bin" / version)
        ignored = shutil.ignore_patterns("test", "site-packages", "__pycache__", "config-*", "idlelib")
        shutil.copytree(prefix / "lib" / version, copy / "lib" / version, ignore=ignored)
        for library in (prefix / "lib").glob("libpython*.so*"):
            shutil.copy2(library, copy / "lib")
        self.libraries = {"LD_LIBRARY_PATH": str(copy / "lib")}
        return copy / "bin" / version


@pytest.fixture(scope="module")
def place():
    """A folder that every user may read."""
    with tempfile.TemporaryDirectory(dir="/var/tmp") as folder:
        os.chmod(folder, 0o755)
        yield Path(folder)


@pytest.fixture(scope="module")
def sources(place):
    """The names of the collection for ansible-galaxy: the built archive, and a repository of that user."""
    repository = place / "repository"
    subprocess.run(["git", "clone", "--quiet", "--depth=1", f"file://{ROOT}", repository], check=True)
    tree = place / "tree"
    package.copy_tree(tree)
    archive = package.build(tree, place)
    for path in (archive, repository, *repository.rglob("*")):
        os.chown(path, NOBODY, NOBODY, follow_symlinks=False)
    return {"archive": str(archive), "git": f"git+file://{repository}"}


@pytest.fixture(
    scope="module", params=[(line, python) for line, pythons in CONTROLLERS.items() for python in pythons], ids="-".join
)
def stranger(request, place):
    """A user who has installed a version of ansible-core on a Python."""
    line, version = request.param
    python = find_python(version)
    if python is None:
        pytest.skip(f"there is no Python {version} here")
    found = Stranger(place / f"home-{line}-{version}")
    found.run(found.take_python(python), "-m", "venv", "rosfleet")
    wanted = "ansible-core" if line == NEWEST else f"ansible-core=={line}.*"
    found.run("pip", "install", "--quiet", "--disable-pip-version-check", "--no-cache-dir", wanted)
    said = found.run("ansible", "--version").split("]")[0] + "]"
    print(f"\n{said}, Python {version}")
    assert line == NEWEST or f"core {line}." in said
    yield found
    shutil.rmtree(found.home)


@pytest.mark.parametrize("source", ["archive", "git"])
def test_a_stranger_installs_it_and_computes_a_plan(stranger, sources, source):
    collections = stranger.home / ".ansible" / "collections" / "ansible_collections"
    shutil.rmtree(collections, ignore_errors=True)
    said = stranger.run("ansible-galaxy", "collection", "install", sources[source])
    assert f"{NAME}:" in said and "was installed successfully" in said and not list_complaints(said), said
    folder = collections / "rosfleet" / "multimaster"
    assert json.loads((folder / "MANIFEST.json").read_text())["collection_info"]["name"] == "multimaster"

    fleet = stranger.home / f"fleet-{source}"
    stranger.run("cp", "-r", folder / "inventory" / "single_computer", fleet)
    elsewhere = stranger.home / f"elsewhere-{source}"
    stranger.run("mkdir", elsewhere)
    for kind, name in (
        ("module", "multimaster_verify"),
        ("filter", "service_units"),
        ("lookup", "file_tree"),
        ("role", "computer"),
    ):
        said = stranger.run("ansible-doc", "-t", kind, f"{NAME}.{name}", cwd=elsewhere)
        assert name in said and not list_complaints(said), said
    playbooks = [f"{NAME}.{name}" for name in PLAYBOOKS]
    said = stranger.run("ansible-playbook", "--syntax-check", "-i", fleet, *playbooks, cwd=elsewhere)
    assert said.count("playbook: ") == len(playbooks) and not list_complaints(said), said
    (elsewhere / "plan.yml").write_text(json.dumps(PLAN))
    said = stranger.run("ansible-playbook", "-i", fleet, "plan.yml", cwd=elsewhere)
    assert MASTERS in said and "failed=0" in said and not list_complaints(said), said
