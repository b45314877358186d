# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The summary of a run: what changed on each computer, without a word of any robot."""

import random

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain_text import LINE
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._robot_io import summary
from mentioned import mentions


def ended(**concerns):
    return {
        "changed": any(any(runs) for runs in concerns.values()),
        "concerns": {name: [{"changed": one} for one in runs] for name, runs in concerns.items()},
    }


def test_a_run_without_changes_is_one_line():
    results = {"a": [{}, ended(sysctl=[False])], "b": [{"skipped": True}]}
    assert summary.summarize(results, False) == ["SUMMARY: 0 of 2 computers changed."]


def test_each_concern_is_named_once_in_the_order_of_a_run():
    results = {
        "a": [ended(sysctl=[True]), ended(managed_files=[False, True], hosts_entries=[True], sysctl=[True])],
        "b": [ended(routes=[False])],
    }
    assert summary.summarize(results, True) == [
        "SUMMARY: 1 of 2 computers would change.",
        "  a: kernel settings, /etc/hosts, files",
    ]


def restarting(units, files):
    runs = {
        "managed_services": [{"changed": True, "units": units}],
        "managed_files": [{"changed": True, "files": files}],
    }
    return {"changed": True, "concerns": runs}


def unit(name, state="restarted"):
    return {"name": f"multimaster-{name}.service", "state": state}


def written(path, state="written"):
    return {"path": path, "state": state}


def test_services_that_restart_are_told_with_the_reason():
    code = "/usr/local/lib/rosfleet-multimaster/python/rosfleet_multimaster"
    relay = restarting(
        [unit("roscore", "unchanged"), unit("relay")], [written("/etc/rosfleet-multimaster/master_relay.json")]
    )
    several = restarting(
        [
            unit("relay"),
            unit("sync"),
            unit("connections"),
            unit("address"),
            unit("discovery", "started"),
            unit("evil"),
        ],
        [
            written(f"{code}/relay/feed.py", "edited"),
            written(f"{code}/discovery/udp.py", "unchanged"),
            written("/etc/rosfleet-multimaster/master_sync.json"),
        ],
    )
    environment = restarting([unit("roscore")], [written("/etc/rosfleet-multimaster/environment")])
    assert summary.summarize({"a": [relay], "b": [several], "c": [environment]}, True)[1:] == [
        "  a: files, services; would restart multimaster-relay, since its parameters change",
        "  b: files, services; would restart multimaster-address, since its unit changes, or it ran with something old; "
        "would restart multimaster-connections, multimaster-sync, since its parameters change; "
        "would restart multimaster-relay, since its code changes",
        "  c: files, services; would restart multimaster-roscore, since the environment changes",
    ]
    (line,) = summary.summarize({"a": [relay]}, False)[1:]
    assert mentions(line, "restarted multimaster-relay")


def test_a_roscore_that_starts_knows_no_node_of_before():
    new = restarting([unit("roscore", "started"), unit("sync", "started")], [])
    (line,) = summary.summarize({"a": [new]}, False)[1:]
    assert mentions(line, "services; started the roscore", "start them again in a new login") and len(line) < LINE
    (line,) = summary.summarize({"a": [new]}, True)[1:]
    assert mentions(line, "would start the roscore")
    (line,) = summary.summarize({"a": [restarting([unit("roscore")], [])]}, False)[1:]
    assert "login" not in line  # it keeps its registrations


def test_a_failure_is_told_beside_what_changed_before():
    failed = {**ended(sysctl=[True]), "failed": True}
    failed["concerns"]["routes"] = [{"changed": True, "failed": True}]
    assert summary.summarize({"a": [failed], "b": [{"unreachable": True}]}, False) == [
        "SUMMARY: 1 of 2 computers changed, and 2 failed.",
        "  a: kernel settings, FAILED",
        "  b: FAILED",
    ]


def test_no_answer_of_a_robot_gets_a_word_in():
    draw = random.Random(26)
    values = (None, True, "PASSED", 7, ["PASSED"], {"PASSED": "PASSED"}, [{"changed": "PASSED"}], [[True]])
    words = {word for line in (*summary.CONCERNS.values(), "FAILED", "SUMMARY:") for word in line.split()}
    for _round in range(500):
        concerns = {draw.choice((*summary.CONCERNS, "PASSED")): draw.choice(values) for _number in range(3)}
        result = {
            "changed": draw.choice(values),
            "concerns": draw.choice((concerns, draw.choice(values))),
            "msg": "PASSED",
        }
        lines = summary.summarize({"a": [result]}, False)
        assert "PASSED" not in " ".join(lines) and set(" ".join(lines[1:]).replace(",", "").split()) <= words | {"a:"}


def test_who_fell_out_before_is_named_once_and_counts_as_failed():
    broken = {"failed": True}
    results = {"a": [{}, {}], "b": [{}, {**ended(routes=[True]), **broken}], "c": [ended(routes=[True])]}
    first, *lines = summary.summarize(results, False, {"a", "b"})
    assert first == "SUMMARY: 2 of 3 computers changed, and 2 failed."
    assert lines == [f"  a: {summary.REFUSED}", "  b: routes, FAILED", "  c: routes"]


def test_warnings_are_repeated_short_and_once():
    line = (
        "kobuki: ~/.bashrc, line 115 sets ROS_MASTER_URI; expected that only the collection sets it: remove the line."
    )
    event = type("Event", (), {"msg": "dabo warns: x"})()
    of_ansible = type("WarningSummary", (), {"event": event})()  # as ansible-core 2.19 registers it
    results = {"kobuki": [{"warnings": [line]}, {}], "dabo": [{"warnings": [of_ansible, line, "y" * 500]}]}
    assert summary.repeat_warnings(results) == [
        "Warnings of this run (whole above, each with what to do):",
        "  - kobuki: ~/.bashrc, line 115 sets ROS_MASTER_URI",
        "  - dabo warns: x",
        f"  - {'y' * 197}...",
    ]
    assert summary.repeat_warnings({"kobuki": [{}, {"warnings": []}]}) == []


@pytest.mark.parametrize("host", ["Host 'kobuki'", "Platform linux on host kobuki"])  # of ansible-core 2.19, and before
def test_the_python_that_ansible_found_is_no_warning_of_the_run(host):
    notice = (
        f"{host} is using the discovered Python interpreter at '/usr/bin/python3.11', but future installation of ..."
    )
    assert summary.repeat_warnings({"kobuki": [{"warnings": [notice]}]}) == []
    (_heading, line) = summary.repeat_warnings({"kobuki": [{"warnings": [notice, f"kobuki warns: {notice}"]}]})
    assert line.startswith("  - kobuki warns: ")


def test_of_many_warnings_ten_are_repeated():
    lines = summary.repeat_warnings({"kobuki": [{"warnings": [f"warning {number}" for number in range(25)]}]})
    assert len(lines) == 12 and lines[-1] == "  and 15 more"
