# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A robot that answers anything, through the door and then through each reader: a sentence at most, and the others keep their results.

The same answers come from a real robot in tests/systems/test_hostile_robot.py.
"""

import base64
import copy
import functools
import json
import random
import types

import fleets
import hostile_answers
import pytest
import shown
import worlds
from acting import act
from ansible.playbook.task import Task
from ansible_collections.rosfleet.multimaster.plugins.action import (
    fleet_adopt,
    fleet_bundle,
    fleet_check,
    fleet_keys,
    fleet_packet_trace,
    fleet_predict,
    fleet_report,
    fleet_summary,
    fleet_watch,
)
from ansible_collections.rosfleet.multimaster.plugins.filter.talkers_heard import talkers_heard
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain import to_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._network.plan_world import make_world
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import providers
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._robot_io import answer
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._robot_io.robot_action import answer_of

pytestmark = pytest.mark.whole

SEEDS = [pytest.param(seed, marks=[pytest.mark.costly] if seed >= 60 else []) for seed in range(120)]
#: what is small and has the shape of an answer: other attacks end at the door (test_answer.py)
SHAPED = ["texts", "numbers", "types", "less", "more"]
HOSTILE, HONEST = "kobuki", "tibi-nav"
PLAN = worlds.fig12()
#: what each machine answers beside its networks
REST = {
    "hostname": "kobuki",
    "python": "3.11.2",
    "systemd": {"running": True, "version": 252, "net_admin": True},
    "multicast_routing": {"smcrouted": "/usr/sbin/smcrouted", "others": []},
    "ros": {
        "problem": "",
        "found": [],
        "chosen": {
            "kind": "debian",
            "setup": "",
            "distro": "debian",
            "python": "/usr/bin/python3",
            "python_version": "3.11.2",
            "environment": {"PATH": "/usr/bin"},
            "for_root": {"PATH": "/usr/bin"},
            "left_out": [],
            "missing": [],
            "commands": {"roscore": "/usr/bin/roscore"},
            "nodes": [
                {"package": node.package, "executable": node.executable, "path": "/opt/x", "problem": "", "lacks": []}
                for node in providers.nodes_to_look_for("fkie_existing")
            ],
        },
    },
    "packages": [{"name": "smcroute", "installed": "2.5", "candidate": "2.5", "ours": False}],
    "clock": {
        "chronyd": "/usr/sbin/chronyd",
        "enabled": False,
        "settable": True,
        "others": [{"service": "ntpsec.service", "file": "/etc/ntpsec/ntp.conf", "line": "server 192.0.2.1"}],
        "restart_due": False,
        "sources": [],
    },
    "tunnel": {"kernel": True, "device": True},
    "folders": [],
    "ways": [],
    "ports": [
        {
            "protocol": "tcp",
            "port": 11311,
            "pid": 812,
            "command": "rosmaster",
            "user": "robot",
            "unit": "",
            "container": False,
        }
    ],
    "exports": [
        {
            "file": "/root/.bashrc",
            "line": 3,
            "variable": "ROS_IP",
            "value": "10.0.0.1",
            "text": "export ROS_IP=10.0.0.1",
        }
    ],
    "sshd": {
        "installed": True,
        "includes_drop_ins": False,
        "other_setenv": [{"file": "/x", "line": 1, "text": "SetEnv A=b", "match": False}],
    },
    "problems": [],
}
INFOS = {
    name: {**worlds.info_of(machine), **REST}
    for name, machine in make_world(PLAN).machines.items()
    if name in PLAN.computers
}
SEEN = fleets.observed(fleets.fig12())
WATCHED = {
    "changed": False,
    "watched": 3,
    "seconds": 10.0,
    "dropped": 0,
    "lost": [{"kind": "heartbeat", "name": "tibi"}],
    "events": [
        {"kind": "link", "name": "eth0", "well": False, "expected": "up", "found": "down", "time": 1.0, "after": 2.0}
    ],
    "msg": "Lost.",
}


@pytest.fixture(autouse=True)
def printed(monkeypatch):
    lines = []
    for module in (fleet_report, fleet_predict, fleet_watch, fleet_bundle, fleet_summary):
        monkeypatch.setattr(module.Display, "display", lambda self, text, **_more: lines.append(str(text)))
    return lines


def answered(drawn, true, module):
    """The part that the controller keeps of an answer that was changed in any way."""
    said = hostile_answers.answer(drawn, copy.deepcopy(true), "/mark", HONEST, drawn.choice(SHAPED))
    try:
        return answer.check_answer(said.decode("utf-8", "replace"), answer_of(module)).result
    except answer.StrangeAnswer as strange:
        return {"failed": True, "msg": str(strange)}


def acted(action, hostvars=None, **args):
    """The result of an action on the controller."""
    task = Task()
    task.action, task.async_val, task.check_mode, task.diff = "rosfleet.multimaster.action", 0, False, False
    task.args = args
    connection = types.SimpleNamespace(_shell=types.SimpleNamespace(tmpdir=None))
    context = types.SimpleNamespace(password=None, become_pass=None)
    variables = {
        "hostvars": hostvars,
        "ansible_play_hosts_all": list(hostvars or ()),
        "inventory_dir": "/home/me/fleet",
    }
    return act(action.ActionModule(task, connection, context, None, None, None), variables)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_look_at_a_machine(seed):
    drawn = random.Random(f"look {seed}")
    found = answered(drawn, INFOS[HOSTILE], "multimaster_info")
    result = acted(fleet_check, plan=to_plain(PLAN.computers[HOSTILE]), machine=found, refuse=drawn.random() < 0.5)
    json.dumps(result)
    assert not result.get("failed") or HOSTILE in result["msg"]


def change_each_part(info):
    """The answer without each of its parts, then with null and with another text there."""
    for path in list(hostile_answers.places(info)):
        for new in (None, "a text"):
            changed = copy.deepcopy(info)
            hostile_answers.replace_at(changed, path, lambda _old, new=new: new)
            yield changed
        changed = copy.deepcopy(info)
        place = functools.reduce(lambda value, key: value[key], path[:-1], changed)
        del place[path[-1]]
        yield changed


@pytest.mark.parametrize(
    "variables",
    [
        {"multimaster_clock": "tibi-nav"},
        {"multimaster_provider": "fkie_existing"},
        {"multimaster_provider": "fkie_apt"},
    ],
    ids=lambda variables: "-".join(variables.values()),
)
def test_each_part_of_a_look_may_be_missing(variables):
    plan = to_plain(worlds.fig12(**variables).computers[HOSTILE])
    true = answer.check_answer(json.dumps(INFOS[HOSTILE]), answer_of("multimaster_info")).result
    assert not acted(fleet_check, plan=plan, machine=true, refuse=False).get("failed")
    failed = 0
    for info in change_each_part(INFOS[HOSTILE]):
        try:
            found = answer.check_answer(json.dumps(info), answer_of("multimaster_info")).result
        except answer.StrangeAnswer:
            continue
        result = acted(fleet_check, plan=plan, machine=found, refuse=False)
        assert not result.get("failed") or result["msg"].startswith(f"{HOSTILE}: what its machine has answered")
        failed += bool(result.get("failed"))
    assert failed > 20
    empty = acted(fleet_check, plan=plan, machine={**true, "clock": {}}, refuse=False)
    assert "multimaster_clock" not in variables or 'found no "others"; expected' in empty["msg"]


@pytest.mark.parametrize("seed", SEEDS)
def test_a_prediction(seed):
    found = answered(random.Random(f"look {seed}"), INFOS[HOSTILE], "multimaster_info")
    hostvars = {name: {"multimaster_info": found if name == HOSTILE else info} for name, info in INFOS.items()}
    result = acted(fleet_predict, hostvars, fleet=to_plain(PLAN), machine="multimaster_info", table=True)
    json.dumps(result)
    assert not result.get("failed")


class Hosts(dict):
    """The mapping that Ansible hands out as hostvars, as far as adopt looks at it."""

    _inventory = types.SimpleNamespace(
        get_host=lambda name: types.SimpleNamespace(get_groups=lambda: [], vars={"ansible_host": name})
    )


@pytest.mark.parametrize("seed", SEEDS)
def test_an_adoption(seed, tmp_path):
    infos = {
        name: shown.machine(name, f"192.168.1.{number}/24", masters=[shown.roscore(name, f"192.168.1.{number}")])
        for number, name in enumerate((HOSTILE, HONEST), 10)
    }
    infos[HOSTILE] = answered(random.Random(f"adopt {seed}"), infos[HOSTILE], "multimaster_info")
    hostvars = Hosts({name: {"adopt_found": info} for name, info in infos.items()})
    result = acted(fleet_adopt, hostvars, machines=list(infos), machine="adopt_found", path=str(tmp_path / "fleet"))
    assert [path.name for path in tmp_path.iterdir()] == ["fleet"]
    assert not result.get("failed")
    assert HONEST in shown.read_folder(tmp_path / "fleet").robots.values().__str__()


@pytest.mark.parametrize("seed", SEEDS)
def test_a_verification_and_its_report(seed, tmp_path):
    drawn = random.Random(f"verify {seed}")
    hostvars = {}
    for name, seen in SEEN.items():
        hostvars[name] = {
            "verify_probe": {**to_plain(seen.probe), "multicast": to_plain(seen.multicast) if seen.multicast else {}},
            "multimaster_info": copy.deepcopy(INFOS.get(name, {})),
        }
    mine = hostvars["car-nav"]
    mine["verify_probe"] = answered(drawn, mine["verify_probe"], "multimaster_verify")
    mine["multimaster_info"] = answered(drawn, mine["multimaster_info"], "multimaster_info")
    given = {
        "fleet": to_plain(fleets.fig12()),
        "multicast": "verify_probe.multicast",
        "probe": "verify_probe",
        "machine": "multimaster_info",
    }
    page, cases = tmp_path / "report.html", tmp_path / "junit.xml"
    result = acted(fleet_report, hostvars, **given, path=str(page), junit=str(cases))
    json.dumps(result)
    assert "passed" in result
    assert sorted(path.name for path in tmp_path.iterdir()) == ["junit.xml", "report.html", "report.page.html"]


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_what_runs_once_for_all_between_look_and_report(seed, tmp_path):
    """A task with run_once that fails ends the run for each computer."""
    drawn = random.Random(f"once {seed}")
    probes = {name: to_plain(seen.probe) for name, seen in SEEN.items()}
    hostvars = {name: {"verify_probe": probe, "verify_started": probe} for name, probe in probes.items()}
    mine = hostvars["car-nav"]
    for name in mine:
        mine[name] = answered(drawn, mine[name], "multimaster_verify")
    plan = to_plain(fleets.fig12())
    given = {"fleet": plan, "multicast": "verify_probe.multicast", "probe": "verify_probe"}
    result = acted(fleet_packet_trace, hostvars, **given, earlier=["verify_started"])
    json.dumps(result)
    assert not result.get("failed") and "listeners" in result
    heard = talkers_heard(plan, hostvars=hostvars, hosts=list(hostvars), registered="verify_started")
    assert set(heard) >= {"car", "tibi"}


BROUGHT = {
    "changed": True,
    "msg": "",
    "concerns": {
        "managed_files": [{"changed": True, "files": [{"path": "/etc/x", "state": "written"}]}],
        "managed_services": [{"changed": True, "units": [{"name": "multimaster-sync.service", "state": "restarted"}]}],
    },
}


@pytest.mark.parametrize("seed", SEEDS)
def test_a_summary(seed):
    told = answered(random.Random(f"summary {seed}"), BROUGHT, "multimaster_computer")
    result = acted(fleet_summary, {HOSTILE: {"brought": told}, HONEST: {"brought": BROUGHT}}, results=["brought"])
    json.dumps(result)
    assert not result.get("failed") and any(line.startswith(f"{HONEST}: files") for line in result["computers"])


KEYS = {
    "kobuki1computer": base64.b64encode(b"1" * 32).decode(),
    "kobuki2computer": base64.b64encode(b"2" * 32).decode(),
}
TUNNEL = {"multimaster_tunnel": "wireguard", "multimaster_transport": "unicast", "multimaster_firewall": "fleet"}


@pytest.mark.parametrize("seed", SEEDS)
def test_the_keys_of_a_tunnel(seed, tmp_path):
    """The honest one has its key in the end, unless the other one tells the same before it is kept."""
    told = {
        name: {"told": {"changed": True, "public_key": key, "waiting_key": "", "msg": ""}} for name, key in KEYS.items()
    }
    hostile, honest = told
    told[hostile]["told"] = answered(random.Random(f"keys {seed}"), told[hostile]["told"], "tunnel_key")
    plan, path = to_plain(fleets.plan(**TUNNEL)), str(tmp_path / "keys")
    result = acted(fleet_keys, told, fleet=plan, told="told", path=path, rotate=False)
    json.dumps(result)
    assert not result.get("failed") and result["keys_by_computer"][honest] == KEYS[honest]


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_a_watch(seed):
    drawn = random.Random(f"watch {seed}")
    told = answered(drawn, WATCHED, "multimaster_watch")
    hostvars = {
        HOSTILE: {"verify_watch_answer": told},
        HONEST: {"verify_watch_answer": {**WATCHED, "lost": [], "events": []}},
    }
    result = acted(fleet_watch, hostvars, watched="verify_watch_answer", duration="10 s", known={})
    json.dumps(result)
    assert not result.get("failed")
