# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The messages are those of multimaster_fkie exactly where their md5 sums are: nodes of both then share a roscore."""

import hashlib
import importlib.util
import pathlib
import re

import pytest

NODES = pathlib.Path(__file__).parents[3] / "roles/nodes/files"

PACKAGE = NODES / "share/fkie_multimaster_msgs"
CLASSES = NODES / "python/fkie_multimaster_msgs"
MD5 = {
    "msg/LinkState": "fd2554dabc9a5d69f4842dd42dd3e0f3",
    "msg/LinkStatesStamped": "36d101076ab31009020bc3d52fdd6264",
    "msg/ROSMaster": "0789d85e02ce55a78b1df2459150a275",
    "msg/MasterState": "d25ba81effb888c4150d378d8adedb03",
    "msg/SyncTopicInfo": "1b296160d6f5a9d7f6550f6130da2ba4",
    "msg/SyncServiceInfo": "8c21bb9ea24403924441840b8c167c40",
    "msg/SyncMasterInfo": "ba4b02792114bcc4bae507c60dd14d66",
    "srv/DiscoverMasters": "31a962d97ea3e3c12d428ff4786f124b",
    "srv/GetSyncInfo": "d5261ec56e202860a07fb47b41e1b2a8",
}
HEADER = "2176decaecbce78abc3b96ef049fabed"  # std_msgs/Header


def text_of(definition):
    """ROS's normal form of a definition, from which its md5 sum is made: constants first, other messages by their sum."""
    constants, fields = [], []
    for line in definition.splitlines():
        line = line.split("#")[0].strip()
        if "=" in line:
            constants.append(line)
        elif line:
            kind, name = line.split()
            base = kind[: -len("[]")] if kind.endswith("[]") else kind
            if base == "Header":
                kind = HEADER
            elif (PACKAGE / f"msg/{base}.msg").exists():
                kind = md5_of(f"msg/{base}")
            fields.append(f"{kind} {name}")
    return "\n".join(constants + fields)


def md5_of(name):
    kind = name.split("/")[0]
    definition = (PACKAGE / f"{name}.{kind}").read_text(encoding="utf-8")
    parts = re.split(r"^---$", definition, flags=re.M)
    return hashlib.md5("".join(text_of(part) for part in parts).encode()).hexdigest()


@pytest.mark.parametrize("name", MD5)
def test_definition_and_class_have_upstreams_md5_sum(name):
    assert md5_of(name) == MD5[name]
    kind, base = name.split("/")
    source = (CLASSES / kind / f"_{base}.py").read_text(encoding="utf-8")
    assert re.findall(r'_md5sum = ["\'](\w+)["\']', source)[-1] == MD5[name]


def test_every_definition_has_its_class_and_no_other():
    names = {f"{path.parent.name}/{path.stem}" for path in PACKAGE.glob("*/*.*")}
    classes = {f"{path.parent.name}/{path.stem[1:]}" for path in CLASSES.glob("*/_[A-Z]*.py")}
    assert names == classes == set(MD5)


@pytest.mark.skipif(importlib.util.find_spec("genpy") is None, reason="genpy is not installed here")
def test_a_message_comes_back_from_its_bytes():
    from io import BytesIO

    from fkie_multimaster_msgs.msg import MasterState, ROSMaster

    sent = MasterState(state=MasterState.STATE_NEW, master=ROSMaster(name="a", uri="http://a:11311/", online=True))
    buffer = BytesIO()
    sent.serialize(buffer)
    assert MasterState().deserialize(buffer.getvalue()) == sent
