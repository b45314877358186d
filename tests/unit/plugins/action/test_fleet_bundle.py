# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_bundle: a file that others judge as here, without secrets, and with other names where that is asked for."""

import io
import json
import os
import random
import stat
import types
import zipfile

import fleets
import pytest
from acting import act
from ansible.playbook.task import Task
from ansible_collections.rosfleet.multimaster.plugins.action import fleet_bundle, fleet_report
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain import to_plain
from mentioned import mentions
from planted import PLANTED

pytestmark = pytest.mark.whole

SECRET = {
    "ansible_password": "open sesame",
    "vault_thing": "0xdead",
    "ansible_user": "anna",
    "ansible_host": "nuc.lab.example.org",
    # Variables that are not the collection's, and those of it.
    "door": "abracadabra",
    "site": {"street": ["our alley"], "deep": {"lock": "lock-of-the-lab"}},
    "verify_report": "report.json",
    "multimaster_address": "192.168.11.100",
}
NAMES = {"fleet": {}, "multicast": "verify_probe.multicast", "probe": "verify_probe", "machine": "multimaster_info"}


def registered(seen, logs):
    """Return what the tasks of the role would have registered."""
    info = {"os": {"name": "Debian GNU/Linux 12"}, "kernel": "6.1.0", "python": "3.11.2", "hostname": "nuc"}
    found = {**SECRET, "verify_probe": to_plain(seen.probe), "multimaster_info": info}
    if seen.multicast:
        found["verify_probe"]["multicast"] = to_plain(seen.multicast)
    return {**found, "verify_logs": {"logs": {"sync": logs}, "problems": []}}


def run(kind, seen=None, lines=(), **options):
    task = Task()
    task.action, task.async_val, task.check_mode = "rosfleet.multimaster.fleet_bundle", 0, False
    task.args = options
    connection = types.SimpleNamespace(_shell=types.SimpleNamespace(tmpdir=None))
    context = types.SimpleNamespace(password=None, become_pass="given by hand")
    hostvars = {name: registered(entry, list(lines)) for name, entry in (seen or {}).items()}
    module = kind.ActionModule(task, connection, context, None, None, None)
    return act(module, {"hostvars": hostvars, "ansible_play_hosts_all": list(hostvars), "inventory_dir": "/x"})


def bundle(fleet, path, change=None, logs=(), **options):
    seen = fleets.observed(fleet)
    if change:
        change(seen)
    names = {**NAMES, "fleet": to_plain(fleet), "logs": "verify_logs", "path": str(path), **options}
    return run(fleet_bundle, seen, logs, **names)


def texts(path):
    with zipfile.ZipFile(path) as archive:
        return {entry.filename.partition("/")[2]: archive.read(entry).decode() for entry in archive.infolist()}


@pytest.fixture(autouse=True)
def shown(monkeypatch):
    lines = []
    monkeypatch.setattr(fleet_bundle.Display, "display", lambda self, text, color=None, **_more: lines.append(text))
    return lines


def findings(result):
    return [(entry["kind"], entry["mode"], entry["verdict"], entry["follows"]) for entry in result["findings"]]


@pytest.mark.parametrize("change", [None, fleets.wall, fleets.second_default_route])
@pytest.mark.parametrize("anonymous", [False, True])
def test_it_is_judged_elsewhere_as_here(tmp_path, shown, change, anonymous):
    fleet = fleets.fig12()
    seen = fleets.observed(fleet)
    if change:
        change(seen)
    here = run(fleet_report, seen, **{**NAMES, "fleet": to_plain(fleet)})
    path = tmp_path / "bundle.zip"
    result = bundle(fleet, path, change, anonymous=anonymous)
    assert result["path"] == str(path) and "warnings" not in result and f"Bundle: {path}" in shown
    assert stat.S_IMODE(path.stat().st_mode) == 0o600 and list(tmp_path.iterdir()) == [path]
    there = run(fleet_report, bundle=str(path))
    assert findings(there) == findings(here) and there["checks"] == here["checks"] and there["msg"] == here["msg"]
    if not anonymous:
        assert there["findings"] == here["findings"]


def test_versions_and_logs_are_in_it(tmp_path):
    bundle(fleets.fig12(), tmp_path / "x.zip", logs=["tibi-nav: one", "two"])
    found = texts(tmp_path / "x.zip")
    about = json.loads(found["about.json"])
    assert {"time", "collection", "ansible", "python"} <= about.keys()
    assert (
        about["computers"]["tibi-nav"] | {"system": "Debian GNU/Linux 12", "kernel": "6.1.0", "python": "3.11.2"}
        == about["computers"]["tibi-nav"]
    )
    assert found["logs/tibi-nav.txt"] == '== sync\n"tibi-nav: one"\n"two"\n'
    assert found["report.html"].startswith("<!DOCTYPE html>") and json.loads(found["report.json"])["verdict"] == "ok"


@pytest.mark.parametrize("anonymous", [False, True])
def test_no_secret_is_in_any_file(tmp_path, monkeypatch, anonymous):
    monkeypatch.setenv("LAB_TOKEN", "fromtheenvironment")
    planted = [
        entry for entry in PLANTED if all(len(part) >= 6 and set(part) & set("0123456789") for part in entry.parts)
    ]
    lines = ["open sesame, 0xdead, given by hand, fromtheenvironment, abracadabra, our alley, lock-of-the-lab"]
    lines += [line for entry in planted for line in entry.text.splitlines()]
    bundle(fleets.fig12(), tmp_path / "x.zip", logs=lines, anonymous=anonymous)
    everything = "".join(texts(tmp_path / "x.zip").values())
    secrets = [
        "open sesame",
        "0xdead",
        "given by hand",
        "fromtheenvironment",
        "abracadabra",
        "our alley",
        "lock-of-the-lab",
    ]
    secrets += [part for entry in planted for part in entry.parts]
    assert len(secrets) > 120 and not [secret for secret in secrets if secret in everything]


def test_variables_of_the_collection_are_in_it(tmp_path):
    """The listed variables stay: the options of roles, the fleet's variables and their values."""
    assert {"verify_bundle", "verify_pairs", "firewall_backend"} <= fleet_bundle.read_options().keys()
    bundle(fleets.fig12(), tmp_path / "x.zip", logs=["waits for report.json at 192.168.11.100 by eth0"])
    assert "waits for report.json at 192.168.11.100 by eth0" in texts(tmp_path / "x.zip")["logs/tibi-nav.txt"]


def test_no_name_is_left(tmp_path):
    lines = ["tibi-nav: anna@nuc.lab.example.org, nuc, 192.168.11.100, /home/anna"]
    bundle(fleets.fig12(), tmp_path / "x.zip", logs=lines, anonymous="true")
    found = texts(tmp_path / "x.zip")
    everything = "".join(found.values())
    left = [word for word in ("tibi", "dabo-", "anna", "nuc", "192.168.1", "example.org") if word in everything]
    assert not left
    assert (
        "robot1-computer1: user1@robot" in found["logs/robot1-computer1.txt"] and "were replaced" in found["README.txt"]
    )


@pytest.mark.costly
def test_twelve_computers_are_less_than_a_megabyte(tmp_path):
    """Logs of the worst kind: each line is another one."""
    chance = random.Random(1)
    lines = ["".join(chance.choices("abcdefghijklmnopqrstuvwxyz /:.0123456789", k=200)) for _line in range(1000)]
    result = bundle(
        fleets.plan(4, 3), tmp_path / "x.zip", lambda seen: fleets.silent(seen, list(seen), ["kobuki2computer"]), lines
    )
    assert result["bytes"] == (tmp_path / "x.zip").stat().st_size < 1_000_000


def test_a_folder_gets_a_file_with_the_time(tmp_path):
    result = bundle(fleets.plan(2), f"{tmp_path}/")
    assert [result["path"]] == [str(path) for path in tmp_path.iterdir()] and "rosfleet-bundle-" in result["path"]


@pytest.mark.parametrize(
    ("path", "said"),
    [("", "The option path is empty"), ("/nowhere/x.zip", "cannot be written to /nowhere/x.zip: No such file")],
)
def test_a_file_that_cannot_be_written(path, said):
    result = bundle(fleets.plan(2), path)
    assert result["failed"] and said in result["msg"]


def test_a_name_that_changes_the_findings_is_told(tmp_path):
    """A secret that is a word of the verification: what is judged is not what was seen."""
    fleet = fleets.plan(2)
    SECRET["ansible_password"] = "active"
    try:
        assert "a name or a secret is a word" in bundle(fleet, tmp_path / "x.zip")["warnings"][0]
    finally:
        SECRET["ansible_password"] = "open sesame"


# A bundle of anybody


def rewritten(path, name, change):
    files = texts(path)
    data = json.loads(files[name])
    change(data)
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for other, text in {**files, name: json.dumps(data)}.items():
            archive.writestr(f"rosfleet-bundle/{other}", text)
    path.write_bytes(stream.getvalue())


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("plan.json", lambda plan: plan.update(computers={})),
        ("plan.json", lambda plan: plan["masters"][0].update(computer="nobody", robot="x")),
        ("plan.json", lambda plan: plan.update(masters=[])),
        ("plan.json", lambda plan: plan.update(members=[])),
        ("plan.json", lambda plan: plan.update(networks=[], router={"name": "x", "address": "1.2.3.4"})),
        ("observations.json", lambda seen: seen.clear()),
        ("observations.json", lambda seen: [entry["probe"]["members"].clear() for entry in seen.values()]),
        ("observations.json", lambda seen: [entry.update(probe={"clock": {}}) for entry in seen.values()]),
        ("about.json", lambda about: about.update(computers={"x": 3}, pairs="x", time="\x1b[2J" * 5000)),
    ],
)
def test_a_contradictory_bundle_ends_in_a_report_or_a_sentence(tmp_path, name, change):
    path = tmp_path / "x.zip"
    bundle(fleets.fig12(), path)
    rewritten(path, name, change)
    result = run(fleet_report, bundle=str(path), path=str(tmp_path / "found.json"))
    assert result.get("report") or (result["failed"] and "x.zip" in result["msg"])


@pytest.mark.parametrize("given", ["missing.zip", ".", "text.zip"])
def test_what_is_no_bundle_is_refused_in_a_sentence(tmp_path, given):
    (tmp_path / "text.zip").write_text("hello")
    result = run(fleet_report, bundle=str(tmp_path / given))
    assert result["failed"] and mentions(result["msg"], "verify_bundle", "bundle")


def test_a_pipe_keeps_nobody_waiting(tmp_path):
    os.mkfifo(tmp_path / "x.zip")
    assert "is no file" in run(fleet_report, bundle=str(tmp_path / "x.zip"))["msg"]
