# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The file that decides a kernel setting at boot: golden trees, and systemd-sysctl itself as the judge of them."""

import json
import os
import pathlib
import shutil
import subprocess

import pytest
import yaml
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.sysctl import boot as sysctl_boot
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.sysctl import plan as sysctl
from hypothesis import given
from hypothesis import strategies as st

CASES = sorted((pathlib.Path(__file__).parents[4] / "fixtures" / "sysctl").glob("*.yml"))
DROP_IN = "/etc/sysctl.d/90-rosfleet-multimaster.conf"
SYSTEMD_SYSCTL = "/lib/systemd/systemd-sysctl"


def plant(root, files):
    """Make a tree of files: a text is a file, {link: target} a symbolic link."""
    for path, content in files.items():
        place = root / path
        place.parent.mkdir(parents=True, exist_ok=True)
        if isinstance(content, str):
            place.write_text(content)
        else:
            place.symlink_to(content["link"])


def load(path, root):
    case = yaml.safe_load(path.read_text())
    plant(root, case["tree"])
    settings = sysctl.settings_of([{"name": name, "value": value} for name, value in case["settings"].items()])
    drop_in = case.get("drop_in", DROP_IN)
    return case, settings, sysctl_boot.Tree(str(root), {drop_in: sysctl.drop_in_text(settings)}), drop_in


def shown(assignment):
    if assignment is None or assignment.value is None:
        return None
    return {"value": sysctl_boot.normal(assignment.value), "file": assignment.file, "line": assignment.line}


@pytest.mark.parametrize("path", CASES, ids=lambda path: path.stem)
def test_what_decides_at_boot(path, tmp_path):
    case, settings, tree, drop_in = load(path, tmp_path)
    boot = sysctl_boot.find_boot_assignments(tree, [setting.key for setting in settings])
    assert {sysctl_boot.name_of(key): shown(decides) for key, decides in boot.items()} == case["boot"]
    foreign = sysctl_boot.find_boot_assignments(tree, [sysctl_boot.key_of(name) for name in case.get("foreign", {})])
    assert {sysctl_boot.name_of(key): shown(decides) for key, decides in foreign.items()} == case.get("foreign", {})
    assert sysctl_boot.find_hiding_file(tree, drop_in) == case.get("hidden_by")
    assert sysctl_boot.boots_with_systemd(tree) == case.get("systemd", True)


@pytest.mark.slow
@pytest.mark.skipif(os.geteuid() != 0 or not os.path.exists(SYSTEMD_SYSCTL), reason="needs root and systemd")
@pytest.mark.parametrize("path", CASES, ids=lambda path: path.stem)
def test_systemd_sysctl_agrees(path, tmp_path):
    """The same trees, applied by systemd-sysctl in a network namespace of its own: every predicted value is there."""
    root, proc = tmp_path / "root", "/proc/sys/"
    root.mkdir()
    case, settings, _tree, drop_in = load(path, root)
    if not case.get("systemd", True) or not case.get("oracle", True):
        pytest.skip("not systemd-sysctl's own doing")
    plant(root, {drop_in.lstrip("/"): sysctl.drop_in_text(settings)})
    for folder in ("etc", "run", "usr/local/lib", "usr/lib/sysctl.d"):
        (root / folder).mkdir(parents=True, exist_ok=True)
    predicted = {**case["boot"], **case.get("foreign", {})}
    keys = {sysctl_boot.key_of(name): name for name in predicted}
    assert all(key.startswith("net/") for key in keys)
    # Everything that systemd-sysctl reads is ours in the namespace, before it runs; /etc/ld.so.cache is not needed.
    script = """
        set -e
        ip link add eth0.100 type dummy 2>/dev/null || ip link add eth0.100 type bridge
        ip link add eth0.200 type bridge; ip link add eth0.300 type bridge
        mount --make-rprivate /
        for folder in etc run usr/local/lib usr/lib/sysctl.d; do mount --bind "$1/$folder" "/$folder"; done
        %s || true
        shift
        for key; do printf '%%s\\t' "$key"; tr '\\t\\n' '  ' <"/proc/sys/$key"; echo; done
    """
    run = ["unshare", "--net", "--mount", "sh", "-c", script % SYSTEMD_SYSCTL, "sh", str(root), *keys]
    before = {key: pathlib.Path(proc + key).read_text() for key in keys if os.path.exists(proc + key)}
    output = subprocess.run(run, check=True, stdout=subprocess.PIPE, text=True, timeout=30).stdout
    held = dict(line.split("\t", 1) for line in output.splitlines())
    assert {key: pathlib.Path(proc + key).read_text() for key in before} == before, "the test changed the host"
    for key, name in keys.items():
        if predicted[name] is not None:
            assert sysctl_boot.normal(held[key]) == predicted[name]["value"], name


@given(st.text(alphabet="ab.0/-_@", min_size=1, max_size=20))
def test_a_name_is_stable_once_it_is_normal(name):
    key = sysctl_boot.key_of(name)
    assert sysctl_boot.key_of(sysctl_boot.name_of(key)) == key or "." in key.partition("/")[0]
    assert "//" not in key and not key.startswith("/") and not key.endswith("/")


@given(st.lists(st.text(alphabet="ab0_-", min_size=1), min_size=1), st.text(alphabet="ab.0", min_size=1))
def test_all_spellings_are_one_key(parts, interface):
    key = "/".join(["net", *parts, interface, "x"])
    if interface.strip("."):
        spellings = [key, "/" + key, sysctl_boot.name_of(key)]
        assert {sysctl_boot.key_of(spelling) for spelling in spellings} == {key}


@pytest.mark.parametrize(
    ("name", "key"),
    [
        ("net.ipv4.ip_forward", "net/ipv4/ip_forward"),
        ("net/ipv4/ip_forward", "net/ipv4/ip_forward"),
        ("net.ipv4.conf.eth0/100.rp_filter", "net/ipv4/conf/eth0.100/rp_filter"),
        ("net/ipv4/conf/eth0.100/rp_filter", "net/ipv4/conf/eth0.100/rp_filter"),
        ("kernel.panic", "kernel/panic"),
    ],
)
def test_key_of(name, key):
    assert sysctl_boot.key_of(name) == key


def test_a_value_is_read_by_the_numbers_of_its_key():
    assert sysctl_boot.read_value("4096 0x20000 6291456 # bytes", "4096 131072 6291456") == "4096 131072 6291456"
    assert sysctl_boot.read_value("4096 131072", "4096 131072 6291456") == "4096 131072"  # the third one would stay
    assert sysctl_boot.read_value("bbr  # a remark", "bbr") == "bbr # a remark"  # the kernel knows no such name
    assert sysctl_boot.read_value("1 # a remark", "") == "1 # a remark"
    assert sysctl_boot.read_value("9" * 10**6, "1") == "9" * 10**6


def test_foreign_lines_are_left_out_and_numbers_stay():
    text = "# c\n\n;c\nnonsense\n a.b = 1 \n-c.d=2\n-e.*.f\r\n.g = \nx/y.z=a=b # c\n"
    assert [tuple(found) for found in sysctl_boot.parse(text, "f")] == [
        ("a/b", "1", "f", 5),
        ("c/d", "2", "f", 6),
        ("e/*/f", None, "f", 7),
        ("g", "", "f", 8),
        ("x/y.z", "a=b # c", "f", 9),
    ]


@given(st.text())
def test_any_text_can_be_parsed(text):
    for found in sysctl_boot.parse(text, "f"):
        assert 1 <= found.line <= text.count("\n") + 1


def test_star_stays_within_one_level():
    assert sysctl_boot.matches("net/*/conf/[a-l]*/rp_filter", "net/ipv4/conf/lo/rp_filter")
    assert not sysctl_boot.matches("net/*/rp_filter", "net/ipv4/conf/lo/rp_filter")


def test_a_file_that_is_not_utf8_is_read(tmp_path):
    plant(tmp_path, {"sbin/init": {"link": "/lib/systemd/systemd"}})
    (tmp_path / "etc/sysctl.d").mkdir(parents=True)
    (tmp_path / "etc/sysctl.d/99-caf\udce9.conf").write_bytes(b"# caf\xe9\nnet.ipv4.ip_forward=0\n")
    found = sysctl_boot.find_boot_assignments(sysctl_boot.Tree(str(tmp_path)), ["net/ipv4/ip_forward"])[
        "net/ipv4/ip_forward"
    ]
    assert (found.value, found.line) == ("0", 2)


def test_links_in_a_circle_end(tmp_path):
    plant(tmp_path, {"etc/sysctl.d/99-a.conf": {"link": "99-b.conf"}, "etc/sysctl.d/99-b.conf": {"link": "99-a.conf"}})
    assert sysctl_boot.find_boot_assignments(sysctl_boot.Tree(str(tmp_path)), ["net/ipv4/ip_forward"]) == {
        "net/ipv4/ip_forward": None
    }


@pytest.mark.skipif(shutil.which("python3.6") is None, reason="needs Python 3.6")
def test_the_oldest_python(tmp_path):
    """The golden cases' parser and planner give the same on Python 3.6."""
    if subprocess.run(["python3.6", "--version"], check=False, stdout=subprocess.PIPE).returncode:
        pytest.skip("needs Python 3.6")
    _case, settings, tree, _drop_in = load(CASES[0], tmp_path)
    collections = str(pathlib.Path(sysctl.__file__).parents[7])
    program = (
        "import json, sys; from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.sysctl import boot as b;"
        "t = b.Tree(sys.argv[1], json.loads(sys.argv[2]));"
        "print(json.dumps({k: list(v) for k, v in b.find_boot_assignments(t, json.loads(sys.argv[3])).items()}))"
    )
    keys = [setting.key for setting in settings]
    output = subprocess.run(
        ["python3.6", "-c", program, str(tmp_path), json.dumps(tree.overlay), json.dumps(keys)],
        check=True,
        stdout=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": collections},
    ).stdout
    assert json.loads(output) == {
        key: list(found) for key, found in sysctl_boot.find_boot_assignments(tree, keys).items()
    }


@pytest.mark.parametrize("folder", ["etc/systemd", "usr/local/lib/systemd", "usr/lib/systemd"])
def test_a_unit_is_enabled_by_a_link_in_any_folder(tmp_path, folder):
    """Of those that systemd.unit(5) names for the units of the system."""
    link = f"{folder}/system/multi-user.target.wants/procps.service"
    assert sysctl_boot.Tree(str(tmp_path)).find_enabling_link("procps.service") is None
    plant(tmp_path, {link: {"link": "/lib/systemd/system/procps.service"}})
    assert sysctl_boot.Tree(str(tmp_path)).find_enabling_link("procps.service") == "/" + link


def test_a_unit_that_is_masked_is_read_as_empty(tmp_path):
    """A link to the real /dev/null, which is no regular file."""
    (tmp_path / "masked.service").symlink_to("/dev/null")
    assert sysctl_boot.Tree("/").read(str(tmp_path / "masked.service")) == ""
