# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The state after the next boot: files below a folder, and what systemd says of units."""

import json
import os

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.hosts import cloud_init
from ansible_collections.rosfleet.multimaster.plugins.module_utils._machine import systemd
from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.facts import next_boot

UNIT = "multimaster-sync.service"
FORWARD = {"name": "net.ipv4.ip_forward", "value": "1"}
ROUTE = {"destination": "default", "gateway": "192.168.10.1"}
PLACE = "/etc/network/if-up.d/rosfleet-multimaster"
KEPT = json.dumps(
    {
        "boot": {
            "places": {
                PLACE: {
                    "backend": "ifupdown",
                    "texts": ["one\n"],
                    "routes": [{"destination": "0.0.0.0/0", "gateway": "192.168.10.1", "device": "eth0"}],
                }
            }
        }
    }
)


@pytest.fixture
def files(tmp_path):
    """Files below a root folder, in which systemd runs."""

    def write(**texts):
        for path, text in {"/run/systemd/system/x": "", **texts}.items():
            place = tmp_path / path.lstrip("/")
            place.parent.mkdir(parents=True, exist_ok=True)
            place.write_text(text)
        return str(tmp_path)

    return write


STATES = {
    ("loaded", "enabled", "/etc/systemd/system"): None,
    ("loaded", "static", "/etc/systemd/system"): None,
    ("not-found", "", ""): None,  # the check of services says it
    ("loaded", "disabled", "/etc/systemd/system"): "disabled",
    ("masked", "masked", "/etc/systemd/system"): "masked",
    ("loaded", "masked-runtime", "/etc/systemd/system"): "masked",
    ("loaded", "enabled-runtime", "/etc/systemd/system"): "enabled until the next boot only",
    ("loaded", "enabled", "/run/systemd/system"): "enabled until the next boot only",
    ("loaded", "bad", "/etc/systemd/system"): "bad",
}


@pytest.mark.parametrize("state", STATES)
def test_units(state, monkeypatch):
    load, file_state, folder = state
    unit = {"Id": UNIT, "LoadState": load, "UnitFileState": file_state, "FragmentPath": f"{folder}/{UNIT}"}
    monkeypatch.setattr(systemd, "show", lambda names, properties: systemd.UnitProperties([unit]))
    found = next_boot.units([UNIT])
    expected = STATES[state]
    assert [(row["kind"], row["name"], row["found"]) for row in found] == (
        [] if expected is None else [("unit", UNIT, expected)]
    )


def test_without_units_nobody_is_asked(monkeypatch):
    monkeypatch.setattr(systemd, "show", None)
    assert next_boot.units([]) == []


OURS = "/etc/sysctl.d/90-rosfleet-multimaster.conf"
SETTINGS = {
    "ours": ({OURS: "net.ipv4.ip_forward = 1\n"}, None),
    "a later file": (
        {OURS: "net.ipv4.ip_forward = 1\n", "/etc/sysctl.d/99-x.conf": "# x\nnet/ipv4/ip_forward=0\n"},
        "/etc/sysctl.d/99-x.conf line 2 sets 0",
    ),
    "an earlier file": (
        {OURS: "net.ipv4.ip_forward = 1\n", "/etc/sysctl.d/10-x.conf": "net.ipv4.ip_forward=0\n"},
        None,
    ),
    "another one that serves as well": ({"/etc/sysctl.d/99-x.conf": "net.ipv4.ip_forward=2\n"}, None),
    "with a remark behind it": ({"/etc/sysctl.d/99-x.conf": "net.ipv4.ip_forward = 1 # pass packets on\n"}, None),
    "a remark that the kernel refuses": (
        {"/etc/sysctl.d/99-x.conf": "net.ipv4.ip_forward = 1# on\n"},
        "/etc/sysctl.d/99-x.conf line 1 sets 1# on",
    ),
    "nobody": ({}, "no file sets it"),
}


@pytest.mark.parametrize("case", SETTINGS)
def test_settings(case, files):
    texts, expected = SETTINGS[case]
    found = next_boot.settings([{**FORWARD, "enough": ["2"]}], files(**texts))
    assert [(row["kind"], row["name"], row["expected"], row["found"]) for row in found] == (
        [] if expected is None else [("sysctl", "net.ipv4.ip_forward", "1", expected)]
    )


RECORD = "/var/lib/rosfleet-multimaster/routes.json"
ROUTES = {
    "as written": ({RECORD: KEPT, PLACE: "one\n"}, None),
    "changed": ({RECORD: KEPT, PLACE: "other\n"}, f"{PLACE} was changed"),
    "gone": ({RECORD: KEPT}, f"{PLACE} is not there"),
    "without a record": ({PLACE: "one\n"}, "no record of one"),
    "in a profile of NetworkManager, which is no file of ours": ({RECORD: KEPT.replace(PLACE, "profile")}, None),
}


@pytest.mark.parametrize("case", ROUTES)
def test_routes(case, files):
    texts, expected = ROUTES[case]
    found = next_boot.routes([ROUTE], files(**texts))
    assert [(row["kind"], row["name"], row["found"]) for row in found] == (
        [] if expected is None else [("route", "default by 192.168.10.1", expected)]
    )
    assert next_boot.routes([], files(**texts)) == []


GUARD = cloud_init.FILES
NAMES = {
    "no cloud-init": ({}, None),
    "kept away": ({"/etc/cloud/cloud.cfg": "", **GUARD}, None),
    "not kept away": (
        {"/etc/cloud/cloud.cfg": ""},
        "/etc/rosfleet-multimaster/cloud-init.cfg is not there",
    ),
    "changed": (
        {"/etc/cloud/cloud.cfg": "", **GUARD, cloud_init.CONFIGURATION: "manage_etc_hosts: true\n"},
        "/etc/rosfleet-multimaster/cloud-init.cfg was changed",
    ),
    "disabled": ({"/etc/cloud/cloud-init.disabled": ""}, None),
}


@pytest.mark.parametrize("case", NAMES)
def test_names(case, files):
    texts, expected = NAMES[case]
    found = next_boot.hosts(files(**texts))
    assert [(row["kind"], row["name"], row["found"]) for row in found] == (
        [] if expected is None else [("names", "/etc/hosts", expected)]
    )


def test_all_of_it(files, monkeypatch):
    monkeypatch.setattr(
        systemd,
        "show",
        lambda names, properties: systemd.UnitProperties([{"Id": names[0], "UnitFileState": "disabled"}]),
    )
    root = files(**{"/etc/cloud/cloud.cfg": ""})
    planned = {"settings": [FORWARD], "routes": [ROUTE], "hosts": True}
    assert [row["kind"] for row in next_boot.differences(["sync"], planned, root)] == [
        "unit",
        "sysctl",
        "route",
        "names",
    ]
    assert [row["kind"] for row in next_boot.differences(["sync"], {**planned, "hosts": False}, root)][-1] == "route"


def test_the_file_that_decides_has_the_time_of_its_last_change(files):
    root = files(**{"/etc/sysctl.d/99.conf": "net.ipv4.ip_forward = 0\n"})
    os.utime(f"{root}/etc/sysctl.d/99.conf", (0, 1_000_000_000))
    (row,) = next_boot.differences([], {"settings": [FORWARD], "routes": [], "hosts": False}, root)
    assert (row["file"], row["when"]) == ("/etc/sysctl.d/99.conf line 1", "2001-09-09 01:46:40 UTC")
    assert next_boot.find_change(f"{root}/none") == next_boot.find_change(root) == ""
