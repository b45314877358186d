# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A user's inventory is read by Ansible itself: templates, secrets, scripts; nothing of it is changed."""

import json

import pytest
from machines.podman import LabError
from rehearsals.inventory_files import environment, read
from rehearsals.rehearsal import OPTIONS

INI = """
[kobuki1]
one ansible_host=192.168.1.229 multimaster_address="{{ ansible_host }}"
[kobuki2]
two ansible_host=192.168.1.239 multimaster_address="{{ ansible_host }}"
[robots:children]
kobuki1
kobuki2
[robots:vars]
multimaster_common_network=192.168.1.0/24
ansible_connection=paramiko_ssh
ansible_become=true
"""
SECRET = "ansible_become_password: !vault |\n  $ANSIBLE_VAULT;1.1;AES256\n  61626364\n"
SCRIPT = """#!/usr/bin/env python3
import json
robots = {name: {"hosts": [name + "-pc"]} for name in ("ana", "bob")}
variables = {"ana-pc": {"multimaster_address": "192.168.1.2"}, "bob-pc": {"multimaster_address": "192.168.1.3"}}
print(json.dumps({"robots": {"children": ["ana", "bob"]}, **robots, "_meta": {"hostvars": variables}}))
"""


def content(folder):
    return {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in folder.rglob("*") if path.is_file()}


@pytest.fixture
def fleet(tmp_path):
    """A folder with an inventory in INI's language, an encrypted file and an encrypted value."""
    folder = tmp_path / "fleet"
    (folder / "group_vars" / "all").mkdir(parents=True)
    (folder / "hosts.ini").write_text(INI)
    (folder / "group_vars" / "all" / "vault.yml").write_text("$ANSIBLE_VAULT;1.1;AES256\n61626364\n")
    (folder / "group_vars" / "robots.yml").write_text(SECRET + "verify_patience: '{{ 10 + 20 }}'\n")
    return folder


@pytest.mark.slow
def test_a_folder_with_secrets_is_read_without_a_password(fleet, tmp_path, monkeypatch):
    before = content(fleet)
    monkeypatch.setenv("ANSIBLE_VAULT_PASSWORD_FILE", "/nowhere")
    monkeypatch.setenv("ANSIBLE_INVENTORY", "/nowhere/either")
    found = read(fleet, tmp_path / "work", OPTIONS)
    assert found.encrypted == ("group_vars/all/vault.yml",)
    assert found.values["robots"] == {"kobuki1": ["one"], "kobuki2": ["two"]}
    assert found.values["variables"]["two"] == {
        "multimaster_address": "192.168.1.239",
        "multimaster_common_network": "192.168.1.0/24",
        "verify_patience": 30,
    }
    assert "ansible_become_password" in found.listing["_meta"]["hostvars"]["one"]
    assert content(fleet) == before and not list((tmp_path / "work").iterdir())


@pytest.mark.slow
def test_a_value_that_needs_the_password_is_named(fleet, tmp_path):
    secret = SECRET.replace("ansible_become_password", "multimaster_common_network")
    (fleet / "group_vars" / "robots.yml").write_text(secret)
    (problem,) = read(fleet, tmp_path / "work", OPTIONS).values["problems"]
    assert problem.startswith("one: multimaster_common_network cannot be computed (")


@pytest.mark.slow
def test_a_script_beside_group_vars(tmp_path):
    folder = tmp_path / "fleet"
    (folder / "group_vars").mkdir(parents=True)
    (folder / "group_vars" / "robots.yml").write_text("multimaster_common_network: 192.168.1.0/24\n")
    (folder / "not_meant.yml").write_text("robots: {hosts: {third: }}\n")
    script = folder / "hosts.py"
    script.write_text(SCRIPT)
    script.chmod(0o755)
    found = read(script, tmp_path / "work", OPTIONS).values
    assert found["robots"] == {"ana": ["ana-pc"], "bob": ["bob-pc"]}
    assert found["variables"]["ana-pc"]["multimaster_common_network"] == "192.168.1.0/24"


@pytest.mark.slow
def test_an_inventory_that_site_would_refuse(tmp_path):
    listed = tmp_path / "hosts.json"
    listed.write_text(json.dumps({"robots": {"children": {"ana": {"hosts": {"one": None}}}}}))
    problems = read(listed, tmp_path / "work", OPTIONS).values["problems"]
    assert any(problem.startswith("one: multimaster_address is not set") for problem in problems)


@pytest.mark.slow
@pytest.mark.parametrize("text", ["robots: [", "$ANSIBLE_VAULT;1.1;AES256\n6162\n"])
def test_what_cannot_be_read_gets_a_sentence(tmp_path, text):
    broken = tmp_path / "hosts.yml"
    broken.write_text(text)
    with pytest.raises(LabError, match="encrypted as a whole|cannot read") as found:
        read(broken, tmp_path / "work", OPTIONS)
    assert str(broken) in str(found.value) and str(tmp_path / "work") not in str(found.value)


def test_no_inventory(tmp_path):
    with pytest.raises(LabError, match="exist.*INVENTORY"):
        read(tmp_path / "nowhere", tmp_path / "work", OPTIONS)


def test_the_environment_keeps_what_is_not_of_another_inventory(monkeypatch):
    monkeypatch.setenv("ANSIBLE_BECOME_PASSWORD_FILE", "/nowhere")
    monkeypatch.setenv("ANSIBLE_FORKS", "3")
    found = environment()
    assert "ANSIBLE_BECOME_PASSWORD_FILE" not in found and found["ANSIBLE_FORKS"] == "3"
