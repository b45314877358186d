# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A bundle of real systems: what their services logged is in it, without the secret that one of them wrote; elsewhere it is judged as here."""

import contextlib
import json
import stat
import zipfile

SECRET = "Hunter2forTheTest"
DOOR = "abracadabra"  # the value of a variable with a name that says nothing


def plant(lab, host):
    """Let root write a password, and the value of a variable, into the log of a service."""
    lines = f"MESSAGE=login of {host} at 192.168.1.229 opened with {DOOR} and password={SECRET}\\nOBJECT_SYSTEMD_UNIT=multimaster-sync.service\\n"
    lab.run(host, f"printf '{lines}' | logger --journald && journalctl --sync")
    assert SECRET in lab.run(host, "journalctl --unit multimaster-sync.service")


def bundled(lab, path, **more):
    status, output = lab.play(
        "playbooks/verify.yml",
        variables={"verify_bundle": str(path), "verify_report": "", "lock": {"of": [DOOR]}, **more},
    )
    assert status == 0 and f"Bundle: {path}" in output and SECRET not in output, output
    assert stat.S_IMODE(path.stat().st_mode) == 0o600 and path.stat().st_size < 200_000
    with zipfile.ZipFile(path) as archive:
        return {entry.filename.partition("/")[2]: archive.read(entry).decode() for entry in archive.infolist()}


def judged(lab, path, found):
    """Judge it without the robots, as somebody else would."""
    status, output = lab.play("playbooks/report.yml", variables={"bundle": str(path), "bundle_report": str(found)})
    assert status == 0, output
    return json.loads(found.read_text())


def test_a_bundle_with_names(lab, tmp_path):
    plant(lab, "kobuki1computer")
    files = bundled(lab, tmp_path / "help.zip")
    log = files["logs/kobuki1computer.txt"]
    assert "== discovery" in log and "== roscore" in log and "password=(removed)" in log
    assert "opened with (removed) and password=(removed)" in log
    assert SECRET not in "".join(files.values()) and DOOR not in "".join(files.values())
    about = json.loads(files["about.json"])["computers"]["kobuki1computer"]
    assert (
        about["kernel"] and about["python"].startswith("3.") and about["system"].startswith("Debian") and about["ros"]
    )
    here = json.loads(files["report.json"])
    there = judged(lab, tmp_path / "help.zip", tmp_path / "found.json")
    assert there["checks"] == here["checks"] and there["findings"] == here["findings"] and here["verdict"] == "ok"


def test_a_bundle_without_names(lab, tmp_path):
    plant(lab, "kobuki1computer")
    files = bundled(lab, tmp_path / "help.zip", verify_bundle_anonymous=True)
    everything = "".join(files.values())
    left = [word for word in (SECRET, DOOR, "kobuki", "192.168.") if word in everything]
    assert not left, [line for line in everything.splitlines() if left[0] in line][:5]
    assert "login of robot1-computer1 at 10." in files["logs/robot1-computer1.txt"]
    assert judged(lab, tmp_path / "help.zip", tmp_path / "found.json")["verdict"] == "ok"


@contextlib.contextmanager
def slow(lab, host, mbit_s):
    """Slow down the packets that a computer sends, as a weak signal does."""
    lab.run(host, f"tc qdisc add dev eth0 root tbf rate {mbit_s}mbit burst 16kb latency 100ms")
    try:
        yield
    finally:
        lab.run(host, "tc qdisc del dev eth0 root")


def test_throughput_is_measured_and_a_slow_link_named(lab, tmp_path):
    wanted = {"verify_throughput": 0.3, "verify_throughput_least": 20, "verify_patience": 10}
    with slow(lab, "kobuki1computer", 8):
        here = json.loads(bundled(lab, tmp_path / "slow.zip", **wanted)["report.json"])
    speeds = {(entry["from"], entry["to"]): entry["mbit_s"] for entry in here["throughput"]}
    assert 0 < speeds["kobuki1computer", "kobuki2computer"] < 9, speeds
    assert speeds["kobuki2computer", "kobuki1computer"] > 20, speeds
    # A stranger of an earlier test in this lab is still told for a while.
    told = [(row["kind"], row["mode"], row["verdict"]) for row in here["findings"] if row["kind"] != "stranger"]
    assert told == [("link", "slow out", "warning")], here["findings"]
    there = judged(lab, tmp_path / "slow.zip", tmp_path / "found.json")
    assert there["throughput"] == here["throughput"] and there["findings"] == here["findings"]


def test_a_throughput_without_a_length_is_refused_at_the_start(lab):
    status, output = lab.play("playbooks/verify.yml", variables={"verify_throughput": 60})
    assert status != 0 and "verify_throughput is 60, expected 0, or the seconds of a stream" in output, output
    assert "Look at the machine, listen" not in output
