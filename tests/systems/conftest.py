# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A lab of its own for injected faults: the two robots of Fig. 5 after site.yml."""

import json
import shlex
import subprocess
from pathlib import Path

import pytest
from machines import containers
from proofs.busy import Busy
from subject import lab_of

ROOT = Path(__file__).resolve().parents[2]
INVENTORY = ROOT / "inventory" / "single_computer"


def pytest_addoption(parser):
    """Files that have a lab in common are told its name."""
    parser.addoption("--lab", default="systems", help="the name of the lab that the files have in common")


@pytest.fixture(scope="session")
def new_lab():
    """The function that makes a lab by its name and inventory, for tests that want another one."""
    return lab_of


@pytest.fixture(scope="session")
def slack():
    """By how many seconds limits are longer, because of other work on this machine since a moment of the steady clock."""
    with Busy() as busy:
        yield busy.slack


@pytest.fixture(scope="session")
def untouched(request):
    """The lab before site.yml."""
    with lab_of(request.config.getoption("--lab"), INVENTORY) as found:
        yield found


@pytest.fixture(scope="session")
def lab(untouched):
    """The lab after site.yml."""
    status, output = untouched.play("site.yml")
    assert status == 0, output
    return untouched


# What ansible-core needs to run: itself and its libraries.
LIBRARIES = (
    "ansible cffi cryptography jinja2 markupsafe packaging pycparser resolvelib yaml _cffi_backend* _yaml *.dist-info"
)


def bring_ansible(lab, host):
    """Bring ansible-core to /tmp/ansible, and the checkout to /tmp/fleet, which is the collection in /tmp/collections."""
    here = shlex.quote(containers.container(lab.name, host))
    packages = Path(pytest.__file__).parents[1]
    into = f"podman exec -i {here} tar -x -C"
    lab.run(host, "mkdir -p /tmp/ansible /tmp/fleet /tmp/collections/ansible_collections/rosfleet")
    for command in (
        f"cd {packages} && tar -c $(ls -d {LIBRARIES}) | {into} /tmp/ansible",
        f"cd {ROOT} && git ls-files -z -co --exclude-standard | tar -c --null -T - --ignore-failed-read | {into} /tmp/fleet",
    ):
        subprocess.run(["bash", "-o", "pipefail", "-c", command], check=True, stderr=subprocess.DEVNULL)
    lab.run(host, "ln -sfn /tmp/fleet /tmp/collections/ansible_collections/rosfleet/multimaster")


@pytest.fixture(scope="session")
def bring():
    """The function that brings Ansible and the checkout to a computer of a lab."""
    return bring_ansible


@pytest.fixture(scope="session")
def run_by_hand(lab):
    """A function that runs a module on the second computer without a controller that confirms, and returns its answer."""
    host = "kobuki2computer"
    bring_ansible(lab, host)

    def run(module, **arguments):
        modules = "ansible_collections.rosfleet.multimaster.plugins.modules"
        command = f"PYTHONPATH=/tmp/ansible:/tmp/collections python3 -B -m {modules}.{module}"
        lab.run(host, "cat > /run/arguments", stdin=json.dumps({"ANSIBLE_MODULE_ARGS": arguments}))
        return json.loads(lab.run(host, f"{command} /run/arguments; rm /run/arguments", check=False))

    return run


@pytest.fixture(scope="session")
def ansible_inside(lab):
    """The command for ansible-playbook on the first computer, with the checkout in /tmp/fleet and a way to the second."""
    host = "kobuki1computer"
    key = json.loads(lab.connection.read_text())["all"]["hosts"][host]["ansible_ssh_private_key_file"]
    member = {
        "all": {
            "hosts": {
                host: {"ansible_connection": "local"},
                "kobuki2computer": {
                    "ansible_user": "root",
                    "ansible_ssh_private_key_file": "/tmp/fleet/key",
                    "ansible_ssh_common_args": "-o StrictHostKeyChecking=no -o UserKnownHostsFile=/dev/null",
                },
            }
        }
    }
    bring_ansible(lab, host)
    lab.run(host, "umask 077; cat > /tmp/fleet/key", stdin=Path(key).read_text())
    lab.run(host, "cat > /tmp/fleet/member.yml", stdin=json.dumps(member))
    return (
        "cd /tmp/fleet && LC_ALL=C.UTF-8 PYTHONPATH=/tmp/ansible ANSIBLE_COLLECTIONS_PATH=/tmp/collections "
        "python3 -m ansible playbook"
    )
