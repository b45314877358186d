# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Former names of modules, in meta/runtime.yml: ansible-doc and ansible-playbook take them as the names of today."""

import json
import os
import subprocess
import sys
from pathlib import Path

import fleets
import pytest
import yaml
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain import to_plain

pytestmark = pytest.mark.whole

ROOT = Path(__file__).resolve().parents[3]
COLLECTION = "rosfleet.multimaster."
RUNTIME = yaml.safe_load((ROOT / "meta/runtime.yml").read_text(encoding="utf-8"))
ROUTING = RUNTIME["plugin_routing"]
REDIRECTS = {name: entry["redirect"] for name, entry in ROUTING["modules"].items() if "redirect" in entry}
TOMBSTONES = {name: entry["tombstone"] for name, entry in ROUTING["modules"].items() if "tombstone" in entry}
#: the option that the modules of a group have in common
OPTIONS_OF_GROUPS = {"confirmation": "confirm_within", "conflicts": "on_conflict", "records": "records"}
#: options with which a module runs anywhere
OPTIONS = {
    "fleet_follow": {"fleet": to_plain(fleets.plan())},
    "multimaster_follow": {"action": "send", "run": "verify-1"},
    "multimaster_logs": {"services": ["roscore"], "lines": 1},
}


@pytest.fixture
def ansible(tmp_path):
    """Run one of Ansible's programs; its exit status and output."""

    def run(program, *arguments):
        done = subprocess.run(
            [Path(sys.executable).with_name(program), *arguments],
            cwd=tmp_path,
            env={
                **os.environ,
                "ANSIBLE_CONFIG": str(ROOT / "ansible.cfg"),
                "ANSIBLE_COLLECTIONS_PATH": str(ROOT / ".work/collections"),
                "ANSIBLE_HOME": str(tmp_path / "ansible"),
                "ANSIBLE_NOCOLOR": "1",
                "LC_ALL": "C.UTF-8",
            },
            capture_output=True, text=True, timeout=300, check=False,
        )  # fmt: skip
        return done.returncode, done.stdout + done.stderr

    return run


@pytest.fixture
def play(ansible, tmp_path):
    """Run tasks on this computer: a module and its options each. Returns exit status, output and results."""

    def run(*tasks):
        results = tmp_path / "results.json"
        written = [
            {COLLECTION + name: options, "register": f"result_{number}"} for number, (name, options) in enumerate(tasks)
        ]
        names = ", ".join(f"result_{number}" for number in range(len(tasks)))
        copy = {"content": f"{{{{ [{names}] | to_json }}}}", "dest": str(results), "mode": "0600"}
        text = json.dumps(
            [{"hosts": "localhost", "gather_facts": False, "tasks": [*written, {"ansible.builtin.copy": copy}]}]
        )
        (tmp_path / "play.yml").write_text(text)
        python = f"ansible_python_interpreter={sys.executable}"
        status, output = ansible("ansible-playbook", "-i", "localhost,", "-c", "local", "-e", python, "play.yml")
        return status, output, json.loads(results.read_text()) if results.exists() else []

    return run


def test_an_action_goes_where_its_module_goes():
    assert ROUTING["action"] == ROUTING["modules"]
    for name, target in REDIRECTS.items():
        for folder in ("action", "modules"):
            assert not (ROOT / f"plugins/{folder}/{name}.py").exists()
            assert (ROOT / f"plugins/{folder}/{target.removeprefix(COLLECTION)}.py").exists()


@pytest.mark.parametrize("name", REDIRECTS)
def test_a_former_name_is_documented(ansible, name):
    status, output = ansible("ansible-doc", "-t", "module", COLLECTION + name)
    assert status == 0 and f"MODULE {REDIRECTS[name]}" in output, output


@pytest.mark.parametrize("name", REDIRECTS)
def test_a_former_name_runs(play, name):
    status, output, results = play((name, OPTIONS[name]), (REDIRECTS[name].removeprefix(COLLECTION), OPTIONS[name]))
    assert status == 0 and results[0] == results[1] and results[0]["changed"] is False, output


@pytest.mark.parametrize("name", TOMBSTONES)
def test_a_module_without_successor_says_what_to_do(play, name):
    status, output, _results = play((name, {}))
    assert status != 0 and TOMBSTONES[name]["warning_text"] in output, output


def test_a_group_of_modules_has_its_option_in_common(ansible):
    """And all that have it are in it."""
    status, output = ansible("ansible-doc", "--json", "--metadata-dump", "-t", "module", COLLECTION.rstrip("."))
    assert status == 0, output
    options = {
        name.removeprefix(COLLECTION): set(entry["doc"]["options"])
        for name, entry in json.loads(output[output.index("{") :])["all"]["module"].items()
        if name.removeprefix(COLLECTION) not in ROUTING["modules"]
    }
    having = {
        group: [name for name in sorted(options) if option in options[name]]
        for group, option in OPTIONS_OF_GROUPS.items()
    }
    assert having == RUNTIME["action_groups"]


def test_defaults_of_a_group_reach_its_modules(ansible, tmp_path):
    """Also where an action of the same name stands before the module."""
    task = {COLLECTION + "sysctl": {"settings": []}}
    defaults = {f"group/{COLLECTION}conflicts": {"on_conflict": "nonsense"}}
    play = {"hosts": "localhost", "gather_facts": False, "module_defaults": defaults, "tasks": [task]}
    (tmp_path / "play.yml").write_text(json.dumps([play]))
    python = f"ansible_python_interpreter={sys.executable}"
    status, output = ansible("ansible-playbook", "-i", "localhost,", "-c", "local", "-e", python, "--check", "play.yml")
    assert status != 0 and "on_conflict" in output and "nonsense" in output, output
