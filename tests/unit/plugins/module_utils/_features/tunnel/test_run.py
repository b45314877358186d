# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The tunnel under the dead-man's switch: tried by copies of its files, and written only then."""

import os
import socket

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.commands import Answer
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.problem import Problem
from ansible_collections.rosfleet.multimaster.plugins.module_utils._features.tunnel import run as tunnel
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._features.tunnel import files as planned


@pytest.fixture(name="make")
def fixture_make(tmp_path, monkeypatch):
    """A run with these files; the commands are written down, and those of `wrong` fail."""
    asked, wrong = [], set()

    def answer(argv, limit=0, **_more):
        asked.append(list(argv))
        if argv == ["wg", "pubkey"]:
            return Answer(0, b"public-of-" + _more["given"], "")
        if wrong & {argv[0], argv[-1]}:
            return Answer(1, b"", "RTNETLINK answers: no")
        return Answer(0, b"", "")

    monkeypatch.setattr(tunnel.commands, "run", answer)
    monkeypatch.setattr(tunnel, "FOLDER", str(tmp_path / "trial"))
    monkeypatch.setattr(tunnel.key, "KEY", str(tmp_path / "x.key"))
    states = [{"ActiveState": "active"}]
    monkeypatch.setattr(tunnel.systemd, "states", lambda units, properties: states)

    def make(*names, confirms=False, more=""):
        text = f"# {tmp_path}/etc/x\n{more}"
        files = [{"path": f"{tmp_path}/etc/{name}", "content": text, "mode": "0600"} for name in names]
        entries = [{**file, "owner": None, "group": None, "validate": []} for file in files]
        options = {"files": entries, "records": str(tmp_path / "records")}
        return tunnel.TunnelRun(options, confirms)

    make.asked, make.wrong, make.states = asked, wrong, states
    return make


def test_on_trial_the_copies_are_up_and_no_file_is_written(make, tmp_path):
    run = make("multimaster0.conf")
    assert run.runtime_changes
    run.apply_runtime()
    copy = tmp_path / "trial" / "multimaster0.conf"
    assert copy.read_text() == f"# {tmp_path}/trial/x\n" and copy.stat().st_mode & 0o777 == 0o600
    assert make.asked[-1][-3:] == ["wg-quick", "up", str(copy)] and not (tmp_path / "etc").exists()


def test_what_was_confirmed_is_written_and_the_trial_is_gone(make, tmp_path):
    make("multimaster0.conf").apply_runtime()
    make("multimaster0.conf", confirms=True).apply()
    assert (tmp_path / "etc" / "multimaster0.conf").exists() and not (tmp_path / "trial").exists()
    assert not make("multimaster0.conf").runtime_changes


def test_a_new_key_is_in_use_only_when_it_was_confirmed(make, tmp_path):
    used, waits = tmp_path / "x.key", tmp_path / "x.key.next"
    used.write_text("one")
    waits.write_text("two")
    conf = tmp_path / "trial" / "multimaster0.conf"
    other, new = (f"# PublicKey = {public}\nPostUp = key {used}\n" for public in ("public-of-one", "public-of-two"))
    make("multimaster0.conf", more=other).apply_runtime()
    assert f"key {used}\n" in conf.read_text()
    make("multimaster0.conf", more=new).apply_runtime()
    assert f"key {waits}\n" in conf.read_text() and used.read_text() == "one"
    make("multimaster0.conf", more=new, confirms=True).apply()
    assert used.read_text() == "two" and not waits.exists()
    assert f"key {used}\n" in (tmp_path / "etc" / "multimaster0.conf").read_text()


@pytest.mark.parametrize(("state", "back"), [("active", ["restart"]), ("inactive", [])])
def test_the_way_back_is_the_unit_with_its_own_files(make, state, back):
    make.states[0]["ActiveState"] = state
    first, *between, last = make("multimaster0.conf").undo_steps()
    assert first[:3] == ["ip", "link", "delete"] and last[0] == "rm" and [words[1] for words in between] == back


def test_a_run_that_ended_before_it_took_the_key_is_completed(make, tmp_path):
    """The files are as planned, and the key still waits: without it the tunnel would not start."""
    waits, more = tmp_path / "x.key.next", {"more": "# PublicKey = public-of-two\n"}
    make("multimaster0.conf", **more).apply()
    waits.write_text("two")
    assert make("multimaster0.conf", **more).runtime_changes
    make("multimaster0.conf", **more).apply()
    assert (tmp_path / "x.key").read_text() == "two" and not waits.exists()
    assert not make("multimaster0.conf", **more).changed


def test_a_tunnel_that_cannot_be_made_again_is_a_sentence(make):
    make("multimaster0.conf").apply()
    make.wrong.update(("ip", "systemctl"))
    with pytest.raises(Problem, match="cannot be started again: look at systemctl status"):
        make("multimaster0.conf").apply()


def test_without_files_the_tunnel_ends(make, tmp_path):
    make("multimaster0.conf").apply()
    make.asked.clear()
    make().apply_runtime()
    assert [argv[0] for argv in make.asked] == ["ip"] and not (tmp_path / "trial").exists()


def test_the_end_of_a_tunnel_ends_all_of_it(make, tmp_path):
    """Also without a switch: the unit cannot end it when its files are gone. All keys go with it, as they are."""
    make("multimaster0.conf").apply()
    for name in ("x.key", "x.key.next", "x.key.rosfleet-new-7"):
        (tmp_path / name).write_text("private\n")
    make.asked.clear()
    make(confirms=True).apply()
    assert [argv[:3] for argv in make.asked] == [["ip", "link", "delete"]]
    assert not list(tmp_path.glob("x.key*")) and not make().changed


def test_an_interface_that_somebody_has_removed_is_made_again(make):
    make("multimaster0.conf").apply()
    assert not make("multimaster0.conf").changed
    make.wrong.add("ip")
    run = make("multimaster0.conf")
    assert run.changed and run.runtime_changes
    make.asked.clear()
    run.apply()
    assert ["systemctl", "restart", "multimaster-tunnel.service"] in make.asked
    make.states[0]["ActiveState"] = "inactive"
    assert not make("multimaster0.conf").changed  # its service is started anyway


def test_a_tunnel_that_does_not_come_up_is_a_sentence(make):
    make.wrong.add("systemd-run")
    with pytest.raises(Problem, match="does not come up .*is as it was before"):
        make("multimaster0.conf").apply_runtime()


def test_who_has_the_port_of_the_tunnel_is_named(make):
    make.wrong.add("systemd-run")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("", 0))
        port = taken.getsockname()[1]
        with pytest.raises(Problem, match=rf"UDP port {port} is held by .*\(pid {os.getpid()}\); stop that one, or"):
            make("multimaster0.conf", more=f"ListenPort = {port}\n").apply_runtime()


def test_it_means_the_planned_tunnel():
    assert tunnel.INTERFACE == planned.INTERFACE
