# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Wrong values of all options of the modules that change a computer: each gives one sentence, and no traceback.

The options are those of the documentation, which ansible-test compares with the argument_spec. All runs are in check mode, in a network
namespace of their own.
"""

import json
import os
import random
import subprocess
import time
from importlib import import_module
from pathlib import Path

import ansible_collections
import pytest
import yaml
from namespaces import why_not

from tests.unit import module_server

MODULES = Path(next(iter(ansible_collections.__path__))) / "rosfleet/multimaster/plugins/modules"
PARTS = ("sysctl", "routes", "hosts_entries", "managed_files", "managed_services", "tunnel")
NAMES = (*PARTS, "firewall", "multimaster_computer", "multimaster_packages", "multimaster_logs_info")
SEEDS = [0, 1, 2, *(pytest.param(seed, marks=pytest.mark.costly) for seed in (3, 4))]
DRAWS = 12  # of one seed

STRANGE = [
    None, True, -1, 0, 1.5, 1e400, 2**31, 2**70, "", " ", "x", "0", "-1", "1e9", "auto", "/", "//", "..", "a/../b", "/proc/x", "/dev/null/x",
    "a\0b", "a\nb", "\ud800", "\udcff", "é\u202e", "%s{0}{{ x }}", "x" * 5000, "y" * 250, "10.0.0.0/8", "fe80::1%lo", "[]", "{}", "=", "u=",
    [], {}, [None], [[]], [{}], [[[]]], ["x", None, 1], {"": ""}, {"a": {"b": None}}, {"path": None}, [True, "a\0b"], b"bytes".hex(),
]  # fmt: skip
USUAL = {
    "settings": [{"name": "net.ipv4.ip_forward", "value": "1"}],
    "routes": [{"destination": "10.9.0.0/16", "gateway": "192.168.7.1", "device": "eth0", "backend": "none"}],
    "entries": [{"address": "192.168.7.2", "names": ["robot"]}],
    "bundle": "example",
    "files": [{"path": "{folder}/etc/example", "content": "x\n", "mode": "0644", "validate": ["true"]}],
    "units": [{"name": "example.service", "content": "[Service]\nExecStart=/bin/true\n"}],
    "members": ["192.168.7.2"],
}
# Where nothing else is asked for, a run reads and plans below a folder.
PLACES = {"records": "{folder}/records", "root": "{folder}", "path": "{folder}/hosts"}

pytestmark = pytest.mark.skipif(bool(why_not()), reason=why_not() or "can run")


def options_of(name):
    """The options of a module, as its documentation has them with its fragments."""
    text = (MODULES / f"{name}.py").read_text(encoding="utf-8")
    own = yaml.safe_load(text.split('DOCUMENTATION = r"""')[1].split('"""')[0])
    options = own.get("options", {})
    for fragment in own["extends_documentation_fragment"]:
        file = import_module(f"ansible_collections.rosfleet.multimaster.plugins.doc_fragments.{fragment.split('.')[2]}")
        shared = yaml.safe_load(file.ModuleDocFragment.DOCUMENTATION).get("options", {})
        options = {key: {**shared.get(key, {}), **options.get(key, {})} for key in shared | options}
    return options


def value_of(chance, name, option, folder):
    """A value that an option may have."""
    if name in PARTS and "suboptions" not in option:  # of multimaster_computer
        own = options_of(name)
        return {key: value_of(chance, key, one, folder) for key, one in own.items() if key in USUAL or key in PLACES}
    if name in USUAL or name in PLACES:
        return json.loads(json.dumps({**USUAL, **PLACES}[name]).replace("{folder}", str(folder)))
    if "suboptions" in option and chance.random() < 0.5:
        item = {
            key: value_of(chance, key, one, folder) for key, one in option["suboptions"].items() if one.get("required")
        }
        return [item] if option["type"] == "list" else item
    kinds = {"bool": True, "int": 3, "float": 1.0, "list": [], "dict": {}}
    return (
        chance.choice(sorted(option["choices"]))
        if "choices" in option
        else option.get("default", kinds.get(option["type"], "x"))
    )


def spoilt(chance, value):
    """The value, with something strange in one place of it."""
    inner = list(value) if isinstance(value, dict) else list(range(len(value))) if isinstance(value, list) else []
    if not inner or chance.random() < 0.25:
        return chance.choice(STRANGE)
    copy = value.copy()  # of a list or an object
    place = chance.choice(inner)
    if isinstance(copy, dict) and chance.random() < 0.1:
        del copy[place]
    else:
        copy[place] = spoilt(chance, value[place])
    return copy


def drawn(chance, name, folder):
    """Arguments of which one or two are strange."""
    own = options_of(name)
    wanted = [key for key, one in own.items() if key in USUAL or key in PLACES or one.get("required") or key in PARTS]
    arguments = {key: value_of(chance, key, own[key], folder) for key in wanted}
    if name == "multimaster_computer" and "managed_files" in arguments:
        arguments.update({key: [arguments[key]] for key in ("managed_files", "managed_services")})
    for key in chance.sample(list(own), chance.choice((1, 1, 2))):
        if key not in PLACES or chance.random() < 0.3:
            arguments[key] = spoilt(chance, arguments.get(key, value_of(chance, key, own[key], folder)))
        else:
            strange = chance.choice([key for key in own if key not in PLACES])
            arguments[strange] = spoilt(chance, arguments.get(strange))
    return arguments


@pytest.fixture(scope="module")
def namespace():
    """A network namespace with one interface."""
    with subprocess.Popen(["unshare", "--net", "sleep", "600"]) as holder:
        try:
            own = os.readlink("/proc/self/ns/net")
            while os.readlink(f"/proc/{holder.pid}/ns/net") == own:
                time.sleep(0.005)
            for words in ("link add eth0 type bridge", "link set eth0 up", "address add 192.168.7.100/24 dev eth0"):
                subprocess.run(["nsenter", f"--net=/proc/{holder.pid}/ns/net", "ip", *words.split()], check=True)
            yield f"/proc/{holder.pid}/ns/net"
        finally:
            holder.kill()


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", NAMES)
def test_a_wrong_option_is_one_sentence(name, seed, namespace, tmp_path):
    chance = random.Random(f"{name} {seed}")
    many = [{**drawn(chance, name, tmp_path), "_ansible_check_mode": True} for _draw in range(DRAWS)]
    for arguments, done in zip(many, module_server.at_once(name, many, namespace), strict=True):
        assert "Traceback" not in done.stdout + done.stderr, (arguments, done)
        result = json.loads(done.stdout)
        assert result.get("exception") is None, (arguments, result)
        if result.get("failed"):
            assert result["msg"].strip() and "\n" not in result["msg"], (arguments, result)
    assert not any(tmp_path.iterdir())
