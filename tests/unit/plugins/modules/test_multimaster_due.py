# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The module multimaster_due, on files of a temporary folder: due exactly where the module itself has anything to do."""

import hashlib
import os

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._changes import managed_files
from ansible_collections.rosfleet.multimaster.plugins.module_utils._computer import concerns
from ansible_collections.rosfleet.multimaster.plugins.module_utils._computer.concerns import CONCERNS
from ansible_collections.rosfleet.multimaster.plugins.module_utils._hosts import run as hosts_entries
from ansible_collections.rosfleet.multimaster.plugins.modules import multimaster_due
from ansible_collections.rosfleet.multimaster.plugins.modules.multimaster_due import looked_at

NOTHING = {
    "sysctl": None,
    "routes": None,
    "hosts_entries": None,
    "managed_files": [],
    "managed_services": [],
    "other": [],
}


@pytest.fixture(name="options")
def _options(tmp_path):
    return {
        "bundle": "example",
        "files": [{"path": str(tmp_path / "etc/names"), "content": "kobuki1\n", "mode": "0644"}],
        "records": str(tmp_path / "records"),
    }


def apply(options):
    """Let the module managed_files do its work."""
    files = [{"validate": [], **file} for file in options["files"]]
    managed_files.ManagedFiles({"brief": [], **options, "files": files}, multimaster_due.no_command).apply()


def due(tmp_path, **given):
    return looked_at({**NOTHING, **given}, switches=str(tmp_path / "run"))[0]


def summed(options):
    """The options with digests in place of contents."""
    files = [{**file, "sha256": hashlib.sha256(file["content"].encode()).hexdigest()} for file in options["files"]]
    return {**options, "files": [{name: file[name] for name in ("path", "mode", "sha256")} for file in files]}


def test_nothing_that_was_asked_for_is_not_due(tmp_path):
    assert due(tmp_path) == []


@pytest.mark.parametrize("other", [["x"], [[], {"a": 1}], [True]])
def test_what_the_controller_knows_counts(tmp_path, other):
    assert due(tmp_path, other=other) == ["other"]
    assert due(tmp_path, other=[[], "", False, 0, None]) == []


@pytest.mark.parametrize("form", [dict, summed], ids=["contents", "digests"])
def test_files_are_due_until_they_are_there_and_again_after_drift(tmp_path, options, form):
    given = form(options)
    assert due(tmp_path, managed_files=[given]) == ["managed_files"]
    apply(options)
    assert due(tmp_path, managed_files=[given]) == []
    path = options["files"][0]["path"]
    os.chmod(path, 0o600)
    assert due(tmp_path, managed_files=[given]) == ["managed_files"]
    apply(options)
    with open(path, "a", encoding="utf-8") as stream:
        stream.write("by hand\n")
    assert due(tmp_path, managed_files=[given]) == ["managed_files"]


def test_a_bundle_that_lost_a_file_is_due(tmp_path, options):
    apply(options)
    assert due(tmp_path, managed_files=[{**options, "files": []}]) == ["managed_files"]


def test_what_a_killed_run_left_is_due(tmp_path, options):
    apply(options)
    record = tmp_path / "records/files-example.json"
    neighbour = record.with_name(f"{record.name}{managed_files.files.atomic._NEIGHBOUR}-x")
    neighbour.write_text("half", encoding="utf-8")
    assert due(tmp_path, managed_files=[options]) == ["managed_files"]
    neighbour.unlink()
    assert due(tmp_path, managed_files=[options]) == []
    text = record.read_text(encoding="utf-8")
    record.write_text(text.replace('"written"', '"writing"'), encoding="utf-8")
    assert due(tmp_path, managed_files=[options]) == ["managed_files"]


def test_one_of_several_bundles_is_enough(tmp_path, options):
    apply(options)
    other = {**options, "bundle": "other", "files": [{**options["files"][0], "path": str(tmp_path / "new")}]}
    assert due(tmp_path, managed_files=[options, other]) == ["managed_files"]


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("sysctl", {"settings": [{"name": "a.b", "value": 1}], "on_conflict": "mend"}),
        ("routes", {"routes": [{"gateway": "192.168.1.1"}]}),
        ("hosts_entries", {"entries": [], "path": "relative"}),
        ("managed_services", [{"units": []}]),
        ("managed_files", [{"bundle": "a/b", "files": []}]),
    ],
)
def test_wrong_options_are_due_so_that_the_module_says_the_sentence(tmp_path, name, options):
    assert due(tmp_path, **{name: options}) == [name]


@pytest.mark.parametrize("concern", [concern for concern in CONCERNS if concern.guarded], ids=lambda one: one.name)
def test_a_switch_that_nobody_confirmed_is_due(tmp_path, concern):
    os.makedirs(tmp_path / "run" / f"rollback-{concern.name}")
    assert due(tmp_path, **{concern.name: {}}) == [concern.name]


class _Run:
    """A run that warns and has nothing to do."""

    due, refusals, warnings = False, [], ["There is a second default route."]

    def __init__(self, options):
        pass


def concern_of(run):
    return concerns.Concern("routes", lambda: concerns.Code({}, lambda options, memory, tools: run(options)))


def test_a_warning_goes_on_and_is_not_due(tmp_path):
    concern = concern_of(_Run)
    assert looked_at({**NOTHING, "routes": {}}, [concern], str(tmp_path)) == ([], _Run.warnings)


def test_a_refusal_is_due(tmp_path):
    concern = concern_of(type("Refusing", (_Run,), {"refusals": ["No."]}))
    assert looked_at({**NOTHING, "routes": {}}, [concern], str(tmp_path)) == (["routes"], [])


def test_bindings_are_due_until_the_file_has_them(tmp_path):
    path = tmp_path / "hosts"
    path.write_text("127.0.0.1 localhost\n", encoding="utf-8")
    options = {
        "entries": [{"address": "192.168.1.229", "names": ["kobuki1computer"]}],
        "path": str(path),
        "records": str(tmp_path / "records"),
    }
    assert due(tmp_path, hosts_entries=options) == ["hosts_entries"]
    run = hosts_entries.Run(
        {"own_name": "x", "backup": False, "on_conflict": "fail", **options}, multimaster_due.no_backup
    )
    run.apply()
    assert due(tmp_path, hosts_entries=options) == []
    path.write_text(path.read_text(encoding="utf-8") + "192.168.1.7 kobuki1computer\n", encoding="utf-8")
    assert due(tmp_path, hosts_entries=options) == ["hosts_entries"]
