# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""/etc/hosts as people and their programs have it: lines come and go, and nothing of others changes."""

import json
import os
import subprocess

import field
import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.hosts.bindings import bindings_of, parse
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.hosts.plan import plan
from hypothesis import example, given
from hypothesis import strategies as st
from namespaces import why_not

ENTRIES = [
    {"address": "192.168.1.50", "names": ["robot"]},
    {"address": "192.168.1.51", "names": ["turtle", "turtle_1"]},
    {"address": "10.20.0.3", "names": ["arm", "robot-arm.local"]},
    {"address": "fd00::7", "names": ["base"]},
    {"address": "192.168.1.9", "names": ["base"]},
]
FLEETS = st.lists(st.sampled_from(ENTRIES), unique_by=lambda entry: entry["address"]).map(bindings_of)
BLOCKS = {
    "ansible_block": (b"# BEGIN ANSIBLE MANAGED BLOCK\n", b"# END ANSIBLE MANAGED BLOCK\n"),
    "ansible_two_blocks": (b"# BEGIN ANSIBLE MANAGED BLOCK: cluster\n", b"# END ANSIBLE MANAGED BLOCK: cluster\n"),
    "docker_desktop": (b"# Added by the container engine\n", b"# End of section\n"),
    "vagrant": (b"## hostmanager-start id: 4f6e2a\n", b"## hostmanager-end\n"),
    "ad_blocker": (b"# Start of the blocklist", b"# End of the blocklist\n"),
}


def block_of(name):
    content, (first, last) = field.read("hosts")[name], BLOCKS[name]
    return content[content.index(first) : content.index(last) + len(last)]


@given(content=field.mixtures("hosts"), fleet=FLEETS, later=FLEETS)
@field.tries()
def test_a_file_settles_comes_back_to_the_byte_and_keeps_lines_of_others(content, fleet, later):
    applied = plan(content, fleet).content
    assert plan(applied, fleet).content == applied
    assert plan(applied, []).content == content
    changed = plan(applied, later).content
    assert plan(changed, later).content == changed and plan(changed, []).content == content
    rest = iter(content.split(b"\n"))
    assert all(line in rest for line in applied.split(b"\n") if b"# rosfleet.multimaster" not in line)


@given(
    before=field.mixtures("hosts", most=3),
    names=st.lists(st.sampled_from(sorted(BLOCKS)), min_size=1, max_size=3),
    after=field.mixtures("hosts", most=3),
    fleet=FLEETS,
    later=FLEETS,
)
@example(before=b"127.0.0.1 localhost\n", names=["ansible_block"], after=b"", fleet=bindings_of(ENTRIES[1:3]), later=[])
@field.tries()
def test_no_line_comes_into_a_block_of_another_program(before, names, after, fleet, later):
    blocks = [block_of(name) for name in names]
    content = before.rstrip(b"\r\n") + b"\n" + b"".join(blocks) + after
    applied = plan(content, fleet).content
    for wanted in (applied, plan(applied, later).content):
        assert all(block in wanted for block in blocks)


@pytest.mark.parametrize("name", sorted(field.read("hosts")))
def test_what_is_told_is_so(name):
    """Each line that a report names has the text, the name and the address that it says."""
    content, fleet = field.read("hosts")[name], bindings_of(ENTRIES)
    made = plan(content, fleet)
    before, lines = content.split(b"\n"), made.content.split(b"\n")
    for entry in made.entries:
        host = parse(lines[entry["line"] - 1])
        assert (str(host.address), set(entry["names"]) <= set(host.names)) == (entry["address"], True)
    for conflict in made.conflicts:
        host = parse(before[conflict["line"] - 1])
        assert (str(host.address), conflict["name"].lower() in [one.lower() for one in host.names]) == (
            conflict["found"],
            True,
        )
    for replaced in made.replaced:
        assert replaced["before"].encode() in content


# libc of this computer, in a mount namespace with each file as /etc/hosts.
ASK = """
import json, socket, subprocess, sys
answers = []
for path, names in json.load(sys.stdin):
    subprocess.run(["mount", "--bind", path, "/etc/hosts"], check=True)
    found = {}
    for name, family in names:
        try:
            found[name] = socket.getaddrinfo(name, None, socket.AF_INET6 if family == 6 else socket.AF_INET)[0][4][0]
        except OSError:
            found[name] = ""
    subprocess.run(["umount", "/etc/hosts"], check=True)
    answers.append(found)
print(json.dumps(answers))
"""


@pytest.mark.root
@pytest.mark.skipif(bool(why_not()), reason=why_not())
def test_libc_answers_the_planned_addresses(tmp_path):
    """Names for which a line of others has another address are left out: the report names each as a conflict."""
    fleet, asked, expected = bindings_of(ENTRIES[:3]), [], []
    for name, content in field.read("hosts").items():
        made = plan(content, fleet)
        shadowed = {conflict["name"].lower() for conflict in made.conflicts}
        names = {one: str(binding.address) for binding in fleet for one in binding.names if one not in shadowed}
        path = tmp_path / name
        path.write_bytes(made.content)
        path.chmod(0o644)
        asked.append([str(path), [[one, 4] for one in names]])
        expected.append(names)
    words = ["unshare", "--mount", "/usr/bin/python3", "-c", ASK]
    answer = subprocess.run(
        words, input=json.dumps(asked), capture_output=True, text=True, check=True, env=dict(os.environ)
    )
    assert json.loads(answer.stdout) == expected
