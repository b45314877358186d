# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The program that ends connections, as its unit runs it, with real connections in a network namespace of its own."""

import json
import os
import pathlib
import subprocess
import sys
import textwrap

import pytest
from processes import with_paths
from rosfleet_multimaster.edge import connections

NODES = pathlib.Path(__file__).parents[3] / "roles/nodes/files/python"
MEMBER, STRANGER, OWN = "192.0.2.9", "192.0.2.66", "192.0.2.1"


def can_end():
    try:
        connections.check()
    except OSError:
        return False
    return True


needs_root = pytest.mark.skipif(os.geteuid() != 0 or not can_end(), reason="needs CAP_NET_ADMIN")

IN_A_NAMESPACE = textwrap.dedent(
    """
    import errno, json, os, socket, subprocess, sys, time
    nodes, folder = sys.argv[1:]
    from rosfleet_multimaster.sync import connection_ender as ender

    START = "import sys; sys.path.insert(0, sys.argv[1]); from rosfleet_multimaster.end_connections import main; main(*sys.argv[2:])"
    path = folder + "/socket"
    program = subprocess.Popen(
        [sys.executable, "-I", "-B", "-c", START, nodes, folder + "/master_sync.json", path], stderr=subprocess.DEVNULL
    )
    until = time.monotonic() + 20
    while True:
        try:
            ender.ask([], path)
            break
        except OSError:
            assert time.monotonic() < until
            time.sleep(0.05)

    def begun(address, port, count=1):
        made = []
        for _count in range(count):
            waiting = socket.socket()
            waiting.setblocking(False)
            assert waiting.connect_ex((address, port)) == errno.EINPROGRESS
            made.append(waiting)
        return made

    wanted = {port: begun(address, port) for address, port in WANTED}
    server = socket.create_server(("192.0.2.1", 40010))
    wanted[40010] = [socket.create_connection(server.getsockname())]
    try:
        ended = {remote[1] for _here, remote in ender.end(lambda found: True, path)}
        errors = {port: made[0].getsockopt(socket.SOL_SOCKET, socket.SO_ERROR) for port, made in wanted.items()}

        begun_many = begun("192.0.2.9", 40001, 400)
        started, many = time.monotonic(), 0
        while many < 400:
            many += len(ender.end(lambda found: found.remote[1] == 40001, path))
        took = time.monotonic() - started

        os.chmod(folder, 0o755)
        os.chmod(path, 0o666)
        if os.fork() == 0:
            os.setgid(65534)
            os.setuid(65534)
            try:
                ender.ask([], path)
            except OSError:
                os._exit(7)
            os._exit(0)
        stranger = os.waitstatus_to_exitcode(os.wait()[1])
    finally:
        program.kill()
    print(json.dumps([sorted(ended), errors, took, stranger]))
    """
)


@pytest.mark.slow
@needs_root
def test_only_connections_with_the_fleet_are_ended(tmp_path):
    robot = {
        "robot": "robot2",
        "name": "robot2",
        "uris": ["http://robot2:11311/"],
        "rpc_port": 11611,
        "addresses": [MEMBER],
        "hosts": ["robot2", MEMBER, OWN],
    }
    (tmp_path / "master_sync.json").write_text(json.dumps({"members": [robot], "strangers": "allow"}))
    wanted = [(MEMBER, 40000), (MEMBER, 22), (MEMBER, 11311), (MEMBER, 11611), (STRANGER, 40005)]
    commands = "ip link set lo up && ip link add d0 type veth peer name d1 && ip link set d1 up"
    commands += f" && ip addr add {OWN}/24 dev d0 && ip link set d0 up"
    for number, address in enumerate((MEMBER, STRANGER)):
        commands += f" && ip neigh add {address} lladdr 02:00:00:00:00:0{number} dev d0 nud permanent"
    script = IN_A_NAMESPACE.replace("WANTED", repr(wanted))
    words = ["unshare", "--net", "sh", "-c", commands + ' && exec "$@"', "sh", sys.executable, "-c", script]
    done = subprocess.run(
        [*words, str(NODES), str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        env=with_paths(),
    )
    assert done.returncode == 0, done.stderr
    ended, errors, took, stranger = json.loads(done.stdout)
    assert ended == [40000]
    assert {port for port, error in errors.items() if error} == {"40000"}
    assert 400 / 256 - 0.6 < took < 20
    assert stranger == 7


def test_without_the_right_it_says_so():
    """The process answers all the same: the reason is said to whoever asks."""
    script = textwrap.dedent(
        """
        import os, sys
        from rosfleet_multimaster import end_connections
        from rosfleet_multimaster.protocol.members import Members

        if os.geteuid() == 0:
            os.setgid(65534)
            os.setuid(65534)
        print(end_connections.answer(Members(), end_connections._problem(), []).problem)
        """
    )
    words = [sys.executable, "-c", script]
    done = subprocess.run(words, capture_output=True, text=True, timeout=30, check=False, env=with_paths())
    assert "connections cannot be ended here (CAP_NET_ADMIN" in done.stdout, done.stderr
