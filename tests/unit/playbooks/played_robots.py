# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Robots that answer what a test says: their Python reads the module, notes its name, and prints the answer. Nothing runs on this machine.

played_robots.py FOLDER HOST ...    as the Python of the host
"""

import json
import os
import pathlib
import re
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[3]
MODULE = re.compile(r"multimaster\.plugins\.modules\.(\w+)")


def answer(folder, host):
    """Print what the host answers to the module that is read; a module without an answer fails.

    The answer "module: text" is for runs that have this text in their options.
    """
    read = sys.stdin.buffer.read().decode()
    module = MODULE.search(read).group(1)
    options = next(line for line in read.splitlines() if "ANSIBLE_MODULE_ARGS" in line)
    with (folder / f"{host}.ran").open("a") as ran:
        ran.write(f"{module}: {options}\n")
    answers = json.loads((folder / f"{host}.json").read_text())
    chosen = [
        said for key, said in answers.items() if key == module or has(f"{module}: {options}", *key.split(": ", 1))
    ]
    print(json.dumps(chosen[-1] if chosen else {"failed": True, "msg": f"no answer to {module}"}))


def has(run, module, *texts):
    """Return True if a run is one of this module, with these texts in its options."""
    return run.startswith(f"{module}: ") and all(text in run for text in texts)


def set_ansible(folder):
    """The environment of a run of ansible-playbook with the collection of the checkout; what it writes is in the folder."""
    return {
        **os.environ,
        "ANSIBLE_CONFIG": str(ROOT / "ansible.cfg"),
        "ANSIBLE_COLLECTIONS_PATH": str(ROOT / ".work/collections"),
        "ANSIBLE_HOME": str(folder / "ansible"),
        "ANSIBLE_NOCOLOR": "1",
        "LC_ALL": "C.UTF-8",
    }


def run_tasks(folder, *tasks):
    """Run tasks on this computer by ansible-playbook itself; the exit status, and all that it prints."""
    play = {"hosts": "localhost", "gather_facts": False, "connection": "local", "tasks": list(tasks)}
    (folder / "play.yml").write_text(json.dumps([play]))  # JSON is YAML
    done = subprocess.run(
        [pathlib.Path(sys.executable).with_name("ansible-playbook"), "-i", "localhost,", folder / "play.yml"],
        cwd=folder,
        env=set_ansible(folder),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=300,
        check=False,
    )
    return done.returncode, done.stdout


class Played:
    """A playbook that has run against robots: `status`, `output`, `text` (one line), and `ran`, by host: "module: options" of each run."""

    def __init__(self, folder, playbook, inventory, answers, *options):
        hosts = {}
        for host, said in answers.items():
            (folder / f"{host}.json").write_text(json.dumps(said))
            python = folder / f"{host}.python"
            python.write_text(f'#!/bin/sh\nexec {sys.executable} -I {__file__} {folder} {host} "$@"\n')
            python.chmod(0o755)
            hosts[host] = {"ansible_connection": "local", "ansible_python_interpreter": str(python)}
        systemctl = folder / "bin" / "systemctl"  # that ends the talker of a verification without a module
        systemctl.parent.mkdir()
        systemctl.write_text(f'#!/bin/sh\necho "$@" >> {folder}/systemctl.ran\n')
        systemctl.chmod(0o755)
        (folder / "played.json").write_text(json.dumps({"all": {"hosts": hosts}}))
        done = subprocess.run(
            [
                pathlib.Path(sys.executable).with_name("ansible-playbook"),
                *("-i", inventory, "-i", folder / "played.json", playbook, "-e", "ansible_become=false", *options),
            ],
            cwd=folder,
            env={**set_ansible(folder), "PATH": f"{systemctl.parent}:{os.environ['PATH']}"},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=300,
            check=False,
        )
        self.status, self.output = done.returncode, done.stdout
        self.text = " ".join(done.stdout.split())
        self.systemctl = self._read(folder / "systemctl.ran")
        self.ran = {host: self._read(folder / f"{host}.ran") for host in answers}

    @staticmethod
    def _read(path):
        return path.read_text().splitlines() if path.exists() else []

    def has_run(self, host, module, *texts):
        """Return True if a module has run on a host, with these texts in its options."""
        return any(has(run, module, *texts) for run in self.ran[host])


if __name__ == "__main__":
    answer(pathlib.Path(sys.argv[1]), sys.argv[2])
