# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""A robot whose Python answers anything, against each playbook: nothing of it acts on the controller or on the other robot.

The oldest ansible-core of the collection, and the newest one that there is for a Python of this machine, are fetched by pip.
"""

import functools
import itertools
import json
import os
import random
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from machines.podman import ROOT
from subject import NODES, lab_of

INVENTORY = ROOT / "inventory" / "single_computer"
HONEST, HOSTILE = "kobuki1computer", "kobuki2computer"
FOLDER = "/usr/local/lib/hostile"
OLDEST = "2.16.0"
VERSIONS = ("oldest", "newest")
SEEDS = int(os.environ.get("HOSTILE_SEEDS", "4"))  # runs of each playbook and version
WITHIN = 45  # seconds for one answer

#: name -> playbook, its variables; <folder> is one of the test
PLAYBOOKS = {
    "site": ("site.yml", {}),
    "predict": ("playbooks/predict.yml", {}),
    "verify": ("playbooks/verify.yml", {"verify_bundle": "<folder>/bundle.zip"}),
    "watch": ("playbooks/verify.yml", {"verify_watch": "10s"}),
    "report": ("playbooks/report.yml", {"bundle": "<folder>/bundle.zip", "bundle_report": "<folder>/bundle.html"}),
    "adopt": ("playbooks/adopt.yml", {"adopt_inventory": "<folder>/adopted"}),
    "teardown": ("playbooks/teardown.yml", {}),
}
#: words of what goes wrong in Ansible itself, or in our code
UNEXPECTED = (
    "Traceback",
    "Unexpected failure",
    "unexpected error",
    "An exception occurred",
    "MODULE FAILURE",
    "KeyError",
)


def core(version, python):
    """Install an ansible-core beside the others; returns the command of ansible-playbook, or None where that cannot be."""
    folder = ROOT / ".work" / "ansible" / f"{version or 'newest'}-{Path(python).name}"
    program = folder / "bin" / "ansible-playbook"
    if not program.exists():
        shutil.rmtree(folder, ignore_errors=True)
        subprocess.run([python, "-m", "venv", folder], check=True)
        wanted = f"ansible-core=={version}" if version else "ansible-core"
        pip = [folder / "bin" / "python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check", wanted]
        subprocess.run(pip, check=True, stderr=subprocess.DEVNULL)
    return program


def newest_python():
    """The newest Python of this machine that can make a virtual environment: it decides which ansible-core there is."""
    for minor in range(14, 10, -1):
        found = [
            shutil.which(f"python3.{minor}"),
            *Path.home().glob(f".pyenv/versions/3.{minor}.*/bin/python3.{minor}"),
        ]
        for python in filter(None, found):
            if (
                subprocess.run([python, "-c", "import ensurepip, venv"], capture_output=True, check=False).returncode
                == 0
            ):
                return str(python)
    return sys.executable


@pytest.fixture(scope="module")
def cores():
    return {"oldest": core(OLDEST, sys.executable), "newest": core("", newest_python())}


@pytest.fixture(scope="module")
def fleet(request, tmp_path_factory):
    """Two robots after site.yml; the Python of one of them can be made hostile."""
    with lab_of(f"{request.config.getoption('--lab')}", INVENTORY) as lab:
        status, output = lab.play("site.yml")
        assert status == 0, output
        lab.folder = tmp_path_factory.mktemp("hostile")
        lab.run(
            HOSTILE,
            f"mkdir -p {FOLDER}; cat > {FOLDER}/answers.py",
            stdin=(NODES / "hostile/hostile_answers.py").read_text(),
        )
        wrapper = f'#!/bin/sh\nexec /usr/bin/python3 -I -S {FOLDER}/answers.py {FOLDER}/settings "$@"\n'
        lab.run(HOSTILE, f"cat > {FOLDER}/python3; chmod 755 {FOLDER}/python3", stdin=wrapper)
        turned = {"all": {"hosts": {HOSTILE: {"ansible_python_interpreter": f"{FOLDER}/python3"}}}}
        (lab.folder / "turned.json").write_text(json.dumps(turned))
        yield lab


class Ended:
    """A run of a playbook against the hostile robot, and what it left."""

    def __init__(self, lab, program, name, settings):
        self.mark = lab.folder / "mark"
        seen = lab.folder / "variables.json"
        for path in (self.mark, seen, lab.folder / "adopted"):
            shutil.rmtree(path, ignore_errors=True) if path.is_dir() else path.unlink(missing_ok=True)
        settings = {"mark": str(self.mark), "honest": HONEST, **settings}
        lab.run(HOSTILE, f"rm -f {FOLDER}/settings.count; cat > {FOLDER}/settings", stdin=json.dumps(settings))
        playbook, variables = PLAYBOOKS[name]
        extra = json.dumps({"verify_report": str(lab.folder / "report.json"), **variables})
        command = [program, "-i", INVENTORY, "-i", lab.connection, "-i", lab.folder / "turned.json", playbook]
        process = subprocess.Popen(
            [*command, "-e", extra.replace("<folder>", str(lab.folder))],
            cwd=ROOT,
            env={
                **os.environ,
                "ANSIBLE_CONFIG": str(ROOT / "ansible.cfg"),
                "ANSIBLE_NOCOLOR": "1",
                "ANSIBLE_HOME": str(lab.folder / "home"),
                "ANSIBLE_TASK_TIMEOUT": str(WITHIN),
                "ANSIBLE_SSH_ARGS": "-o ControlMaster=no",  # so no connection outlives the run
                "ANSIBLE_CALLBACK_PLUGINS": str(ROOT / "lab" / "callbacks"),
                "ANSIBLE_CALLBACKS_ENABLED": "variables_seen",
                "VARIABLES_SEEN_HOST": HONEST,
                "VARIABLES_SEEN_FILE": str(seen),
            },
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        try:
            output, _none = process.communicate(timeout=300)
        finally:
            self.left = ended(process.pid)
        self.output = output.decode("utf-8", "backslashreplace")
        self.text, self.status = " ".join(self.output.split()), process.returncode
        self.seen = json.loads(seen.read_text()) if seen.exists() else {}


def ended(session):
    """End what is left of a session; return its command lines."""
    left = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if os.getsid(int(folder.name)) == session:
                left.append((folder / "cmdline").read_bytes().replace(b"\0", b" ").decode())
                os.kill(int(folder.name), signal.SIGKILL)
        except (OSError, ProcessLookupError):
            continue
    return [line for line in left if line]


def judged(run, honest, name):
    """Assert that nothing of the robot acted on the controller or on the other robot."""
    assert not run.mark.exists(), f"a command of the robot ran on the controller:\n{run.output}"
    assert not run.left, run.left
    assert run.seen == honest, f"variables of another host:\n{run.output}"
    assert not [word for word in UNEXPECTED if word in run.text], run.output
    hidden = [sign for sign in run.output if not (sign.isprintable() or sign == "\n")]
    assert not hidden, (hidden[:5], run.output)
    if run.status:
        assert HOSTILE in run.text or name == "report", run.output


@pytest.fixture(scope="module")
def honest(fleet, cores):
    """A function: what Ansible knows of the honest robot where nobody lies. No answer is more than its module documents."""

    @functools.cache
    def known(name):
        for wanted in ["verify"] * (name == "report") + [name]:  # a report needs the bundle of a verification
            run = Ended(fleet, cores["newest"], wanted, {"seed": 0, "after": 10**6, "attack": ""})
        assert run.status == 0, run.output
        assert "does not document" not in run.text, run.output
        assert run.seen["variables"]
        return run.seen

    return known


#: Those that each run of the tests has. The others ask what these ask.
OFTEN = ("site", "verify", "report", "adopt")


def cases():
    """The playbooks of OFTEN with one version in each run of the tests; all with both, some times, in the long ones."""
    for number, name in enumerate(PLAYBOOKS):
        for other, version in enumerate(VERSIONS):
            for seed in range(SEEDS):
                often = name in OFTEN and seed == 0 and (number + other) % 2 == 0
                marks = [] if often else [pytest.mark.costly]
                yield pytest.param(name, version, seed, marks=marks)


@pytest.mark.parametrize(("name", "version", "seed"), list(cases()))
def test_nothing_of_a_hostile_robot_acts(fleet, cores, honest, name, version, seed):
    drawn = random.Random(f"{name} {version} {seed}")
    whole(fleet)
    before = honest(name)
    if name == "report":  # of the bundle that the last hostile verification has written
        bundle = Ended(fleet, cores[version], "verify", settings_of(drawn, ["texts", "less", "more"]))
        judged(bundle, honest("verify"), "verify")
        if not (fleet.folder / "bundle.zip").exists():
            return
    if name == "site" and drawn.random() < 0.7:  # something is due
        fleet.run(
            HOSTILE, "rm -f /etc/profile.d/rosfleet-multimaster.sh; sysctl -q net.ipv4.icmp_echo_ignore_broadcasts=1"
        )
    run = Ended(fleet, cores[version], name, settings_of(drawn))
    judged(run, before, name)


def whole(fleet):
    """Set both robots up again where a run before has taken something back."""
    unit = "test -e /etc/systemd/system/multimaster-sync.service && echo there"
    if not all(fleet.run(host, unit, check=False) for host in (HONEST, HOSTILE)):
        status, output = fleet.play("site.yml")
        assert status == 0, output


def settings_of(drawn, attacks=("",)):
    return {"seed": drawn.randrange(10**6), "after": drawn.choice([0, 0, 1, 2]), "attack": drawn.choice(attacks)}


@pytest.mark.parametrize(
    ("attack", "version"),
    [
        ("orders", "newest"),
        *(
            pytest.param(*case, marks=pytest.mark.costly)
            for case in itertools.product(("flood", "flood_of_lines"), VERSIONS)
        ),
        pytest.param("orders", "oldest", marks=pytest.mark.costly),
    ],
)
def test_the_worst_answers_are_a_sentence_that_names_the_robot(fleet, cores, honest, attack, version):
    whole(fleet)
    before = honest("verify")
    run = Ended(fleet, cores[version], "verify", {"seed": 7, "after": 0, "attack": attack})
    judged(run, before, "verify")
    assert f"{HOSTILE}: the answer to rosfleet.multimaster.multimaster_verify is none of this module: found" in run.text
