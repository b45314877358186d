# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Seeded mistakes that only a machine shows: site.yml tells each by its sentence, and has changed nothing then.

What may be wanted, as a packet filter of one's own, is a warning of the prediction: `site.yml --check` shows it. About two minutes.
"""

import json
from pathlib import Path

import pytest
import seeded
from subject import lab_of

ROOT = Path(__file__).resolve().parents[2]

MISTAKES = [mistake for mistake in seeded.load() if mistake.told in (seeded.MACHINE, seeded.PREDICTION)]
OURS = "ls -d /etc/rosfleet-multimaster /var/lib/rosfleet-multimaster /usr/local/lib/rosfleet-multimaster 2> /dev/null; true"


@pytest.fixture(scope="module")
def lab():
    """The two robots of Fig. 5, before site.yml."""
    with lab_of("long-seeded", ROOT / "inventory" / "single_computer") as found:
        yield found


@pytest.mark.parametrize("mistake", [pytest.param(mistake, id=mistake.name) for mistake in MISTAKES])
def test_a_mistake_is_told_before_a_robot_is_touched(lab, tmp_path, mistake):
    lab.inventory = tmp_path / "hosts.json"
    lab.inventory.write_text(json.dumps(mistake.inventory()))
    for host, command in mistake.inject.items():
        lab.run(host, command)
    try:
        status, output = lab.play("site.yml", *(["--check"] if mistake.told == seeded.PREDICTION else []))
    finally:
        for host, command in mistake.undo.items():
            lab.run(host, command)
    assert (status == 0) == (mistake.told == seeded.PREDICTION), output
    for words in mistake.words:
        assert words in output
    assert [lab.run(host, OURS) for host in mistake.variables()] == ["", ""]


def test_without_a_mistake_site_has_nothing_to_tell(lab, tmp_path):
    lab.inventory = tmp_path / "hosts.json"
    lab.inventory.write_text(json.dumps(seeded.Mistake("none", "", "single_computer", seeded.PLAN, ()).inventory()))
    status, output = lab.play("site.yml", "--check")
    assert status == 0, output
