# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""One time for the fleet, by chrony on real systems.

Containers have the clock of their machine, which nobody here touches: chronyd runs as it does there (-x). It follows, answers and
measures, and sets nothing. An offset is one that its configuration adds to what it measures.
"""

import re

import pytest
from machines.podman import ROOT
from setups.links import wait_until

INVENTORY = ROOT / "tests" / "systems" / "time_source"
ANA, BOB, CID = HOSTS = ("ana-pc", "bob-pc", "cid-pc")
SOURCE, OTHER = "192.168.27.21", "192.168.27.23"
CONFIGURATION = "/etc/chrony/rosfleet-multimaster.conf"
# A person's: another file than the package's, and a unit that runs it in a container.
PERSON = f"""
printf 'server {SOURCE} iburst minpoll 2\\nallow 192.168.27.0/24\\n' > /etc/chrony/chrony.conf
mkdir -p /etc/systemd/system/chrony.service.d
printf '[Unit]\\nConditionCapability=\\n[Service]\\nEnvironmentFile=\\nEnvironment="DAEMON_OPTS=-F 1 -x"\\n' \\
    > /etc/systemd/system/chrony.service.d/person.conf
systemctl daemon-reload
"""
STATE = "ls /etc/chrony /etc/systemd/system/chrony.service.d 2>/dev/null; cat /etc/chrony/chrony.conf; systemctl is-active chrony"


@pytest.fixture(scope="module")
def fleet(new_lab):
    """The robots after site.yml, what it said, and how the computers were before."""
    with new_lab("systems-time-source", INVENTORY) as lab:
        lab.run(CID, f"{PERSON} systemctl restart chrony")
        before = {host: lab.run(host, STATE, check=False) for host in HOSTS}
        status, output = lab.play("site.yml")
        assert status == 0, output
        yield lab, output, before


@pytest.fixture(name="lab")
def fixture_lab(fleet):
    return fleet[0]


def follows(lab, host):
    """The addresses that a computer follows."""
    lines = lab.run(host, "chronyc -n -c sources").splitlines()
    return [row[2] for row in (line.split(",") for line in lines) if row[1] == "*"]


def misses(lab, host):
    """Return True if the last four requests of a computer had no answer: they are the lowest bits of `reach`."""
    (row,) = (line.split(",") for line in lab.run(host, "chronyc -n -c sources").splitlines())
    return not int(row[5], 8) & 15


def changed(output):
    """Read the recap: the number of changes by computer."""
    return {host: int(number) for host, number in re.findall(r"(\S+-pc)\s+: ok=\d+\s+changed=(\d+)", output)}


def verify(lab):
    return lab.play("playbooks/verify.yml")


def assert_finding(lab, sentence):
    """The verification names this first, and nothing besides."""
    status, output = verify(lab)
    assert status != 0 and f"Findings: 1. {sentence}" in output, output
    assert " 2. " not in output.partition("Findings:")[2].partition("FAILED:")[0], output


def repair(lab):
    status, output = lab.play("site.yml")
    assert status == 0, output
    return changed(output)


def test_others_follow_the_source_and_nobody_else(fleet):
    lab, output, _before = fleet
    assert follows(lab, BOB) == [SOURCE]
    assert "bob-pc: systemd may not set the clock, as in some containers" in output
    assert "Not synchronised" not in lab.run(ANA, "chronyc tracking")  # without any source of its own
    for host in (ANA, BOB):
        assert "chrony.service" in lab.run(host, "systemctl show -P After multimaster-roscore")


def test_a_configuration_of_somebody_stays_and_is_judged(fleet):
    lab, output, before = fleet
    assert "cid-pc: chrony.service has a configuration of its own" in output, output
    assert lab.run(CID, STATE, check=False) == before[CID]
    wait_until(lambda: follows(lab, CID) == [SOURCE], 60, "cid-pc follows")  # it was there before the source was
    status, output = verify(lab)
    assert status == 0 and "PASSED" in output, output


def test_a_second_run_changes_nothing(lab):
    assert repair(lab) == dict.fromkeys(HOSTS, 0)


def test_check_mode_tells_and_does_nothing(lab):
    status, output = lab.play("site.yml", "--check", "--diff", variables={"multimaster_clock": "bob"})
    assert status == 0 and "+local stratum 10" in output and f"-server {SOURCE} " in output, output
    assert follows(lab, BOB) == [SOURCE] and repair(lab) == dict.fromkeys(HOSTS, 0)


def test_a_wrong_source_is_named(lab):
    lab.run(BOB, f"sed -i 's/{SOURCE}/{OTHER}/' {CONFIGURATION} && systemctl restart chrony")
    wait_until(lambda: follows(lab, BOB) == [OTHER], 30, "bob-pc follows cid-pc")
    assert_finding(lab, f"the clock of bob-pc follows {OTHER}, not the source of the fleet's time")
    assert repair(lab) == {ANA: 0, BOB: 1, CID: 0}
    assert follows(lab, BOB) == [SOURCE]


def test_a_service_that_does_not_run_is_named(lab):
    lab.run(BOB, "systemctl stop chrony")
    assert_finding(lab, "no time service of bob-pc answers")
    assert repair(lab) == {ANA: 0, BOB: 1, CID: 0}


def test_a_source_that_does_not_run_is_the_one_finding(lab):
    lab.run(ANA, "systemctl stop chrony")
    assert_finding(lab, "no time service of ana-pc answers")
    assert repair(lab) == {ANA: 1, BOB: 0, CID: 0}


def test_a_source_that_gives_nothing_is_named(lab):
    lab.run(
        ANA, "nft 'table inet fault { chain one { type filter hook input priority filter; udp dport 123 drop; }; }'"
    )
    for host in (BOB, CID):
        wait_until(lambda host=host: misses(lab, host), 120, f"{host} gets no answer")
    try:
        assert_finding(lab, "ana-pc, the source of the fleet's time, gives it to nobody")
    finally:
        lab.run(ANA, "nft delete table inet fault")
    for host in (BOB, CID):
        wait_until(lambda host=host: not misses(lab, host), 120, f"{host} gets answers again")
        wait_until(lambda host=host: follows(lab, host) == [SOURCE], 60, f"{host} follows again")


def test_an_offset_is_named(lab):
    lab.run(BOB, f"sed -i 's/^server .*/& offset 2/' {CONFIGURATION} && systemctl restart chrony")
    wait_until(lambda: follows(lab, BOB) == [SOURCE], 30, "bob-pc follows")
    assert_finding(lab, "the clock of bob-pc is 2.0 s ")
    assert repair(lab) == {ANA: 0, BOB: 1, CID: 0}


def test_a_reboot_brings_the_same(lab):
    lab.reboot(BOB)
    lab.wait_until_up(BOB)
    wait_until(lambda: follows(lab, BOB) == [SOURCE], 60, "bob-pc follows after the boot")
    times = lab.run(BOB, "systemctl show -P ActiveEnterTimestampMonotonic chrony multimaster-roscore").split()
    assert int(times[0]) < int(times[1])


def test_a_name_of_nobody_is_one_sentence(lab):
    status, output = lab.play("site.yml", variables={"multimaster_clock": "anna"})
    assert (
        status != 0
        and "multimaster_clock is 'anna', but there is no such computer and no such robot (did you mean ana?)" in output
    )


def test_teardown_brings_back_what_was_there(fleet):
    lab, _output, before = fleet
    status, output = lab.play("playbooks/teardown.yml")
    assert status == 0, output
    assert {host: lab.run(host, STATE, check=False) for host in HOSTS} == before
