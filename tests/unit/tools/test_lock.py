# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The packages for development: each asked for is locked, each locked has hashes, and none says where it comes from."""

import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
LOCK = (ROOT / "requirements-dev.txt").read_text()
PINNED = re.compile(r"^([A-Za-z0-9._-]+)==(\S+)", re.MULTILINE)


def pins(text):
    return {name.lower().replace("_", "-"): version for name, version in PINNED.findall(text)}


def test_every_package_that_is_asked_for_is_locked_in_that_version():
    asked, locked = pins((ROOT / "requirements-dev.in").read_text()), pins(LOCK)
    assert asked and not {name: version for name, version in asked.items() if locked.get(name) != version}, "make lock"


def test_every_locked_package_has_hashes_and_no_line_names_a_place():
    packages = [block for block in re.split(r"\n(?=\S)", LOCK) if not block.startswith("#")]
    assert len(packages) > 50
    assert not [block for block in packages if not re.search(r" --hash=sha256:[0-9a-f]{64}", block)]
    assert not re.findall(r"(?i)://|--index|--find-links|--extra|@ ", LOCK)


def test_setup_installs_nothing_without_its_hash():
    assert "--require-hashes --requirement requirements-dev.txt" in (ROOT / "tools/setup.sh").read_text()
