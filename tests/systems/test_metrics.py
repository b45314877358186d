# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""/diagnostics and metrics of two robots: there, true, on their robot, and gone when they are switched off."""

import re
import shutil
import subprocess

import pytest
from machines.podman import ROOT
from setups.links import wait_until

pytestmark = pytest.mark.costly

FIRST, SECOND = "kobuki1computer", "kobuki2computer"
FOLDER = "/var/lib/prometheus/node-exporter"
ON = {"multimaster_metrics": "textfile"}
UNIT = "multimaster-metrics.service"


def metrics(lab, host):
    """The lines of all files, by name and labels."""
    lines = lab.run(host, f"cat {FOLDER}/multimaster_*.prom", check=False).splitlines()
    return {name: float(value) for name, _space, value in (line.rpartition(" ") for line in lines if line[:1] != "#")}


def link(there, what="up"):
    return f'multimaster_link_{what}{{master="{there}"}}'


def listen(lab, host):
    """Listen to /diagnostics for some seconds: (time, name, level) of each entry, and the whole text."""
    text = lab.run(host, "timeout -k 5 11 rostopic echo /diagnostics; true")
    found = []
    for message in text.split("---"):
        stamp = re.search(r"secs: (\d+)\s+nsecs: +(\d+)", message)
        entries = re.findall(r'level: (\d)\s+name: "(.*?)"', message)
        found += [(int(stamp[1]) + int(stamp[2]) / 1e9, name, int(level)) for level, name in entries]
    return found, text


@pytest.fixture(scope="module")
def measured(lab):
    """Both robots with metrics, beside a file of somebody else."""
    for host in (FIRST, SECOND):
        lab.run(host, f"mkdir -p {FOLDER} && echo other 1 > {FOLDER}/other.prom")
    status, output = lab.play("site.yml", variables=ON)
    assert status == 0, output
    yield lab
    status, output = lab.play("site.yml")
    assert status == 0, output


def test_a_missing_folder_is_one_sentence_before_any_change(lab):
    status, output = lab.play("site.yml", variables={**ON, "multimaster_metrics_folder": "/srv/not-there"})
    assert (
        status != 0 and f"{FIRST}: multimaster_metrics is 'textfile', but there is no folder /srv/not-there" in output
    )
    assert lab.run(FIRST, f"systemctl show --value -p LoadState {UNIT}").strip() == "not-found"


def test_metrics_are_written_for_everybody_to_read(measured):
    lab = measured
    for here, there in ((FIRST, SECOND), (SECOND, FIRST)):
        offset = f'multimaster_clock_offset_seconds{{master="{there}"}}'
        registrations = f'multimaster_registrations{{master="{there}",kind="publisher"}}'
        wanted = {offset, registrations}
        wait_until(lambda here=here, wanted=wanted: wanted <= set(metrics(lab, here)), 60, f"all metrics of {here}")
        found = metrics(lab, here)
        assert found[link(there)] == found["multimaster_roscore_up"] == found["multimaster_masters_online"] == 1
        assert abs(found[offset]) < 0.5 and 0 < found[link(there, "answer_seconds")] < 1
        assert found[link(there, "heartbeats_ratio")] > 0.5
        assert found["multimaster_datagrams_received_total"] > 0 and found["multimaster_sent_bytes_total"] > 0
        assert found[registrations] == 0
    files = lab.run(FIRST, f"stat -c '%n %a %U' {FOLDER}/*").split()
    assert files == [
        *(f"{FOLDER}/multimaster_discovery.prom", "644", "root", f"{FOLDER}/multimaster_sync.prom", "644", "root"),
        *(f"{FOLDER}/other.prom", "644", "root"),
    ]
    promtool = shutil.which("promtool", path=f"{ROOT}/.work/bin") or shutil.which("promtool")
    for name in ("discovery", "sync") if promtool else ():
        text = lab.run(FIRST, f"cat {FOLDER}/multimaster_{name}.prom")
        done = subprocess.run([promtool, "check", "metrics"], input=text, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (0, ""), text


def test_a_second_run_changes_nothing(measured):
    status, output = measured.play("site.yml", variables=ON)
    assert status == 0 and not re.search(r"changed=[1-9]", output), output


def test_the_service_that_copies_has_one_right_and_one_folder(measured):
    lab = measured
    lines = lab.run(FIRST, f"cat /proc/$(systemctl show --value -p MainPID {UNIT})/status").splitlines()
    status = dict(line.split(":\t", 1) for line in lines if ":\t" in line)
    assert (status["NoNewPrivs"], status["Seccomp"]) == ("1", "2")
    assert int(status["CapBnd"], 16) == int(status["CapEff"], 16) == 1 << 1  # CAP_DAC_OVERRIDE
    enter = f"nsenter --mount --net --target $(systemctl show --value -p MainPID {UNIT})"
    assert lab.run(FIRST, f"{enter} touch {FOLDER}/x && rm {FOLDER}/x && {enter} touch /etc/x 2>&1; true").strip()
    assert lab.run(FIRST, f"{enter} ip -o link").count("\n") == 1


def test_the_diagnostics_say_who_is_there_and_not_too_often(measured):
    said, text = listen(measured, FIRST)
    names = {name: level for _at, name, level in said}
    assert names[f"multimaster: link to {SECOND}"] == names["multimaster: roscore"] == names["multimaster: names"] == 0
    assert set(names) == {
        *(
            f"multimaster: {name}"
            for name in "roscore masters clocks strangers names types places parameters limits".split()
        ),
        f"multimaster: link to {SECOND}",
    }
    assert f'hardware_id: "kobuki1/{FIRST}"' in text and f"kobuki2/{SECOND}" not in text, "each robot's stay there"
    for name in ("multimaster: roscore", "multimaster: names"):
        times = [at for at, found, _level in said if found == name]
        # The first one is latched: it was said at a time when nobody listened.
        pauses = [later - earlier for earlier, later in zip(times[1:], times[2:])]
        assert pauses and min(pauses) > 0.9, f"at 1 Hz at most: {times}"
        assert max(pauses) < 5, f"before an aggregator calls it stale: {times}"


def test_listeners_and_drivers_of_other_robots_stay_there(measured):
    lab = measured
    lab.start(FIRST, "panel", "rostopic echo /diagnostics")
    lab.start(FIRST, "driver", "rostopic pub -r 2 /diagnostics diagnostic_msgs/DiagnosticArray {{}}")
    lab.start(FIRST, "marker", "rostopic pub -r 2 /marker std_msgs/String here")
    wait_until(lambda: "/marker" in lab.run(SECOND, "rostopic list"), 30, "a topic that crosses")
    known = lab.run(SECOND, "rostopic info /diagnostics")
    lab.stop(FIRST, "panel", "driver", "marker")
    assert "rostopic" not in known and FIRST not in known, known


MADE = """
import sys
from diagnostic_msgs import msg
sys.path.insert(0, "/usr/local/lib/rosfleet-multimaster/python")
from rosfleet_multimaster.edge import diagnostic_classes as classes
assert classes.messages() is msg
made = classes.generate_messages()
for name in ("DiagnosticArray", "DiagnosticStatus", "KeyValue"):
    one, other = getattr(made, name), getattr(msg, name)
    assert one is not other and one._md5sum == other._md5sum and one._type == other._type, name
"""


def test_the_classes_that_are_made_are_those_of_the_package(measured):
    measured.run(FIRST, "python3 -", stdin=MADE)


def test_nodes_without_the_package_are_heard_by_who_has_it(measured):
    package, away = "/usr/lib/python3/dist-packages/diagnostic_msgs", "/usr/lib/python3/dist-packages/not_there"
    restart = "systemctl restart multimaster-discovery multimaster-sync"
    measured.run(FIRST, f"mv {package} {away} && {restart}; mv {away} {package}")
    names = {name: level for _at, name, level in listen(measured, FIRST)[0]}
    assert names["multimaster: roscore"] == names["multimaster: names"] == 0


def test_a_robot_that_leaves_is_seen_in_both(measured):
    lab = measured
    lab.run(SECOND, "systemctl stop multimaster-discovery multimaster-sync")
    wait_until(lambda: metrics(lab, FIRST).get(link(SECOND)) == 0, 60, "the metrics")
    wait_until(lambda: metrics(lab, SECOND) == {}, 30, "no old values of nodes that do not run")
    names = {name: level for _at, name, level in listen(lab, FIRST)[0]}
    assert names[f"multimaster: link to {SECOND}"] in (1, 2) and names["multimaster: masters"] == 1
    lab.run(SECOND, "systemctl start multimaster-discovery multimaster-sync")
    wait_until(lambda: metrics(lab, FIRST).get(link(SECOND)) == 1, 60, "it is back")
    assert metrics(lab, FIRST)[link(SECOND, "lost_total")] == 1


def test_switched_off_nothing_of_ours_is_left(measured):
    status, output = measured.play("site.yml", variables={"multimaster_diagnostics": "none"})
    assert status == 0, output
    for host in (FIRST, SECOND):
        assert measured.run(host, f"ls {FOLDER}").split() == ["other.prom"]
        assert measured.run(host, f"systemctl show --value -p LoadState {UNIT}").strip() == "not-found"
        assert "/master_" not in measured.run(host, "rostopic info /diagnostics 2>&1; true")


@pytest.mark.costly
def test_a_teardown_leaves_nothing_of_them_and_what_others_wrote(measured):
    assert measured.play("site.yml", variables=ON)[0] == 0
    wait_until(lambda: all(metrics(measured, host) for host in (FIRST, SECOND)), 60, "metrics of both")
    status, output = measured.play("playbooks/teardown.yml", variables=ON)
    assert status == 0, output
    for host in (FIRST, SECOND):
        assert measured.run(host, f"ls {FOLDER}").split() == ["other.prom"]
        left = measured.run(
            host, "find / -xdev -name 'multimaster*' -not -path '/proc/*' -not -path '/tmp/*' 2> /dev/null; true"
        )
        assert not left, left
        assert not measured.run(
            host, "ls -d /run/rosfleet-multimaster /var/lib/rosfleet-multimaster 2> /dev/null; true"
        )
