# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The users of each port: a folder of /proc, and the sentence where the controller would be cut off."""

import os
import random
import socket
import subprocess
import sys

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.firewall import access, packet_filter
from mentioned import mentions
from processes import with_paths

WANTED = packet_filter.PacketFilter(("192.168.1.0/24", "fd00::/8"), (), (packet_filter.OpenPort("tcp", 2222),))


def way(port, peer, program):
    return access.Session(port, peer, program)


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
    assert mentions(sentence, "10.0.0.5", "TCP", "5986", "agent")


def test_a_process_with_a_connection_is_found_among_ancestors():
    """This process serves a real connection, and starts one that looks."""
    program = (
        "from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.firewall import access\n"
        "print([(way.port, way.peer) for way in access.read_access().sessions])"
    )
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        with socket.create_connection(("127.0.0.1", port)), server.accept()[0]:
            done = subprocess.run(
                [sys.executable, "-c", program], stdout=subprocess.PIPE, text=True, check=True, env=with_paths()
            )
    assert f"({port}, '127.0.0.1')" in done.stdout


@pytest.fixture
def ssh_ports(tmp_path, monkeypatch):
    """The ports of ssh for a value of SSH_CONNECTION. Root listens on 2022 and 3022, a user on 5000; each serves 10.0.0.5."""
    monkeypatch.setattr(access.systemd, "show", lambda *_arguments: access.systemd.UnitProperties([]))
    rows = [row(port, "00000000:0000", "0A", uid) for port, uid in ((2022, 0), (3022, 0), (5000, 1000), (65535, 0))]
    rows += [row(port, "0500000A:9C40", "01", 0) for port in (2022, 5000, 4000)]
    (tmp_path / "net").mkdir()
    (tmp_path / "net/tcp").write_text("".join(f"{line}\n" for line in ["  sl  local_address", *rows]))
    six = "000080FE" + "0" * 16 + "01000000"
    (tmp_path / "net/tcp6").write_text(
        f"head\n{row(6022, '0' * 32 + ':0000', '0A', 0)}\n{row(6022, six + ':9C40', '01', 0)}\n"
    )

    def ports(value):
        monkeypatch.setitem(os.environ, "SSH_CONNECTION", value)
        return access.read_access(str(tmp_path)).ssh

    return ports


def row(port, peer, state, uid):
    """A line of /proc/net/tcp."""
    return f"0: 0100A8C0:{port:04X} {peer} {state} 00000000:00000000 00:00000000 00000000 {uid} 0 12345 1"


def test_the_port_that_ssh_names_stays_open(ssh_ports):
    assert ssh_ports("10.0.0.5 40000 192.168.1.229 2022") == [2022]
    assert ssh_ports("fe80::1%eth0 40000 fe80::2%eth0 6022") == [6022]


@pytest.mark.parametrize(
    "value",
    [
        "UNKNOWN 65535 UNKNOWN 65535",  # an ssh server behind a pipe
        "UNKNOWN 65535 192.168.1.229 2022",
        "UNKNOWN 65535 192.168.1.229 65535",
        "10.0.0.5 40000 UNKNOWN 2022",
        "10.0.0.5 40000 192.168.1.229 3022",  # no such connection
        "10.0.0.6 40000 192.168.1.229 2022",
        "10.0.0.5 40000 192.168.1.229 5000",  # a user's program listens there
        "10.0.0.5 40000 192.168.1.229 4000",  # nothing listens there
    ],
)
def test_what_the_environment_alone_says_opens_nothing(ssh_ports, value):
    assert ssh_ports(value) == []


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20))
def test_no_other_text_opens_a_port_or_ends_the_module(ssh_ports, seed):
    """Addresses and ports as they are and as they are not, drawn by a generator: the port opens for the real connection alone."""
    drawn = random.Random(seed)
    addresses = [
        "10.0.0.5",
        "010.0.0.5",
        "10.0.0.5%lo",
        "::ffff:10.0.0.5",
        "10.0.0",
        "",
        "UNKNOWN",
        "10.0.0.5/32",
        "\udcff",
        "x" * 9999,
    ]
    numbers = [
        "2022",
        "02022",
        "+2022",
        "２０２２",
        "2022²",
        "-1",
        "0",
        "65536",
        "9" * 6000,
        "2_022",
        "0x7e6",
        "UNKNOWN",
        "2022\n",
    ]
    for _turn in range(100):
        words = [drawn.choice(kind) for kind in (addresses, numbers, addresses, numbers)]
        drawn.shuffle(words) if drawn.random() < 0.2 else None
        value = " ".join(words[: drawn.choice((4, 4, 4, 4, 3, 2))] + ["2022"] * drawn.choice((0, 0, 0, 1)))
        found = ssh_ports(value)
        assert set(found) <= {2022}
        assert not found or value.split()[0].split("%")[0] == "10.0.0.5" and int(value.split()[3]) == 2022


@pytest.mark.skipif(os.geteuid() != 0, reason="needs a server of root's")
def test_a_real_connection_that_the_environment_names(monkeypatch):
    monkeypatch.setattr(access.systemd, "show", lambda *_arguments: access.systemd.UnitProperties([]))
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        monkeypatch.setitem(os.environ, "SSH_CONNECTION", f"127.0.0.1 40000 127.0.0.1 {port}")
        assert port not in access.read_access().ssh
        with socket.create_connection(("127.0.0.1", port)), server.accept()[0]:
            assert port in access.read_access().ssh


def test_ports_on_which_systemd_listens_for_ssh(monkeypatch):
    units = [
        {"ActiveState": "active", "Listen": "0.0.0.0:2200 (Stream) [::]:2200 (Stream)"},
        {"ActiveState": "inactive", "Listen": "0.0.0.0:2300 (Stream)"},
    ]
    monkeypatch.setattr(access.systemd, "show", lambda *_arguments: access.systemd.UnitProperties(units))
    assert 2200 in access.read_access().ssh
    assert 2300 not in access.read_access().ssh


def test_a_users_program_with_the_name_sshd_opens_nothing(monkeypatch):
    holders = [
        {"port": 2222, "user": "root", "pid": 10},
        {"port": 4444, "user": "robot", "pid": 11},
        {"port": 5555, "user": "root", "pid": 12},
    ]
    monkeypatch.setattr(access.ports, "holders", lambda *_arguments: holders)
    names = {"/proc/10/comm": "sshd\n", "/proc/11/comm": "sshd\n", "/proc/12/comm": "other\n"}
    monkeypatch.setattr(access, "text", names.__getitem__)
    assert access._find_ssh_servers({2222, 4444, 5555}, "/proc") == {2222}
