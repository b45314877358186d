# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""`make lab-down` takes an image only when no other checkout and no container uses it.

Checkouts, images and containers come and go in an order that is drawn from a seed. Podman is real, with a storage of its own;
the archives are tiny, so that no image is built.
"""

import json
import os
import random
import shutil
import subprocess
import sys
import tarfile

import pytest
from machines.podman import ROOT, configuration

STEPS = 24
CHECKOUTS = ("one", "two", "three")
KINDS = ("robot", "full")
LOOK = """
import json
from machines import image, podman
kinds = [image.Image("bookworm", full) for full in (False, True)]
print(json.dumps([podman.CHECKOUT, [[kind.name, str(kind.archive)] for kind in kinds]]))
"""


class World:
    """Checkouts with an account of podman's, and what is expected of it."""

    def __init__(self, folder):
        self.folder = folder
        self.names = {}  # checkout -> kinds that it uses
        self.marks = {}  # checkout -> the end of its names
        self.images = {}  # kind -> name, archive
        self.deleted = set()
        self.containers = {}  # name -> kind
        (folder / "storage.conf").write_text(
            f'[storage]\ndriver = "vfs"\ngraphroot = "{folder}/graph"\nrunroot = "{folder}/run"\n'
        )
        (folder / "containers.conf").write_text(configuration())
        self.environment = {
            **os.environ,
            "CONTAINERS_CONF": str(folder / "containers.conf"),
            "CONTAINERS_STORAGE_CONF": str(folder / "storage.conf"),
            "XDG_CACHE_HOME": str(folder / "cache"),
        }

    def run(self, *words):
        done = subprocess.run(words, env=self.environment, capture_output=True, text=True, check=False, timeout=120)
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout

    def checkout(self, name):
        """A checkout, also one that was deleted, with the paths of its archives."""
        if not (self.folder / name).exists():
            shutil.copytree(ROOT / "lab", self.folder / name / "lab")
            self.deleted.discard(name)
        found = self.run("env", f"PYTHONPATH={self.folder / name}/lab", sys.executable, "-c", LOOK)
        mark, images = json.loads(found)
        self.marks[name] = f"-{mark}"
        self.images = dict(zip(KINDS, images, strict=True))

    def lab(self, name, *words):
        return self.run(sys.executable, self.folder / name / "lab" / "lab.py", *words)

    # What is done

    def use(self, name, kind):
        """A lab of a checkout comes up: its images are there."""
        self.checkout(name)
        wanted = KINDS[: KINDS.index(kind) + 1]  # an image comes with its base
        for one in wanted:
            self.archived(one)
        self.lab(name, "image", *(["--full"] if kind == "full" else []))
        self.names.setdefault(name, set()).update(wanted)

    def archived(self, kind):
        """Stand in for the tool that builds an archive."""
        path = self.folder / self.images[kind][1]
        if kind not in self.present():
            path.parent.mkdir(parents=True, exist_ok=True)
            (self.folder / kind).write_text(kind)
            with tarfile.open(self.folder / "archive.tar", "w") as archive:
                archive.add(self.folder / kind, arcname="etc/hostname")
            self.run("zstd", "--quiet", "--force", str(self.folder / "archive.tar"), "-o", str(path))

    def down(self, name):
        """`make lab-down` in a checkout."""
        self.checkout(name)
        self.lab(name, "down", "--all")
        leaving = {name, *self.deleted}
        for kind in KINDS:
            owners = {owner for owner, kinds in self.names.items() if kind in kinds}
            gone = owners & leaving
            if gone == owners and gone and kind in self.containers.values():
                gone -= {self.named(kind)}  # podman does not give the last name away
            for owner in gone:
                self.names[owner].discard(kind)

    def named(self, kind):
        """The checkout that has the only name that an image has left."""
        (tag,) = [tag for tag in self.tags() if self.images[kind][0] in tag]
        (owner,) = [owner for owner in self.names if tag.endswith(self.marks[owner])]
        return owner

    def delete(self, name):
        """A person removes the folder of a checkout."""
        shutil.rmtree(self.folder / name, ignore_errors=True)
        self.deleted.add(name)

    def hold(self, kind):
        """A person makes a container of an image."""
        name = f"held-{len(self.containers)}"
        tag = next(tag for tag in self.tags() if self.images[kind][0] in tag)
        self.run("podman", "create", "--network=none", f"--name={name}", tag, "true")
        self.containers[name] = kind

    def release(self):
        name, _kind = self.containers.popitem()
        self.run("podman", "rm", name)

    # What is there

    def tags(self):
        return self.run("podman", "images", "--format", "{{.Repository}}:{{.Tag}}").split()

    def present(self):
        """The kinds that any checkout is to find."""
        return set().union(*self.names.values())

    def check(self):
        tags = self.tags()
        there = {kind for kind, (name, _archive) in self.images.items() if any(name in tag for tag in tags)}
        archived = {kind for kind, (_name, archive) in self.images.items() if (self.folder / archive).exists()}
        assert there == archived == self.present()
        for owner, kinds in self.names.items():
            assert {
                kind for kind in KINDS if any(self.images[kind][0] + self.marks[owner] in tag for tag in tags)
            } == kinds


@pytest.fixture
def world(tmp_path):
    found = World(tmp_path)
    yield found
    for words in (("rm", "--all", "--force"), ("rmi", "--all", "--force")):
        subprocess.run(["podman", *words], env=found.environment, capture_output=True, check=False)


def go(world, ways):
    """Do one thing after the other, and look after each; return what was done."""
    done = []
    for way in ways:
        done.append(" ".join(way))
        try:
            getattr(world, way[0])(*way[1:])
            world.check()
        except AssertionError as problem:
            raise AssertionError(f"after {', '.join(done)}: {problem}") from problem
    return done


def drawn(world, draw):
    """Draw what is possible next, again and again."""
    for _step in range(STEPS):
        ways = [("use", draw.choice(CHECKOUTS), draw.choice(KINDS))] * 4
        ways += [("down", draw.choice(CHECKOUTS))] * 3
        ways += [("delete", name) for name in sorted(set(world.names) - world.deleted)][:1]
        ways += [("hold", draw.choice(sorted(world.present())))] if world.present() else []
        ways += [("release",)] if world.containers else []
        yield draw.choice(ways)


@pytest.mark.parametrize("seed", range(2))
def test_an_image_goes_with_its_last_user(world, seed):
    done = go(world, drawn(world, random.Random(seed)))
    assert {way.split()[0] for way in done} >= {"use", "down", "delete", "hold"}


def test_a_deleted_checkouts_image_goes_after_its_container(world):
    go(world, [("use", "one", "robot"), ("hold", "robot"), ("delete", "one"), ("down", "two")])
    assert world.present() == {"robot"}
    go(world, [("release",), ("down", "two")])
    assert not world.present()
