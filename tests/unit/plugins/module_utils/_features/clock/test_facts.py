# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Time services of a machine: whose configuration they have, and whom they follow. Their words may be anybody's."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.commands import Answer
from ansible_collections.rosfleet.multimaster.plugins.module_utils._features.clock import facts, sources
from hypothesis import given
from hypothesis import strategies as st

STOCK = "pool 2.debian.pool.ntp.org iburst\n"
DROP_IN = "etc/systemd/system/chrony.service.d/lab.conf"
CHRONY = {"etc/chrony/chrony.conf": STOCK, "usr/share/chrony/chrony.conf": STOCK}


@pytest.fixture(name="found")
def fixture_found(tmp_path, monkeypatch):
    def look(*services, files=None):
        for name, content in (files or {}).items():
            (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / name).write_text(content)

        def states(units, _properties):
            loaded = {"LoadState": "loaded", "UnitFileState": "enabled", "ActiveState": "inactive"}
            return [loaded if unit in services else {"LoadState": "not-found"} for unit in units]

        monkeypatch.setattr(facts.systemd, "states", states)
        monkeypatch.setattr(facts, "time_sources", lambda: {"sources": []})
        return facts.clock(str(tmp_path))

    return look


@pytest.mark.parametrize(
    ("services", "files", "told"),
    [
        ((), {}, []),
        (("chrony.service",), CHRONY, []),
        (("chrony.service",), {**CHRONY, "etc/chrony/chrony.conf": "server 192.0.2.1\n"}, ["server 192.0.2.1"]),
        (("chrony.service",), {**CHRONY, "etc/chrony/chrony.conf": "# x\n"}, ["not as its package has it"]),
        (("chrony.service",), {**CHRONY, "etc/chrony/sources.d/a.sources": "server a\n"}, ["server a"]),
        (("chrony.service",), {**CHRONY, "etc/chrony/conf.d/a.conf": "# nothing\n"}, []),
        (("chrony.service",), {**CHRONY, "etc/chrony/conf.d/a.conf": "# x\nmaxslewrate 500\n"}, ["maxslewrate 500"]),
        (("chrony.service",), {**CHRONY, "etc/default/chrony": 'DAEMON_OPTS="-F 1"\n'}, []),
        (
            ("chrony.service",),
            {**CHRONY, "etc/default/chrony": 'DAEMON_OPTS="-F 1 -f /x"\n'},
            ['DAEMON_OPTS="-F 1 -f /x"'],
        ),
        (("chrony.service",), {**CHRONY, DROP_IN: "[Service]\nNice=-5\n"}, []),
        (("chrony.service",), {**CHRONY, DROP_IN: "[Service]\nExecStart=\nExecStart=/x\n"}, ["ExecStart=/x"]),
        # While chrony reads our file, its own is nobody's.
        (("chrony.service",), {**CHRONY, "etc/chrony/chrony.conf": "server a\n", facts.OURS[0][1:]: "x\n"}, []),
        (("systemd-timesyncd.service",), {"etc/systemd/timesyncd.conf": "[Time]\n#NTP=\n"}, []),
        (("systemd-timesyncd.service",), {"etc/systemd/timesyncd.conf": "[Time]\nNTP=192.0.2.1\n"}, ["NTP=192.0.2.1"]),
        ((), {"etc/systemd/timesyncd.conf": "[Time]\nNTP=192.0.2.1\n"}, []),
        (("ntpsec.service",), {"etc/ntpsec/ntp.conf": "pool a\n"}, ["pool a"]),
        (("openntpd.service",), {}, ["as its package has it"]),
    ],
)
def test_what_counts_as_somebodys_configuration(found, services, files, told):
    assert [entry["line"] for entry in found(*services, files=files)["others"]] == told


def test_our_files_without_a_running_service_want_a_start(found):
    assert not found("chrony.service", files=CHRONY)["restart_due"]
    assert found("chrony.service", files={path[1:]: "x\n" for path in facts.OURS})["restart_due"]
    assert not found()["restart_due"]


def test_who_may_set_the_clock(found):
    assert found(files={"proc/1/status": "CapBnd:\t000001ffffffffff\n"})["settable"]
    assert not found(files={"proc/1/status": "CapBnd:\t00000000a80425fb\n"})["settable"]


OUTPUTS = {
    "chronyc": "^,*,192.168.1.201,10,2,377,3,-0.000003840,-0.000005724,0.000034043\n"
    "^,?,192.168.1.9,0,6,0,4294967295,0.000000000,0.000000000,4.0\n#,-,GPS,0,4,377,11,0.1,0.1,0.2\n"
    "C0A80101,192.168.1.201,11,1795749404.1,2.000000000,-1.9,2.0,-0.58,0.021,4.255,0.00002,0.00002,4.0,Normal\n",
    "timedatectl": "ServerName=a\nServerAddress=192.168.1.201\nNTPMessage={ Leap=0, Stratum=2 }\n",
    "ntpq": "     remote  refid st t when poll reach delay offset jitter\n====\n"
    "*192.168.1.201  .GPS.  1 u   33   64  377    0.243    2.500   0.021\n"
    " 192.168.1.9    .INIT. 16 u    -   64    0    0.000    0.000   0.000\n",
}


@pytest.mark.parametrize(
    ("program", "service", "offset", "others"),
    [
        ("chronyc", "chrony", -2.00000384, ["192.168.1.9"]),
        ("timedatectl", "systemd-timesyncd", None, []),
        ("ntpq", "ntpd", 0.0025, ["192.168.1.9"]),
    ],
)
def test_whom_a_service_follows(monkeypatch, program, service, offset, others):
    def run(command):
        return Answer(0 if command[0] == program else 1, OUTPUTS[program].encode(), "")

    monkeypatch.setattr(sources, "run", run)
    found = sources.time_sources(patience=5)
    first, *rest = found["sources"]
    assert (found["answers"], found["service"]) == (True, service)
    assert first == {"address": "192.168.1.201", "selected": True, "reachable": True, "offset_s": offset}
    assert [(entry["address"], entry["selected"], entry["reachable"]) for entry in rest] == [
        (address, False, False) for address in others
    ]


def test_where_nothing_answers_nobody_is_followed(monkeypatch):
    for answer in (Answer(1, b"506 Cannot talk to daemon\n", ""), Answer(-1, b"", "no such file")):
        monkeypatch.setattr(sources, "run", lambda _command, answer=answer: answer)
        assert sources.time_sources() == {"answers": False, "service": "", "sources": []}


@given(st.text() | st.lists(st.sampled_from(["^,*", ",", "192.168.1.1", "nan", "1e99", "-", "*", "=", "\n", "377"])))
def test_any_output_gives_plain_sources(output):
    text = output if isinstance(output, str) else "".join(output)
    for service in sources.SERVICES:
        for source in sources.list_sources(service.read(text) or ()):
            assert set(source) == {"address", "selected", "reachable", "offset_s"}
            assert source["offset_s"] is None or abs(source["offset_s"]) < 1e112
