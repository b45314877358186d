# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The files of an adopted inventory: golden ones, and what Ansible reads of them."""

import json
import os
import pathlib

import pytest
import yaml
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._adopt import facts, write
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._adopt.infer import propose
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory.read import read_fleet
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.plan import fleet_plan
from shown import FOLDER, inventory_of, machine, machines_of, read_folder, roscore

GOLDEN = pathlib.Path(__file__).parents[3] / "golden" / "adopt"
KOBUKI2 = {"masters": [roscore("kobuki2computer", "192.168.1.239", implementation="upstream", group="226.0.0.0")]}


def shipped(layout):
    return machines_of(fleet_plan(read_fleet(read_folder(FOLDER / layout))))


def untidy():
    """Fig. 5 with what people have beside it: doubts of every kind."""
    first = shipped("single_computer")["kobuki1computer"]
    first["interfaces"].append(
        {
            "name": "docker0",
            "up": True,
            "loopback": False,
            "addresses": [{"address": "172.17.0.1", "prefix": 16, "family": "inet"}],
        }
    )
    return {
        "192.168.1.229": first,
        "kobuki2computer": machine("kobuki2computer", "192.168.1.239/24", **KOBUKI2),
        "tibi-nav": machine(
            "ubuntu", "192.168.11.100/24", uri="http://192.168.11.101:11311", routes=[("0.0.0.0/0", "192.168.11.101")]
        ),
        "tibi-visio": machine("ubuntu", "192.168.11.101/24", "192.168.1.201/24"),
        "laptop": machine("laptop", "192.168.1.77/24"),
    }


LIST = {
    "192.168.1.229": {"ansible_user": "operator", "ansible_become_password": "x", "comment": "no way"},
    "kobuki2computer": {"ansible_user": "operator", "ansible_host": "robot2.lan", "ansible_port": 2222},
    "tibi-nav": {
        "ansible_user": "operator",
        "ansible_ssh_common_args": "-o ProxyJump=operator@192.168.1.201",
        "ansible_ssh_extra_args": "-o ProxyCommand='sshpass -p x ssh'",
    },
    "tibi-visio": {"ansible_user": "operator", "ansible_host": "{{ tibi }}", "multimaster_address": "1.2.3.4"},
}
CASES = {
    "single_computer": (shipped("single_computer"), {}),
    "multi_computer": (shipped("multi_computer"), {}),
    "untidy": (untidy(), LIST),
}


def adopted(infos, left_out=None):
    return propose([facts.read_machine(name, info) for name, info in infos.items()], left_out or {})


@pytest.mark.parametrize("case", CASES)
def test_the_files_are_the_golden_ones(case):
    infos, connections = CASES[case]
    files = write.files(adopted(infos, {"husky": "it cannot be reached"}), connections)
    if os.environ.get("UPDATE_GOLDEN"):
        for name, text in files.items():
            path = GOLDEN / case / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
    kept = {str(path.relative_to(GOLDEN / case)): path.read_text() for path in (GOLDEN / case).rglob("*.yml")}
    assert files == kept


@pytest.mark.parametrize("case", CASES)
def test_what_is_written_is_what_was_proposed(case):
    infos, connections = CASES[case]
    proposal = adopted(infos)
    files = {name: yaml.safe_load(text) for name, text in write.files(proposal, connections).items()}
    read = inventory_of(files["hosts.yml"], {pathlib.PurePath(name).stem: data for name, data in files.items()})
    assert read == proposal.inventory()
    assert list(read.robots) == list(proposal.inventory().robots)


def test_no_secret_is_written():
    infos, connections = CASES["untidy"]
    text = "".join(write.files(adopted(infos), connections).values())
    assert "sshpass" not in text and "password: x" not in text and "no way" not in text and "1.2.3.4" not in text


@pytest.mark.parametrize("options", ["-o ProxyUseFdpass=yes", "-oProxyUseFdpass=yes -o ProxyCommand='nc %h 22'"])
def test_an_option_of_ssh_is_no_secret(options):
    infos, _connections = CASES["untidy"]
    given = {name: {"ansible_ssh_common_args": options} for name in infos}
    assert json.dumps(options) in "".join(write.files(adopted(infos), given).values())


class UnsafeText(str):
    """As the controller has texts that are not trusted."""

    __slots__ = ()


@pytest.mark.parametrize(
    "text",
    [
        UnsafeText("~/my keys/one"),
        "~/keys/\U0001f916",
        "~/Schl\u00fcssel \x7f\x85\u2028",
        "a: b # c",
        "yes",
        "1e3",
        "",
        "x " * 90,
    ],
)
def test_a_text_comes_back_as_it_was(text):
    infos, _connections = CASES["untidy"]
    given = {name: {"ansible_ssh_private_key_file": text} for name in infos}
    read = yaml.safe_load(write.files(adopted(infos), given)["group_vars/robots.yml"])
    assert read["ansible_ssh_private_key_file"] == text


@pytest.mark.parametrize("word", ["pass", "sshpass -p x", "my_password", "ProxyUseFdpass=yes token=1", "DB_PASSWD=1"])
def test_a_word_of_a_secret_is_found(word):
    infos, _connections = CASES["untidy"]
    given = {name: {"ansible_ssh_common_args": f"-o X='{word}'"} for name in infos}
    text = "".join(write.files(adopted(infos), given).values())
    assert word not in text and "ansible_ssh_common_args: a secret" in text


HOSTILE = "x\n  evil: {{ lookup('pipe', 'id') }}\u202e\x1b[31m"


def test_what_machines_tell_steers_nothing():
    infos = shipped("single_computer")
    infos["kobuki1computer"]["masters"][0]["process"] = {"unit": HOSTILE, "command": HOSTILE}
    infos["kobuki1computer"]["masters"][0]["discovery"][0]["group"] = HOSTILE
    infos["kobuki1computer"]["hostname"] = HOSTILE
    infos["kobuki1computer"]["environment"] = {"login": {"ROS_MASTER_URI": f"http://{HOSTILE}:11311"}}
    infos["kobuki1computer"]["exports"] = [{"variable": "ROS_MASTER_URI", "value": HOSTILE, "file": HOSTILE, "line": 1}]
    for text in write.files(adopted(infos, {"husky": HOSTILE}), {}).values():
        assert all("evil" not in line or line.lstrip().startswith("#") for line in text.splitlines())
        assert "\x1b" not in text and "\u202e" not in text
        assert "evil" not in str(yaml.safe_load(text))
