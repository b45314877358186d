# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The filter package_changes: what multimaster_info found in, what the role nodes takes out."""

from ansible_collections.rosfleet.multimaster.plugins.filter.package_changes import package_changes


def found(name, installed="", ours=False):
    return {"name": name, "installed": installed, "candidate": "1", "ours": ours}


def test_packages():
    changes = package_changes(["a", "b"], [found("a", "1"), found("b"), found("c", "1", ours=True)])
    assert (changes["new"], changes["leftover"]) == (["b"], ["c"])
    assert changes["files"][0]["path"] == "/etc/rosfleet-multimaster/packages"
    assert changes["files"][0]["content"].splitlines()[1:] == ["b"]


def test_no_packages():
    assert package_changes([], []) == {"new": [], "leftover": [], "files": []}
