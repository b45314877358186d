# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The shipped inventories, the examples and the playbooks with Ansible itself; no host is reached."""

import json
import os
import pathlib
import re
import subprocess
import sys

import pytest
import yaml
from mentioned import mentions

pytestmark = pytest.mark.whole

ROOT = pathlib.Path(__file__).resolve().parents[2]
BIN = pathlib.Path(sys.executable).parent


def ansible(tool, *arguments):
    """Run one of Ansible's programs in the checkout; every connection goes to a command that fails at once."""
    environment = {
        **os.environ,
        "ANSIBLE_COLLECTIONS_PATH": str(ROOT / ".work/collections"),
        "ANSIBLE_NOCOLOR": "1",
        "ANSIBLE_SSH_EXECUTABLE": "/bin/false",
        "ANSIBLE_LOCALHOST_WARNING": "0",
        "ANSIBLE_CALLBACK_RESULT_FORMAT": "json",
    }
    return subprocess.run(
        [BIN / tool, *arguments], cwd=ROOT, env=environment, capture_output=True, text=True, check=False, timeout=120
    )


def plan(*inventories, limit="kobuki1"):
    """The results of fleet_plan for inventories."""
    options = [word for inventory in inventories for word in ("-i", str(inventory))]
    done = ansible("ansible", "robots", *options, "-m", "rosfleet.multimaster.fleet_plan", "--limit", limit)
    return done.returncode, done.stdout + done.stderr


def site(*inventories, limit="robots"):
    options = [word for inventory in inventories for word in ("-i", str(inventory))]
    done = ansible("ansible-playbook", *options, "site.yml", "--limit", limit)
    return done.returncode, " ".join((done.stdout + done.stderr).split())


@pytest.fixture
def changed(tmp_path):
    """A second inventory that changes the first."""

    def write(variables, **groups):
        path = tmp_path / "changed.json"
        path.write_text(json.dumps({"all": {"hosts": variables, **groups}}))
        return path

    return write


@pytest.mark.slow
def test_the_plan_covers_the_whole_inventory_whatever_the_limit():
    status, output = plan("inventory/single_computer")
    assert status == 0, output
    found = json.loads(output.partition("=>")[2])
    assert sorted(found["computers"]) == ["kobuki1computer", "kobuki2computer"]


@pytest.mark.slow
def test_a_wrong_inventory_ends_before_any_host_is_reached(changed):
    wrong = changed({"kobuki2computer": {"multimaster_address": "192.168.1.229"}})
    status, output = site("inventory/single_computer", wrong)
    assert status != 0
    assert mentions(output, "kobuki2computer", "multimaster_address", "192.168.1.229", "kobuki1computer", "own")
    assert "UNREACHABLE" not in output


@pytest.mark.slow
def test_a_wrong_host_outside_the_limit_is_named_too(changed):
    wrong = changed({"kobuki2computer": {"multimaster_master": "kobuki3computer"}})
    status, output = site("inventory/single_computer", wrong, limit="kobuki1")
    assert status != 0
    assert mentions(output, "kobuki2computer", "multimaster_master", "kobuki3computer", "kobuki2")


@pytest.mark.slow
def test_declared_data_flow_is_in_the_plan(changed):
    status, output = plan(
        "inventory/multi_computer",
        changed({}, children={"tibi": {"vars": {"multimaster_exports": [{"actions": ["/dock"], "to": ["dabo"]}]}}}),
        limit="car-visio",
    )
    assert status == 0, output
    found = json.loads(output.partition("=>")[2])
    assert found["flows"] == [
        {"from": ["tibi"], "to": ["dabo"], "topics": ["/dock/status", "/dock/feedback", "/dock/result"], "services": []}
    ]
    assert found["computers"]["car-visio"]["sync"] == {
        "ignore_subscribers": ["*"],
        "ignore_hosts": ["tibi-visio"],
        "ignore_topics": ["/diagnostics"],
        "strangers": "ignore",
        "allow": [],
    }


@pytest.mark.slow
def test_contradicting_exports_are_named_before_any_change(changed):
    given = {
        "tibi": [{"services": ["/reset"]}, {"topics": ["/pose"], "to": ["dabbo"]}],
        "dabo": [{"services": ["/reset"], "to": ["car"]}],
    }
    groups = {robot: {"vars": {"multimaster_exports": exports}} for robot, exports in given.items()}
    status, output = site("inventory/multi_computer", changed({}, children=groups))
    assert status != 0
    assert mentions(output, "tibi-visio", "multimaster_exports", "dabbo", "dabo")
    assert mentions(output, "dabo-nav", "multimaster_exports", "/reset", "car", "tibi")
    assert "UNREACHABLE" not in output


@pytest.mark.slow
def test_an_undefined_variable_in_a_template_is_named(changed):
    wrong = changed({"kobuki2computer": {"multimaster_address": "{{ nowhere }}"}})
    status, output = site("inventory/single_computer", wrong)
    assert status != 0
    assert "kobuki2computer: multimaster_address cannot be computed" in output
    assert "nowhere" in output


@pytest.mark.slow
def test_robots_that_are_no_groups_are_named(tmp_path):
    flat = tmp_path / "flat.yml"
    flat.write_text("robots: {hosts: {kobuki1computer: {multimaster_address: 192.168.1.229}}}\n")
    status, output = site(flat)
    assert status != 0
    assert mentions(output, "kobuki1computer", "group", "robots")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["site", "single_computer", "verify", "teardown"])
def test_an_inventory_without_robots_is_an_error(tmp_path, name):
    mistyped = tmp_path / "mistyped.yml"
    mistyped.write_text(
        "robot: {children: {kobuki1: {hosts: {kobuki1computer: {multimaster_address: 192.168.1.229}}}}}\n"
    )
    done = ansible("ansible-playbook", "-i", str(mistyped), f"rosfleet.multimaster.{name}")
    assert done.returncode != 0
    assert "The inventory has no robots" in done.stdout + done.stderr


@pytest.mark.slow
def test_every_playbook_is_callable_by_its_full_name():
    names = [f"rosfleet.multimaster.{path.stem}" for path in sorted((ROOT / "playbooks").glob("*.yml"))]
    done = ansible("ansible-playbook", "-i", "inventory/single_computer", *names, "--syntax-check")
    assert len(names) >= 10 and done.stdout.count("playbook: ") == len(names), done.stdout
    assert done.returncode == 0, done.stderr


def test_a_host_below_robots_and_beside_its_groups_is_no_robot(changed):
    extra = changed({}, children={"robots": {"hosts": {"laptop": {}}}})
    status, output = site("inventory/single_computer", extra)
    assert status != 0
    assert mentions(output, "laptop", "robots")


# The examples

EXAMPLES = ROOT / "examples"
PLAYS = sorted(path.name for path in EXAMPLES.glob("*.yml"))
LISTED = sorted(path.stem for path in (EXAMPLES / "inventory").iterdir())
COMMAND = re.compile(r"^#   ansible-playbook -i inventory/(\w+)\.yml (\w+\.yml)", re.MULTILINE)


def test_each_example_says_its_command_and_is_in_the_table():
    commands = {pair for play in PLAYS for pair in COMMAND.findall((EXAMPLES / play).read_text(encoding="utf-8"))}
    page = (EXAMPLES / "README.md").read_text(encoding="utf-8")
    rows = re.findall(r"\| \[\w+\]\((\w+\.yml)\) \| \[\w+\]\(inventory/(\w+)\.yml\) \|$", page, re.MULTILINE)
    assert sorted(commands) == sorted((inventory, play) for play, inventory in rows)
    assert sorted(play for _inventory, play in commands) == PLAYS
    assert sorted({inventory for inventory, _play in commands}) == LISTED


@pytest.mark.slow
def test_ansible_reads_every_example():
    plays = [f"examples/{play}" for play in PLAYS]
    done = ansible("ansible-playbook", "-i", "examples/inventory/two_robots.yml", *plays, "--syntax-check")
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("playbook: ") == len(PLAYS)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in LISTED if name != "machines"])
def test_an_example_has_a_plan_for_each_of_its_computers(name):
    status, output = plan(f"examples/inventory/{name}.yml")
    assert status == 0, output
    robots = yaml.safe_load((EXAMPLES / f"inventory/{name}.yml").read_text(encoding="utf-8"))["robots"]["children"]
    found = json.loads(output.partition("=>")[2])
    assert sorted(found["computers"]) == sorted(host for robot in robots.values() for host in robot["hosts"])


@pytest.mark.parametrize("inventory", sorted(path.parent.name for path in ROOT.glob("inventory/*/hosts.yml")))
def test_no_run_warns_that_ansible_looked_for_a_python(inventory, tmp_path):
    """Two lines of each run were about it. Who names a Python for a computer gets that one."""
    listed = ansible("ansible-inventory", "-i", f"inventory/{inventory}", "--list")
    hosts = json.loads(listed.stdout)["_meta"]["hostvars"]
    assert {name: of.get("ansible_python_interpreter") for name, of in hosts.items()} == dict.fromkeys(
        hosts, "auto_silent"
    )
    one = sorted(hosts)[0]
    own = tmp_path / "own.json"
    own.write_text(json.dumps({"all": {"hosts": {one: {"ansible_python_interpreter": "/usr/bin/python3.8"}}}}))
    named = ansible("ansible-inventory", "-i", f"inventory/{inventory}", "-i", str(own), "--host", one)
    assert json.loads(named.stdout)["ansible_python_interpreter"] == "/usr/bin/python3.8"


def test_the_settings_for_an_own_fleet_are_those_of_the_checkout():
    """All but the folders of the checkout, and what only its tests need."""
    page = (ROOT / "docs/start/playbooks.md").read_text(encoding="utf-8")
    sample = re.search(r"```ini\n# ansible.cfg\n(.*?)```", page, re.DOTALL).group(1)
    own = (ROOT / "ansible.cfg").read_text(encoding="utf-8").splitlines()
    lines = [line for line in sample.splitlines() if line]
    assert "interpreter_python = auto_silent" in lines
    assert [line for line in lines if line not in own] == []
