# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Former names of modules, in meta/runtime.yml: ansible-doc and ansible-playbook take them as the names of today."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[3]
COLLECTION = "rosfleet.multimaster."
ROUTING = yaml.safe_load((ROOT / "meta/runtime.yml").read_text(encoding="utf-8"))["plugin_routing"]
REDIRECTS = {name: entry["redirect"] for name, entry in ROUTING["modules"].items() if "redirect" in entry}
TOMBSTONES = {name: entry["tombstone"] for name, entry in ROUTING["modules"].items() if "tombstone" in entry}
#: options with which a module runs anywhere
OPTIONS = {"multimaster_logs": {"services": ["roscore"], "lines": 1}}


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
