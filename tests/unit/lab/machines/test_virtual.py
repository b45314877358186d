# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Labs of virtual machines, as far as they need none: places and addresses."""

import pytest
import vm
from machines import kinds, virtual
from machines.layout import Host
from machines.podman import LabError

ANA = vm.make_host("ana", ["192.168.1.254/24", "10.0.0.1/24"], "networkd", "trixie")


def test_a_lab_has_a_folder_of_its_own(tmp_path, monkeypatch):
    """A lab removes its own folder, and never that of all labs."""
    monkeypatch.setattr(virtual, "SOCKETS", tmp_path / "labs")
    monkeypatch.setattr(virtual, "WORK", tmp_path / "work")
    other = tmp_path / "labs" / "other" / "ssh"
    other.mkdir(parents=True)
    virtual._sockets("a").mkdir()
    assert virtual.list_labs() == ["a"]
    virtual.take_down("a")
    assert other.exists() and virtual.list_labs() == []


def test_a_lab_knows_what_its_computers_are(tmp_path, monkeypatch):
    monkeypatch.setattr(virtual, "SOCKETS", tmp_path)
    virtual._sockets("a").mkdir()
    assert kinds.kind_of("a") is kinds.KINDS["machine"]
    assert kinds.kind_of("b") is kinds.KINDS["container"]


def test_a_mount_is_refused_before_anything_is_made(tmp_path, monkeypatch):
    monkeypatch.setattr(virtual, "SOCKETS", tmp_path)
    with pytest.raises(LabError, match="mounts"):
        virtual.bring_up("a", [Host("ana", (), mounts=("/etc:/mnt",))])
    assert virtual.list_labs() == []


def test_a_bridge_has_a_free_address():
    assert virtual._choose_address("192.168.1.0/24", [ANA]) == "192.168.1.253/24"
    assert [port.gateway for port in ANA.interfaces] == ["192.168.1.1", None]


def test_a_machine_that_is_not_there():
    with pytest.raises(LabError, match="The lab nowhere has no machine ana"):
        virtual.run("nowhere", "ana", "true")
