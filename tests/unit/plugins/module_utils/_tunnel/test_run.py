# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The tunnel under the dead-man's switch: tried by copies of its files, and written only then."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._module.problem import Problem
from ansible_collections.rosfleet.multimaster.plugins.module_utils._process.commands import Answer
from ansible_collections.rosfleet.multimaster.plugins.module_utils._tunnel import run as tunnel
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import tunnel as planned


@pytest.fixture(name="make")
def fixture_make(tmp_path, monkeypatch):
    """A run with these files; the commands are written down, and those of `wrong` fail."""
    asked, wrong = [], set()

    def answer(argv, limit=0, **_more):
        asked.append(list(argv))
        return Answer(1, b"", "RTNETLINK answers: no") if argv[0] in wrong else Answer(0, b"", "")

    monkeypatch.setattr(tunnel.commands, "run", answer)
    states = [{"ActiveState": "active"}]
    monkeypatch.setattr(tunnel.systemd, "states", lambda units, properties: states)

    def make(*names):
        files = [
            {"path": f"{tmp_path}/etc/{name}", "content": f"PreUp = nft -f {tmp_path}/etc/x.nft\n", "mode": "0600"}
            for name in names
        ]
        entries = [{**file, "owner": None, "group": None, "validate": []} for file in files]
        return tunnel.Tunnel({"files": entries, "records": str(tmp_path / "records")}, str(tmp_path / "trial"))

    make.asked, make.wrong, make.states = asked, wrong, states
    return make


def test_on_trial_the_copies_are_up_and_no_file_is_written(make, tmp_path):
    run = make("multimaster0.conf")
    assert run.runtime_changes
    run.apply_runtime()
    copy = tmp_path / "trial" / "multimaster0.conf"
    assert copy.read_text() == f"PreUp = nft -f {tmp_path}/trial/x.nft\n" and copy.stat().st_mode & 0o777 == 0o600
    assert make.asked[-1][-3:] == ["wg-quick", "up", str(copy)] and not (tmp_path / "etc").exists()


def test_what_was_confirmed_is_written_and_the_trial_is_gone(make, tmp_path):
    make("multimaster0.conf").apply_runtime()
    make("multimaster0.conf").apply()
    assert (tmp_path / "etc" / "multimaster0.conf").exists() and not (tmp_path / "trial").exists()
    assert not make("multimaster0.conf").runtime_changes


@pytest.mark.parametrize(("state", "back"), [("active", "restart"), ("inactive", "delete")])
def test_the_way_back_is_the_unit_with_its_own_files(make, state, back):
    make.states[0]["ActiveState"] = state
    first, second, last = make("multimaster0.conf").undo_commands()
    assert first[:3] == ["ip", "link", "delete"] and back in second and last[0] == "rm"


def test_without_files_the_tunnel_ends(make, tmp_path):
    make("multimaster0.conf").apply()
    make.asked.clear()
    make().apply_runtime()
    assert [argv[0] for argv in make.asked] == ["ip", "nft"] and not (tmp_path / "trial").exists()


def test_a_tunnel_that_does_not_come_up_is_a_sentence(make):
    make.wrong.add("systemd-run")
    with pytest.raises(Problem, match="does not come up .*is as it was before"):
        make("multimaster0.conf").apply_runtime()


def test_it_means_the_planned_tunnel():
    assert (tunnel.INTERFACE, tunnel.TABLE) == (planned.INTERFACE, planned.TABLE)
