# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Who comes in by which port: a folder of /proc, and the sentence where the controller would be cut off."""

import os
import socket
import subprocess
import sys

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._firewall import access, wanted

WANTED = wanted.Wanted(("192.168.1.0/24", "fd00::/8"), (), (wanted.Port("tcp", 2222),))


def way(port, peer, program):
    return access.Way(access.Connection(port, peer, "1"), program)


@pytest.mark.parametrize(
    "found",
    [
        way(22, "10.0.0.5", "sshd"),
        way(443, "10.0.0.5", "agent"),
        way(2222, "10.0.0.5", "sshd"),
        way(5986, "192.168.1.7", "agent"),
        way(5986, "fd00::1", "agent"),
        way(5986, "127.0.0.1", "agent"),
    ],
)
def test_a_way_that_stays_open(found):
    assert access.Access([], [found]).refusal(WANTED) == ""


def test_a_way_that_would_be_closed_is_refused():
    sentence = access.Access([], [way(5986, "10.0.0.5", "agent")]).refusal(WANTED)
    assert sentence.startswith(
        "The controller at 10.0.0.5 reaches this computer on TCP port 5986 of agent, which is no ssh server"
    )


def test_a_process_that_serves_a_connection_is_found_among_the_ancestors():
    """This process serves a real connection, and starts one that looks."""
    program = f"import sys; sys.path[:0] = {sys.path!r}\n" + (
        "from ansible_collections.rosfleet.multimaster.plugins.module_utils._firewall import access\n"
        "print([(way.connection.port, way.connection.peer) for way in access.look().ways])"
    )
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        with socket.create_connection(("127.0.0.1", port)), server.accept()[0]:
            done = subprocess.run([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True, check=True)
    assert f"({port}, '127.0.0.1')" in done.stdout


def test_the_port_that_ssh_names_stays_open(monkeypatch):
    monkeypatch.setattr(access.systemd, "show", lambda *_arguments: access.systemd.Shown([]))
    monkeypatch.setitem(os.environ, "SSH_CONNECTION", "10.0.0.5 40000 192.168.1.229 2022")
    assert 2022 in access.look().ssh


def test_an_ssh_server_behind_a_pipe_names_no_port(monkeypatch):
    monkeypatch.setattr(access.systemd, "show", lambda *_arguments: access.systemd.Shown([]))
    monkeypatch.setitem(os.environ, "SSH_CONNECTION", "UNKNOWN 65535 UNKNOWN 65535")
    assert 65535 not in access.look().ssh


def test_ports_on_which_systemd_listens_for_ssh(monkeypatch):
    units = [
        {"ActiveState": "active", "Listen": "0.0.0.0:2200 (Stream) [::]:2200 (Stream)"},
        {"ActiveState": "inactive", "Listen": "0.0.0.0:2300 (Stream)"},
    ]
    monkeypatch.setattr(access.systemd, "show", lambda *_arguments: access.systemd.Shown(units))
    assert 2200 in access.look().ssh
    assert 2300 not in access.look().ssh


def test_a_program_of_a_user_that_calls_itself_sshd_opens_nothing(monkeypatch):
    holders = [
        {"port": 2222, "user": "root", "pid": 10},
        {"port": 4444, "user": "robot", "pid": 11},
        {"port": 5555, "user": "root", "pid": 12},
    ]
    monkeypatch.setattr(access.ports, "holders", lambda *_arguments: holders)
    monkeypatch.setattr(access, "_name", lambda pid, _proc: {10: "sshd", 11: "sshd", 12: "other"}[pid])
    assert access._listeners({2222, 4444, 5555}, "/proc") == {2222}
