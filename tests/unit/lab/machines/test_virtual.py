# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Labs of virtual machines, as far as they need none: places, addresses, and the shell on a console."""

import socket
import subprocess
import sys

import pytest
import vm
from machines import disk, virtual
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


def test_a_bridge_has_a_free_address():
    assert virtual._choose_address("192.168.1.0/24", [ANA]) == "192.168.1.253/24"
    assert [port.gateway for port in ANA.interfaces] == ["192.168.1.1", None]


@pytest.mark.parametrize("table", ["PACKAGES", "HOOKS", "SETUP_HOOKS"])
def test_a_disk_has_another_name_after_a_change(monkeypatch, table):
    before = [disk.Disk(suite).folder for suite in ("bookworm", "trixie")]
    monkeypatch.setattr(disk, table, [*getattr(disk, table), "more"])
    assert len({*before, *(disk.Disk(suite).folder for suite in ("bookworm", "trixie"))}) == 4


@pytest.fixture
def console(tmp_path, monkeypatch):
    """A shell behind a socket, as QEMU gives a console, with something left there of an earlier caller."""
    monkeypatch.setattr(virtual, "SOCKETS", tmp_path)
    virtual._sockets("a").mkdir()
    virtual._socket("a", "ana", "pid").touch()
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(virtual._socket("a", "ana", "shell")))
        server.listen()
        accept = (
            "import socket, subprocess, sys; line = socket.socket(fileno=0).accept()[0]; line.sendall(b'$? 0\\nold'); "
        )
        shell = [sys.executable, "-c", accept + "subprocess.run(['bash', '--norc'], stdin=line, stdout=line)"]
        process = subprocess.Popen(shell, stdin=server.fileno())
        yield lambda command, **more: virtual.run("a", "ana", command, **more)
        process.kill()
        process.wait()


def test_a_command_on_a_console(console):
    assert console("echo one; echo two >&2; printf three") == "one\ntwo\nthree"


def test_a_command_that_fails_is_told(console):
    with pytest.raises(LabError, match="ana: 'echo no; exit 3' ended with 3: no"):
        console("echo no; exit 3")


def test_a_machine_that_is_not_there():
    with pytest.raises(LabError, match="The lab nowhere has no machine ana"):
        virtual.run("nowhere", "ana", "true")
