# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The filter service_units: plain data in, units out."""

import re

import pytest
from ansible.errors import AnsibleFilterError
from ansible.utils.display import Display
from ansible_collections.rosfleet.multimaster.plugins.filter.service_units import service_units
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import units

PROGRAMS = {name: {"unit": f"# {name}", "service": f"ExecStart=/{name}"} for name in ("discovery", "sync")}


def made(names):
    return service_units(
        names,
        robot="tibi",
        address="192.168.1.1",
        roscore_command="/usr/bin/roscore",
        roscore_port=11411,
        programs=PROGRAMS,
        environment_digest="4567",
        files=[],
    )


def test_units():
    found = made(["roscore", "sync"])
    assert [unit["name"] for unit in found] == ["multimaster-roscore.service", "multimaster-sync.service"]
    assert "run_plain /usr/bin/roscore -p 11411 " in found[0]["content"]
    assert "\n# sync\n\n[Service]\n" in found[1]["content"] and "\nExecStart=/sync\n" in found[1]["content"]


def test_changed_code_restarts_the_bundled_roscore_alone():
    def inputs(programs, code):
        (unit,) = service_units(
            ["roscore"],
            robot="tibi",
            address="192.168.1.1",
            roscore_command="/usr/bin/roscore",
            roscore_port=11411,
            programs=programs,
            environment_digest="4567",
            files=[
                {
                    "path": f"{units.LIBRARY}/python/rosfleet_multimaster/roscore/master.py",
                    "sha256": code,
                    "mode": "0644",
                }
            ],
        )
        return re.findall("ROSFLEET_INPUTS=(.*)", unit["content"])

    bundled = {**PROGRAMS, "roscore": {"unit": "", "service": "ExecStart=/roscore"}}
    assert inputs(PROGRAMS, "old") == inputs(PROGRAMS, "new") == ["4567"]
    assert inputs(bundled, "old") != inputs(bundled, "new")


def test_the_digests_of_version_1_0_0_restart_the_same_services(monkeypatch):
    warnings = []
    monkeypatch.setattr(Display, "deprecated", lambda self, text, **more: warnings.append(more["version"]))
    programs = {**PROGRAMS, "roscore": {"unit": "", "service": "ExecStart=/roscore"}}
    names = ["address", "roscore", "discovery", "connections", "sync"]

    def inputs(**digests):
        made = service_units(
            names,
            robot="tibi",
            address="192.168.1.1",
            roscore_command="/usr/bin/roscore",
            roscore_port=11411,
            programs=programs,
            environment_digest="4567",
            **digests,
        )
        return {unit["name"]: re.findall("ROSFLEET_INPUTS=(.*)", unit["content"]) for unit in made}

    def restarted(**digests):
        return {name for name, found in inputs(**digests).items() if found != before[name]}

    before = inputs(nodes_digest="0123", code_digest="89ab")
    assert warnings == ["2.0.0"]
    nodes = {f"multimaster-{name}.service" for name in ("discovery", "connections", "sync")}
    assert restarted(nodes_digest="new", code_digest="89ab") == nodes
    assert restarted(nodes_digest="0123", code_digest="new") == {"multimaster-roscore.service"}


def test_no_service():
    assert made([]) == []


def test_an_unknown_service_is_named():
    with pytest.raises(AnsibleFilterError, match="take synk out of services_list"):
        made(["roscore", "synk"])


def test_a_path_that_fits_into_no_unit_is_an_error_of_the_filter():
    with pytest.raises(AnsibleFilterError, match="expected an absolute path"):
        service_units(
            ["roscore"],
            robot="tibi",
            address="192.168.1.1",
            roscore_command="+/bin/sh",
            roscore_port=11311,
            programs=PROGRAMS,
            environment_digest="",
            files=[],
        )


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({"robt": "tibi"}, r"got an unexpected keyword argument 'robt'"),
        ({}, r"missing 6 required .* 'robot', 'address', .* and 'environment_digest'$"),
    ],
)
def test_a_wrong_option_is_told_as_one_of_the_filter(options, told):
    with pytest.raises(TypeError, match=rf"^service_units\(\) {told}"):
        service_units([], **options)
