# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""One robot that lies, is broken or has odd facts costs itself its run: each playbook, by ansible-playbook itself, goes on with the others."""

import copy
import json
import pathlib

import pytest
from mentioned import mentions

from tests.unit import test_hostile_robots
from tests.unit.playbooks import played_robots

ROOT = pathlib.Path(__file__).resolve().parents[3]

ODD, HONEST = "kobuki1computer", "kobuki2computer"  # the odd one is the first: run_once and the roles begin with it
ADDRESSES = {ODD: "192.168.1.229", HONEST: "192.168.1.239"}
BROUGHT = {"changed": False, "msg": "", "concerns": {}}
CALM = {"exports": [], "ports": [], "sshd": {"installed": False, "includes_drop_ins": True, "other_setenv": []}}


def info_of(host):
    """The answer of multimaster_info on a computer of inventory/single_computer where all is well."""
    info = copy.deepcopy({**test_hostile_robots.INFOS["kobuki"], **CALM, "hostname": host})
    (outer,) = (one for one in info["interfaces"] if not one["loopback"])
    outer["addresses"] = [{"address": ADDRESSES[host], "prefix": 24, "family": "inet"}]
    return info


def answers_of(host):
    verified = {"changed": False, "machine": info_of(host), "multicast": {}, "talker": {"running": True}, "msg": ""}
    return {
        "multimaster_info": info_of(host),
        "multimaster_computer": BROUGHT,
        "multimaster_verify": verified,
    }


def wrong_address(info):
    info["interfaces"] = [one for one in info["interfaces"] if one["loopback"]]


def strange(info):
    info["python"] = "x.y"


def orders(info):
    info["ansible_facts"] = {"ansible_connection": "local"}


def failed(info):
    info.update(failed=True, msg="The machine is not to be looked at.")


LOOKS = {
    wrong_address: f"{ODD}: multimaster_address is 192.168.1.229, but the machine has no address; expected",
    strange: f"{ODD}: what its machine has answered to multimaster_info cannot be compared with the plan",
    orders: f"{ODD}: the answer to rosfleet.multimaster.multimaster_info is none of this module: found the key",
    failed: f"{ODD}: the machine could not be looked at",
}


def played(tmp_path, playbook, change, *options):
    """Run a playbook against two robots; `change` takes the answers of the odd one."""
    answers = {host: answers_of(host) for host in ADDRESSES}
    change(answers[ODD])
    return played_robots.Played(
        tmp_path, ROOT / "playbooks" / playbook, ROOT / "inventory/single_computer", answers, *options
    )


def each_look(odd):
    def change(answers):
        odd(answers["multimaster_info"])
        if odd not in (orders, failed):  # these are of the whole answer
            odd(answers["multimaster_verify"]["machine"])
        else:
            odd(answers["multimaster_verify"])

    return change


@pytest.mark.slow
@pytest.mark.parametrize("odd", LOOKS, ids=lambda odd: odd.__name__)
def test_site_leaves_the_odd_one_as_it_is(tmp_path, odd):
    run = played(tmp_path, "site.yml", each_look(odd))
    assert run.status == 2 and LOOKS[odd] in run.text, run.output
    assert not run.has_run(ODD, "multimaster_computer", "managed_services")
    assert run.has_run(HONEST, "multimaster_computer", "managed_services")
    assert mentions(run.text, "SUMMARY", "0", "2", "1", ODD, "FAILED")


@pytest.mark.slow
def test_site_repeats_its_warnings_at_the_end(tmp_path):
    def change(answers):
        row = {
            "file": "/home/ann/.bashrc",
            "line": 115,
            "variable": "ROS_IP",
            "value": "10.0.0.1",
            "text": "ROS_IP=10.0.0.1",
        }
        answers["multimaster_info"].update(
            exports=[{**row, "person": "", "shell": ""}], problems=["The part sshd is unread."]
        )

    run = played(tmp_path, "site.yml", change)
    end = run.text.split("SUMMARY: ")[1]
    assert run.status == 0 and mentions(
        end, "Warnings", f"{ODD}: /home/ann/.bashrc, line 115 sets ROS_IP", "sshd is unread"
    ), run.output
    assert f"- {HONEST}: " not in end


@pytest.mark.slow
def test_site_goes_on_where_one_can_have_no_packet_filter(tmp_path):
    def change(answers):
        answers['multimaster_computer: "_ansible_check_mode": true'] = {
            **BROUGHT,
            "failed": True,
            "msg": "No nft here.",
        }

    run = played(tmp_path, "site.yml", change, "-e", "multimaster_firewall=fleet")
    assert run.status == 2 and "No nft here." in run.text, run.output
    assert [run.has_run(host, "multimaster_computer", "managed_services") for host in (ODD, HONEST)] == [False, True]


@pytest.mark.slow
def test_who_wants_all_or_nothing_says_so(tmp_path, monkeypatch):
    monkeypatch.setenv("ANSIBLE_ANY_ERRORS_FATAL", "true")
    run = played(tmp_path, "site.yml", each_look(wrong_address))
    assert run.status == 2 and LOOKS[wrong_address] in run.text, run.output
    assert not any(run.has_run(host, "multimaster_computer", "managed_services") for host in (ODD, HONEST))


@pytest.mark.slow
@pytest.mark.parametrize("odd", [strange, orders, failed], ids=lambda odd: odd.__name__)
def test_verify_judges_the_others(tmp_path, odd):
    report = tmp_path / "report.json"
    run = played(tmp_path, "verify.yml", each_look(odd), "-e", f"verify_report={report} verify_interval=0.1")
    assert run.status == 2 and run.has_run(HONEST, "multimaster_verify", '"action": "collect"'), run.output
    assert not run.has_run(ODD, "multimaster_verify", '"action": "collect"')
    assert run.systemctl == 2 * ["stop multimaster-verify-talker.service"]
    last = run.output.split("PLAY RECAP")[0].rstrip().splitlines()[-1]
    assert last.startswith("fatal: [") and '"msg": "FAILED: ' in last and "evaluated_to" not in last, last
    found = json.loads(report.read_text())
    findings = json.dumps(found["findings"])
    assert found["verdict"] == "failed" and ODD in findings
    assert odd is not strange or "cannot be compared with the plan" in findings


@pytest.mark.slow
@pytest.mark.parametrize("odd", [strange, orders], ids=lambda odd: odd.__name__)
def test_predict_predicts_for_the_others(tmp_path, odd):
    run = played(tmp_path, "predict.yml", each_look(odd))
    assert run.status == 2 and LOOKS[odd] in run.text, run.output
    assert "TASK [Predict who reaches whom]" in run.text and f"ok: [{HONEST}]" in run.text.split("Predict who")[1]


TAKEN = {
    "multimaster_info": {
        "changed": False,
        "problems": [],
        "owned": [],
        "sshd": {"service": "ssh.service", "reload_due": False},
    },
    "multimaster_computer": BROUGHT,
}
KEEPS = {**TAKEN, 'multimaster_computer: "routes"': {**BROUGHT, "failed": True, "msg": "The routes stay."}}
HOSTS = ["tibi-nav", "tibi-visio", "dabo-nav", "dabo-visio", "router"]


@pytest.mark.slow
def test_teardown_keeps_the_way_to_one_open_and_takes_the_other_robots_back(tmp_path):
    answers = {host: KEEPS if host == "tibi-nav" else TAKEN for host in HOSTS}
    playbook, inventory = ROOT / "playbooks/teardown.yml", ROOT / "inventory/multi_computer"
    run = played_robots.Played(tmp_path, playbook, inventory, answers, "--limit", ",".join(["localhost", *HOSTS]))
    assert run.status == 2 and "The routes stay." in run.text, run.output
    closed = {host for host in HOSTS if run.has_run(host, "multimaster_computer", '"routes"')}
    assert closed == {"tibi-nav", "dabo-nav", "dabo-visio"}
    for host in ("tibi-visio", "router"):
        assert mentions(run.text, host, "tibi-nav")
    assert "TEARDOWN: 2 of 5 computers are as before. dabo-nav, dabo-visio: as before." in run.text, run.output
    assert run.text.count(": FAILED, for the reason above; left: ") == 3
