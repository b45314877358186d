# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""An archive of anybody: read by name and with bounds, and never unpacked."""

import io
import zipfile

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._bundle import archive

TIME = (2026, 11, 22, 14, 2, 0)


def zipped(*members, packing=zipfile.ZIP_DEFLATED):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", packing) as made:
        for name, content in members:
            made.writestr(name, content)
    return stream.getvalue()


def test_what_is_packed_is_read_again():
    data = archive.pack({"a.json": "{}", "logs/x.txt": "ä\n"}, TIME)
    assert archive.unpack(data, ["a.json", "logs/x.txt"]) == {"a.json": "{}", "logs/x.txt": "ä\n"}
    with zipfile.ZipFile(io.BytesIO(data)) as made:
        assert [entry.filename for entry in made.infolist()] == ["rosfleet-bundle/a.json", "rosfleet-bundle/logs/x.txt"]
        assert {entry.external_attr >> 16 for entry in made.infolist()} == {0o600}


@pytest.mark.parametrize("data", [b"", b"PK", b"\x1f\x8b tar", b"PK\x05\x06" + b"\xff" * 18])
def test_what_is_no_archive(data):
    with pytest.raises(archive.UnreadableBundle, match="is no ZIP archive"):
        archive.unpack(data, ["a.json"])


def test_a_member_that_is_missing():
    with pytest.raises(archive.UnreadableBundle, match="has no rosfleet-bundle/a.json"):
        archive.unpack(zipped(("../a.json", "{}"), ("/a.json", "{}")), ["a.json"])


def test_a_bomb_is_not_unpacked(monkeypatch):
    monkeypatch.setattr(archive, "UNPACKED", 1_000_000)
    with pytest.raises(archive.UnreadableBundle, match="unpacks to more than 1 MB"):
        archive.unpack(zipped(("rosfleet-bundle/a.json", b" " * 2_000_000)), ["a.json"])


def test_the_bound_is_of_all_members_together(monkeypatch):
    monkeypatch.setattr(archive, "UNPACKED", 1000)
    with pytest.raises(archive.UnreadableBundle):
        archive.unpack(zipped(*((f"rosfleet-bundle/{name}", b" " * 600) for name in "ab")), ["a", "b"])


def test_a_large_file_is_not_looked_at(monkeypatch):
    monkeypatch.setattr(archive, "LARGEST", 10)
    with pytest.raises(archive.UnreadableBundle, match="has more than"):
        archive.unpack(b" " * 11, [])


def test_a_damaged_member_and_a_packing_that_is_not_ours():
    data = bytearray(zipped(("rosfleet-bundle/a.json", "x" * 500)))
    data[60] ^= 0xFF
    with pytest.raises(archive.UnreadableBundle):
        archive.unpack(bytes(data), ["a.json"])
    with pytest.raises(archive.UnreadableBundle, match="packing"):
        archive.unpack(zipped(("rosfleet-bundle/a.json", "x"), packing=zipfile.ZIP_BZIP2), ["a.json"])
