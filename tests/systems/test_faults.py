# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Injected faults on real systems: what goes wrong is named, and nothing is lost. The order of the tests is that of a day."""

import json
import re
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
from setups import adoption, manual_setup

FIRST, SECOND = "kobuki1computer", "kobuki2computer"
OURS = "ls /etc/sysctl.d /etc/rosfleet-multimaster /usr/local/lib/rosfleet-multimaster 2>/dev/null | grep -c rosfleet"


def masters(lab, host):
    """The names that list_masters returns; none while nobody offers it."""
    listed = lab.run(host, "rosservice call /master_discovery/list_masters", check=False)
    return re.findall(r"name: \"?([\w-]+)", listed)


def eventually(look, wanted, seconds=60):
    """Look until it is as wanted, for some seconds at most; returns what was last seen."""
    deadline = time.monotonic() + seconds
    while True:
        seen = look()
        if wanted(seen) or time.monotonic() > deadline:
            return seen
        time.sleep(0.3)


def test_an_address_that_the_machine_lacks_ends_its_run_early(untouched, tmp_path):
    """It costs its computer alone: tests/unit/playbooks/test_one_robot.py has the others."""
    other = tmp_path / "other.json"
    other.write_text(json.dumps({"all": {"hosts": {SECOND: {"multimaster_address": "192.168.1.240"}}}}))
    status, output = untouched.play("site.yml", "-i", str(other), "--limit", SECOND)
    assert status != 0
    assert (
        f"{SECOND}: multimaster_address is 192.168.1.240, but the machine has 192.168.1.239 on eth0; expected that address"
    ) in output
    for host in (FIRST, SECOND):
        assert untouched.run(host, OURS, check=False).strip() == "0"


def test_a_stranger_on_the_port_of_the_roscore_is_named(untouched):
    untouched.run(FIRST, "systemd-run --unit stranger python3 -m http.server 11311")
    status, output = untouched.play("site.yml", "--limit", FIRST)
    untouched.run(FIRST, "systemctl stop stranger")
    assert status != 0
    assert f"{FIRST}: TCP port 11311 is held by" in output
    assert "stranger.service" in output
    assert "set multimaster_roscore to 'existing'" in output
    assert untouched.run(FIRST, OURS, check=False).strip() == "0"


def test_a_fleet_that_site_has_not_seen_is_one_finding(untouched, tmp_path):
    report = tmp_path / "report.json"
    status, output = untouched.play("playbooks/verify.yml", variables={"verify_report": str(report)})
    assert status != 0
    findings = json.loads(report.read_text())["findings"]
    assert [(entry["kind"], entry["mode"]) for entry in findings] == [("set_up", "never")], output
    assert "site.yml has not run on any computer of this run" in output, output


@pytest.mark.costly
def test_robots_set_up_by_hand_are_adopted_and_verified(untouched, tmp_path):
    """A roscore and the bundled nodes that a person has started, as docs/understand/nodes.md says; nothing of the collection is there."""
    addresses = {FIRST: "192.168.1.229", SECOND: "192.168.1.239"}
    with manual_setup.robots(untouched, addresses, manual_setup.BUNDLED):
        folder = tmp_path / "adopted"
        status, output = adoption.adopt(untouched, folder)
        assert status == 0 and "2 robots with 2 computers; 4 comments to read" in output, output
        assert adoption.plan(untouched, folder) == adoption.plan(untouched, untouched.inventory)
        status, output = adoption.adopt(untouched, folder)
        assert status != 0 and f"{folder} is there and is not an empty folder" in output, output
        status, output = untouched.play("playbooks/verify.yml")
        assert status == 0, output
        assert "PASSED: none of" in output
        for host in addresses:
            assert f"nothing conflicts with the plan: {host}" in output
            assert f"the nodes on {host} were started by hand" in output
        assert 'UDP port 11511 and TCP port 11611: "python3 -m rosfleet_multimaster.master_discovery' in output
        status, output = untouched.module(FIRST, "multimaster_info", {"parts": ["masters"]})
        assert status == 0, output
        (seen,) = json.loads(output.partition("=>")[2])["masters"]
        (discovery,), (sync,) = seen["discovery"], seen["sync"]
        assert {entry["name"]: entry["online"] for entry in discovery["masters"]} == dict.fromkeys(addresses, True)
        assert (discovery["implementation"], discovery["group"], sync["implementation"]) == (
            "bundled",
            "224.0.0.1",
            "bundled",
        )
        assert (seen["uri"], seen["process"]["unit"]) == (f"http://{FIRST}:11311/", f"{manual_setup.ROSCORE}.service")
        untouched.run(SECOND, f"systemctl stop {manual_setup.DISCOVERY}")
        status, output = untouched.play("playbooks/verify.yml", variables={"verify_patience": 3})
        assert status != 0
        assert f"the discovery node of {SECOND} does not run" in output
        for host in addresses:  # as the comments in the adopted inventory say
            untouched.run(
                host, f"systemctl stop {manual_setup.SYNC} {manual_setup.DISCOVERY} {manual_setup.ROSCORE}", check=False
            )
        status, output = adoption.site_check(untouched, folder)
        assert status == 0 and "+net.ipv4.conf.all.arp_ignore = 3" in output, output
        assert "-192.168.1." not in output and "-net.ipv4.icmp_echo_ignore_broadcasts" not in output  # as it is by hand
    for host in addresses:
        assert untouched.run(host, OURS, check=False).strip() == "0"


def test_a_computer_that_is_down_is_named_and_spoils_nothing(untouched):
    untouched.halt(SECOND)
    status, output = untouched.play("site.yml")
    untouched.podman("start", SECOND)
    untouched.wait_until_up(SECOND)
    assert status == 4  # Ansible's for unreachable hosts
    assert re.search(rf"{FIRST} : ok=\d+ changed=\d+ unreachable=0 failed=0", output)
    assert re.search(rf"{SECOND} : ok=\d+ changed=\d+ unreachable=1", output)
    assert untouched.run(FIRST, "systemctl is-active multimaster-sync").strip() == "active"


def test_what_works_now_and_not_after_the_next_boot_is_told(lab):
    later, guard = (
        "/etc/sysctl.d/99-later.conf",
        "/etc/cloud/cloud-init.disabled /etc/rosfleet-multimaster/cloud-init.cfg",
    )
    masked = "/etc/systemd/system/multimaster-address.service"  # no process of it would end
    lab.run(FIRST, f"systemctl disable multimaster-sync; echo net.ipv4.icmp_echo_ignore_broadcasts=1 > {later}")
    lab.run(FIRST, f"tar -cPf /run/guard.tar {guard} && rm {guard}")
    lab.run(SECOND, f"cp {masked} /run/kept.service; ln -sfn /dev/null {masked}; systemctl daemon-reload")
    status, output = lab.play("playbooks/verify.yml")
    lab.run(FIRST, f"systemctl enable multimaster-sync; rm {later}; tar -xPf /run/guard.tar")
    lab.run(SECOND, f"rm {masked}; cp /run/kept.service {masked}; systemctl daemon-reload")
    assert status != 0
    for told in (
        f"multimaster-sync.service works on {FIRST} now, and does not start at the next boot",
        f"multimaster-address.service works on {SECOND} now, and does not start at the next boot",
        f"net.ipv4.icmp_echo_ignore_broadcasts is right on {FIRST} now, and not after the next boot",
        f"/etc/hosts of {FIRST} is right now, and is written anew at the next boot",
    ):
        assert told in output, output


def test_malformed_input_is_counted_and_changes_nothing(lab):
    before = eventually(lambda: masters(lab, FIRST), lambda names: len(names) == 2)
    assert sorted(before) == [FIRST, SECOND]
    lab.run(
        SECOND,
        "python3 -",
        stdin=f"""
import http.client, os, random, socket
random.seed(1)
udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
for number in range(2000):
    size = random.choice([1, 2, 3, 14, 21, 23, 24, 25, 100, 1400])
    data = random.randbytes(size)
    if size == 24:
        data = b"R" + bytes([random.choice([1, 4, 200])]) + data[2:]
    udp.sendto(data, ("{FIRST}", 11511))
bodies = [b"", b"<", b"<methodCall/>", b"\\0" * 500, b"<methodCall><methodName>os.system</methodName></methodCall>",
          b"<!DOCTYPE a [<!ENTITY b 'c'>]><methodCall><methodName>&b;</methodName></methodCall>"]
for number in range(60):
    connection = http.client.HTTPConnection("{FIRST}", 11611, timeout=5)
    try:
        connection.request("POST", "/RPC2", random.choice(bodies))
        connection.getresponse().read()
    except (OSError, http.client.HTTPException):
        pass
    connection.close()
""",
    )
    assert sorted(masters(lab, FIRST)) == [FIRST, SECOND]
    log = lab.run(FIRST, "journalctl --unit multimaster-discovery --output cat --since -30s")
    assert lab.run(FIRST, "systemctl show --property NRestarts --value multimaster-discovery").strip() == "0"
    lines = [line for line in log.splitlines() if "datagram" in line or "request" in line]
    assert 0 < len(lines) < 20, log


def test_a_node_with_the_name_of_a_local_one_is_reported(lab):
    """Without the guard, the import would end the local node (section 11 of the interface facts).

    Both are there before the robots exchange anything: a node that starts under a name that is imported already is
    beyond the guard, which roles/nodes/DESIGN.md says.
    """
    for host in (FIRST, SECOND):
        lab.run(host, "systemctl stop multimaster-sync")
    talker = "timeout -k 5 60 rostopic pub -r 5 /here{} std_msgs/Int32 1 __name:=twin"
    for host in (FIRST, SECOND):
        lab.run(host, f"systemd-run --unit twin --collect bash -lc '{talker.format(host[6])}'")
    for host in (FIRST, SECOND):
        nodes = eventually(lambda host=host: lab.run(host, "rosnode list").split(), lambda names: "/twin" in names)
        assert "/twin" in nodes
    for host in (FIRST, SECOND):
        lab.run(host, "systemctl start multimaster-sync")
    for host, other in ((FIRST, "2"), (SECOND, "1")):
        log = eventually(
            lambda host=host: lab.run(host, "journalctl --unit multimaster-sync --output cat --since -60s"),
            lambda text: "/twin" in text,
        )
        assert re.search(r"the node /twin at \S+ is refused: here it is", log), log
        assert f"/here{other}" not in lab.run(host, "rostopic list").split()
        assert lab.run(host, "systemctl is-active twin").strip() == "active"
    for host in (FIRST, SECOND):
        lab.run(host, "systemctl stop twin")


def test_a_killed_discovery_and_a_restarted_roscore_come_back(lab):
    lab.run(FIRST, "systemctl kill --signal KILL multimaster-discovery")
    names = eventually(lambda: masters(lab, FIRST), lambda names: len(names) == 2)
    assert sorted(names) == [FIRST, SECOND]
    lab.run(FIRST, "systemctl restart multimaster-roscore")
    names = eventually(lambda: masters(lab, FIRST), lambda names: len(names) == 2)
    assert sorted(names) == [FIRST, SECOND]


def test_a_service_that_cannot_start_leaves_the_previous_one(lab):
    unit = "[Service]\nExecStart={}\n[Install]\nWantedBy=multi-user.target\n"
    arguments = {"bundle": "faults", "units": [{"name": "faults.service", "content": unit.format("/bin/sleep 1000")}]}
    status, output = lab.module(FIRST, "managed_services", arguments)
    assert status == 0, output
    arguments["units"][0]["content"] = unit.format("/bin/false")
    status, output = lab.module(FIRST, "managed_services", arguments)
    assert status != 0
    assert "faults.service" in output and "The previous state is back" in output
    assert lab.run(FIRST, "systemctl is-active faults.service").strip() == "active"
    assert lab.run(FIRST, "cat /etc/systemd/system/faults.service") == unit.format("/bin/sleep 1000")
    status, output = lab.module(FIRST, "managed_services", {"bundle": "faults", "units": []})
    assert status == 0
    assert "faults" not in lab.run(
        FIRST, "systemctl list-units --all; ls /etc/systemd/system /var/lib/rosfleet-multimaster"
    )


@pytest.mark.costly
def test_a_running_fleets_environment_changes_and_changes_back(lab):
    """A change that restarts the roscore, and the nodes after it."""
    for advertised, expected in (("address", "http://192.168.1.229:11311/"), ("name", f"http://{FIRST}:11311/")):
        status, output = lab.play("site.yml", variables={"multimaster_advertise": advertised})
        assert status == 0, output
        assert expected in lab.run(FIRST, "rosservice call /master_discovery/list_masters")
        status, output = lab.play("playbooks/verify.yml", variables={"multimaster_advertise": advertised})
        assert status == 0, output


def test_shells_get_as_much_as_is_said_and_services_all(lab):
    """The services go on, whatever shells get."""
    own = ("/usr/local/lib/rosfleet-multimaster", "ROS_PACKAGE_PATH")
    before = lab.run(FIRST, "systemctl show --value -p MainPID multimaster-roscore multimaster-sync")
    for reach in ("names", "none", "all"):
        status, output = lab.play("site.yml", variables={"multimaster_shells": reach})
        assert status == 0, output
        login = lab.run(FIRST, "env -i HOME=/nonexistent bash -lc env")
        sshd = lab.run(FIRST, "sshd -T -C user=nobody,host=localhost,addr=127.0.0.1 | grep -i ^setenv || true")
        for seen in (login, sshd):
            assert (f"ROS_MASTER_URI=http://{FIRST}:11311" in seen) is (reach != "none")
            assert (f"ROS_HOSTNAME={FIRST}" in seen) is (reach != "none")
            assert [name in seen for name in own] == [reach == "all"] * 2
        assert own[0] in lab.run(FIRST, "cat /etc/rosfleet-multimaster/environment")
        status, output = lab.play("site.yml", variables={"multimaster_shells": reach})
        assert status == 0 and "changed=0" in output, output
    assert lab.run(FIRST, "systemctl show --value -p MainPID multimaster-roscore multimaster-sync") == before


def test_a_failed_change_is_repaired_by_going_back(lab):
    """The nodes cannot start with this; the run after it restarts what ran with half of the change."""
    wrong = {"multimaster_advertise": "address", "nodes_configuration": "/etc/rosfleet-multimaster/elsewhere"}
    status, output = lab.play("site.yml", variables={**wrong, "services_timeout": 15})
    assert status != 0
    status, output = lab.play("site.yml")
    assert status == 0, output
    status, output = lab.play("playbooks/verify.yml")
    assert status == 0, output


def test_a_filter_keeps_out_what_is_not_wanted(lab):
    assert lab.play("site.yml", variables={"multimaster_filters": {"sync_topics": ["/wanted/*"]}})[0] == 0
    for topic in ("wanted/one", "unwanted"):
        unit = topic.replace("/", "-")
        talker = f"timeout -k 5 60 rostopic pub -r 5 /{topic} std_msgs/Int32 1"
        lab.run(SECOND, f"systemd-run --unit {unit} --collect bash -lc '{talker}'")
    eventually(lambda: lab.run(SECOND, "rostopic list").split(), lambda topics: "/unwanted" in topics)
    topics = eventually(lambda: lab.run(FIRST, "rostopic list").split(), lambda topics: "/wanted/one" in topics)
    assert "/wanted/one" in topics and "/unwanted" not in topics
    lab.run(SECOND, "systemctl stop wanted-one unwanted")
    assert lab.play("site.yml")[0] == 0


def test_a_watch_tells_what_is_lost_and_names_the_cause(lab):
    watched = []

    def end_discovery_when_the_watch_has_begun():
        door = "test -S /run/rosfleet-multimaster/watch-*.sock && echo watched"
        watched.append(eventually(lambda: lab.run(FIRST, door, check=False), bool, seconds=300))
        lab.run(SECOND, "systemctl stop multimaster-discovery")

    with ThreadPoolExecutor(1) as pool:
        done = pool.submit(end_discovery_when_the_watch_has_begun)
        status, output = lab.play("playbooks/verify.yml", variables={"verify_watch": "2m", "verify_patience": 3})
        done.result()
    lab.run(SECOND, "systemctl start multimaster-discovery")
    assert watched == ["watched\n"]
    assert status != 0
    assert re.search(r"watched 0:\d\d of 2:00: \d+ values on 2 computers, \d+ lost now", output), output
    assert re.search(r"First loss at \d\d:\d\d:\d\d, 0:\d\d after the start", output), output
    assert f"multimaster-discovery.service on {SECOND}: inactive" in output
    assert f"the discovery node of {SECOND} does not run" in output  # the finding of the verification that follows
    assert "ls: cannot access" in lab.run(FIRST, "ls /run/rosfleet-multimaster/watch-*.sock 2>&1", check=False)
    assert len(eventually(lambda: masters(lab, FIRST), lambda names: len(names) == 2)) == 2


def test_the_prediction_names_the_place_where_packets_end(lab):
    chain = "add chain ip other c { type filter hook input priority 0; }"
    lab.run(SECOND, f"nft 'add table ip other; {chain}; add rule ip other c ip protocol icmp drop'")
    status, output = lab.play("playbooks/predict.yml")
    lab.run(SECOND, "nft delete table ip other")
    assert status == 0, output
    assert f"1. a packet filter on {SECOND} drops ping" in output
    assert "PREDICTED: 6 of 8 ways would work after site.yml." in output
    status, output = lab.play("playbooks/predict.yml")
    assert status == 0 and "PREDICTED: all of 8 ways would work after site.yml." in output, output


@pytest.mark.costly
def test_one_fork_verifies_as_well(lab):
    """Also while somebody listens to what the nodes of both robots say. That topic stays on each robot."""
    for host in (FIRST, SECOND):
        lab.start(host, "listens", "rostopic echo /diagnostics")
        lab.run(host, "until rostopic info /diagnostics | grep -q rostopic_; do sleep 0.2; done")
    status, output = lab.play("playbooks/verify.yml", "--forks", "1")
    for host in (FIRST, SECOND):
        lab.stop(host, "listens")
    assert status == 0, output


def test_the_verification_leaves_no_trace_at_the_discovery_nodes(lab):
    """Its probes go to the group and port that the nodes use."""
    since = lab.run(FIRST, "date '+%F %T'").strip()
    status, output = lab.play("playbooks/verify.yml", variables={"ansible_pipelining": False})
    assert status == 0, output
    log = lab.run(FIRST, f"journalctl --unit multimaster-discovery --output cat --since '{since}'")
    assert not log.strip(), log
    assert sorted(masters(lab, FIRST)) == [FIRST, SECOND]


def test_one_robot_alone_is_brought_up_to_date(lab):
    lab.run(FIRST, "systemctl stop multimaster-sync; sed -i '/192.168.1.239/d' /etc/hosts")
    status, output = lab.play("site.yml", "--limit", "kobuki1")
    assert status == 0
    assert lab.run(FIRST, "systemctl is-active multimaster-sync").strip() == "active"
    assert lab.run(FIRST, f"getent hosts {SECOND}").split()[0] == "192.168.1.239"
    assert f"{SECOND} :" not in output


def test_the_oldest_supported_ansible_core_agrees(lab, tmp_path):
    subprocess.run([sys.executable, "-m", "venv", tmp_path], check=True)
    pip = [tmp_path / "bin/python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    subprocess.run([*pip, "ansible-core==2.16.*"], check=True)
    status, output = lab.play("site.yml", programs=tmp_path / "bin")
    assert status == 0, output
    for host in (FIRST, SECOND):
        assert re.search(rf"{host} : ok=\d+ changed=0 unreachable=0 failed=0", output), output
    status, output = lab.play("playbooks/verify.yml", programs=tmp_path / "bin")
    assert status == 0, output


def test_a_user_with_sudo_is_enough(lab):
    for host in (FIRST, SECOND):
        lab.run(host, "echo 'operator ALL=(ALL) NOPASSWD: ALL' > /etc/sudoers.d/operator")
    status, output = lab.play("site.yml", variables={"ansible_user": "operator"})
    assert status == 0, output
    assert re.search(rf"{FIRST} : ok=\d+ changed=0", output), output
    status, output = lab.play("playbooks/verify.yml", variables={"ansible_user": "operator"})
    assert status == 0, output


def test_the_operators_computer_may_be_a_member(lab, ansible_inside):
    """Ansible on the first computer itself: there ansible_connection is local, the other robot is reached by ssh."""
    output = lab.run(
        FIRST, f"{ansible_inside} -i /tmp/fleet/inventory/single_computer -i /tmp/fleet/member.yml /tmp/fleet/site.yml"
    )
    assert re.search(rf"{FIRST} +: ok=\d+ +changed=0 +unreachable=0 +failed=0", output), output
    assert re.search(rf"{SECOND} +: ok=\d+ +changed=0 +unreachable=0 +failed=0", output), output


def test_a_file_that_its_reader_refuses_is_not_written(lab):
    path = "/etc/ssh/sshd_config.d/broken.conf"
    test = ["/bin/sh", "-c", "! /usr/sbin/sshd -t -f /dev/stdin 2>&1 | grep /dev/stdin"]
    arguments = {"bundle": "broken", "files": [{"path": path, "content": "SetEnvironment A=1\n", "validate": test}]}
    status, output = lab.module(FIRST, "managed_files", arguments)
    assert status != 0
    assert f"The content for {path} is refused by" in output
    assert "Bad configuration option: SetEnvironment" in output
    assert lab.run(FIRST, f"ls {path} /var/lib/rosfleet-multimaster/files-broken.json 2>/dev/null", check=False) == ""
