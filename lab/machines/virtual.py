# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Labs of virtual machines: a kernel and an udev of their own, carriers that can be lost, power that can be cut.

The networks are bridges in a network namespace of the lab. Nothing leads out of it. The bridges have an address in each
network, the last free one, by which ssh enters a machine. A shell on a console of virtio works without any network.
"""

from __future__ import annotations

import base64
import contextlib
import ipaddress
import json
import os
import re
import secrets
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from machines import disk, root_files
from machines.layout import Host
from machines.podman import CHECKOUT, WORK, LabError
from machines.signals import defer_signals, exit_on_signals

SOCKETS = Path("/run/rosfleet-lab")
BOOT_SECONDS = 600.0  # without KVM, on a busy machine; else it takes 30
MEMORY = 512  # MB

# tb-size: MB of translated code; without it the host needs 970 MB for each machine, with it 400 to 590.
MACHINE = f"""
-M q35 -accel tcg,thread=multi,tb-size=128 -cpu max -smp 1 -m {MEMORY} -nodefaults -display none -daemonize
-device virtio-rng-pci
""".split()

# A shell on a console, whatever the network and its filters are; and patience, if the machine is slow.
UNIT = """[Unit]
Description=Shell for the lab

[Service]
ExecStart=/bin/sh -c 'stty raw -echo; exec bash --norc'
StandardInput=tty
StandardOutput=tty
StandardError=journal
TTYPath=/dev/hvc0
Restart=always
"""
OWN = {
    "etc/systemd/system/lab-shell.service": UNIT,
    "etc/systemd/system.conf.d/lab.conf": "[Manager]\nDefaultTimeoutStartSec=600\n",
}
LINKS = {
    "etc/systemd/system/multi-user.target.wants/lab-shell.service": "../lab-shell.service",
    "etc/systemd/system/serial-getty@hvc0.service": "/dev/null",  # that of systemd 257 would take the console
    "etc/systemd/system/user@0.service": "/dev/null",  # it takes 13 s of an emulated processor, at each connection
}


def namespace(lab: str) -> str:
    """The name of a lab's network namespace."""
    return f"rosfleet-{CHECKOUT}-{lab}"


def _folder(lab: str) -> Path:
    """The folder of a lab's disks."""
    return WORK / lab / "machines"


def _sockets(lab: str) -> Path:
    """The folder of a lab's sockets, and of the process ids of its machines."""
    return SOCKETS / f"{CHECKOUT}-vm-{lab}"


def _socket(lab: str, host: str, name: str) -> Path:
    return _sockets(lab) / f"{host}.{name}"


def _command(lab: str, host: str) -> Path:
    """The file with the command that starts a machine."""
    return _folder(lab) / f"{host}.json"


def _call(*words: str, check: bool = True) -> str:
    done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
    if check and done.returncode:
        raise LabError(f"'{shlex.join(words)}' failed: {done.stderr.strip()}")
    return done.stdout


# Networks


def _networks(hosts: Sequence[Host]) -> list[str]:
    return list(dict.fromkeys(port.network for host in hosts for port in host.interfaces))


def _choose_address(network: str, hosts: Sequence[Host]) -> str:
    """The last free address of a network: that of its bridge."""
    net = ipaddress.ip_network(network)
    taken = {ipaddress.ip_interface(port.address).ip for host in hosts for port in host.interfaces}
    last = int(net.broadcast_address) - 1
    return next(
        f"{address}/{net.prefixlen}"
        for address in (ipaddress.ip_address(number) for number in range(last, last - len(taken) - 1, -1))
        if address not in taken
    )


def _make_networks(lab: str, hosts: Sequence[Host]) -> None:
    name = namespace(lab)
    _call("ip", "netns", "add", name)
    lines = ["link set lo up"]
    networks = _networks(hosts)
    for number, network in enumerate(networks):
        lines += [
            f"link add br{number} type bridge",
            f"address add {_choose_address(network, hosts)} dev br{number} nodad",
        ]
        lines.append(f"link set br{number} up")
    for index, host in enumerate(hosts):
        for number, port in enumerate(host.interfaces):
            tap = f"tap{index}.{number}"
            lines += [f"tuntap add {tap} mode tap", f"link set {tap} master br{networks.index(port.network)} up"]
    for line in lines:
        _call("ip", "-n", name, *line.split())


# Machines


def _start(lab: str, hosts: Sequence[Host], index: int) -> None:
    host, folder = hosts[index], _folder(lab)
    parts = disk.ensure(host.suite, host.disk)
    layer, files = folder / f"{host.name}.qcow2", folder / f"{host.name}.tar"
    if not layer.exists():
        _call("qemu-img", "create", "-q", "-f", "qcow2", "-F", "raw", "-b", str(parts / "root.ext4"), str(layer))
        own = root_files.list_files(host, {**OWN, "etc/hostname": f"{host.name}\n"})
        files.write_bytes(root_files.pack(own, {**LINKS, **root_files.list_links(host)}))
    words = [
        *("ip", "netns", "exec", namespace(lab), "qemu-system-x86_64", *MACHINE),
        *("-kernel", str(parts / "vmlinuz"), "-initrd", str(parts / "initrd.img")),
        *("-append", "root=/dev/vda rw net.ifnames=0 console=ttyS0 quiet init=/usr/sbin/lab-init"),
        # What the machine has asked to be on its disk is there when the emulator is killed: not so with cache=unsafe.
        *(
            "-drive",
            f"file={layer},if=virtio,cache=writeback",
            "-drive",
            f"file={files},if=virtio,format=raw,readonly=on",
        ),
        *("-serial", f"file:{folder / host.name}.log"),
        *("-chardev", f"socket,id=shell,path={_socket(lab, host.name, 'shell')},server=on,wait=off"),
        *("-device", "virtio-serial-pci", "-device", "virtconsole,chardev=shell"),
        *("-qmp", f"unix:{_socket(lab, host.name, 'qmp')},server=on,wait=off"),
        *("-pidfile", str(_socket(lab, host.name, "pid"))),
    ]
    for number, port in enumerate(host.interfaces):
        mac = f"52:54:00:{index:02x}:{number:02x}:01"
        words += ["-netdev", f"tap,id={port.name},ifname=tap{index}.{number},script=no,downscript=no"]
        words += ["-device", f"virtio-net-pci,id={port.name}-device,netdev={port.name},mac={mac},romfile="]
    _command(lab, host.name).write_text(json.dumps(words))
    _call(*words)


def bring_up(lab: str, hosts: Sequence[Host]) -> None:
    """Make a lab of these computers; one that is there under the same name goes before."""
    if any(host.mounts for host in hosts):
        raise LabError(
            "A virtual machine has no mounts of this computer's folders: leave them out, or take containers."
        )
    take_down(lab)
    started = time.monotonic()
    for suite, kind in sorted({(host.suite, host.disk) for host in hosts}):
        disk.ensure(suite, kind)
    _folder(lab).mkdir(parents=True)
    _sockets(lab).mkdir(mode=0o700, parents=True)
    _make_networks(lab, hosts)
    for index in range(len(hosts)):
        _start(lab, hosts, index)
    for host in hosts:
        wait(lab, host.name)
    print(f"lab {lab}: {len(hosts)} machines are up ({time.monotonic() - started:.0f} s)", flush=True)


def _check_name(lab: str, host: str) -> None:
    if not _socket(lab, host, "pid").exists():
        raise LabError(f"The lab {lab} has no machine {host}.")


def run(lab: str, host: str, command: str, *, timeout: float = 120, check: bool = True) -> str:
    """Run a shell command as root on a machine, over its console; return its output, errors included."""
    _check_name(lab, host)
    mark = secrets.token_hex(8)
    script = base64.b64encode(command.encode()).decode()
    inner = f'timeout -k 5 {timeout:.0f} bash -lc "$(echo {script} | base64 -d)" </dev/null 2>&1 | cat'
    line = f'printf "\\n%s\\n" {mark}; {inner}; printf "\\n%s %s\\n" {mark} ${{PIPESTATUS[0]}}\n'
    # Before it there may be remains of an earlier command, and an echo of this one.
    got, whole = b"", re.compile(rf"(?s).*\n{mark}\r?\n(.*)\n{mark} ([0-9]+)\r?\n$".encode())
    with socket.socket(socket.AF_UNIX) as connection:
        connection.settimeout(timeout + 20)
        try:
            connection.connect(str(_socket(lab, host, "shell")))
            connection.sendall(line.encode())
            while not (found := whole.match(got)):
                data = connection.recv(65536)
                if not data:
                    raise LabError(f"{host}: its console has ended.")
                got += data
        except OSError as problem:
            raise LabError(f"{host}: no answer of its shell to '{command}' ({problem}).") from problem
    text, status = found[1].decode(errors="replace").replace("\r\n", "\n"), int(found[2])
    if check and status:
        raise LabError(f"{host}: '{command}' ended with {status}: {text.strip()}")
    return text


def wait(lab: str, host: str) -> None:
    """Wait until a machine has booted; raise with the failed units when it did not boot well."""
    deadline = time.monotonic() + BOOT_SECONDS
    while True:
        try:
            state = run(lab, host, "systemctl is-system-running", timeout=10, check=False).strip()
        except LabError:
            state = ""
        if state == "running":
            return
        if state == "degraded" or time.monotonic() > deadline:
            failed = run(lab, host, "systemctl --failed --plain --no-legend", check=False) if state else ""
            log = _folder(lab) / f"{host}.log"
            raise LabError(
                f"{host} has not booted well: it is {state or f'not answering, see {log}'}; failed units: {failed}"
            )
        time.sleep(1)


def _ask(lab: str, host: str, command: str, **arguments: Any) -> None:
    """One command of QMP."""
    _check_name(lab, host)
    with socket.socket(socket.AF_UNIX) as connection:
        connection.settimeout(30)
        connection.connect(str(_socket(lab, host, "qmp")))
        with connection.makefile("rw") as file:
            file.readline()
            for words in ({"execute": "qmp_capabilities"}, {"execute": command, "arguments": arguments}):
                file.write(json.dumps(words) + "\n")
                file.flush()
                answer: dict[str, Any] = {}
                while "return" not in answer and "error" not in answer:  # else it is an event
                    answer = json.loads(file.readline() or '{"error": "it has ended"}')
                if "error" in answer:
                    raise LabError(f"{host}: {command}: {answer['error']}")


def set_carrier(lab: str, host: str, interface: str, up: bool) -> None:
    """Plug the cable of an interface in, or pull it."""
    _ask(lab, host, "set_link", name=f"{interface}-device", up=up)


def reboot(lab: str, host: str) -> None:
    """Reboot a machine, and wait for its boot."""
    read = "cat /proc/sys/kernel/random/boot_id"
    before = run(lab, host, read)
    with contextlib.suppress(LabError):  # the shell may end before it answers
        run(lab, host, "systemctl --no-block reboot", timeout=10, check=False)
    _wait_for_another_boot(lab, host, read, before)


def cut_power(lab: str, host: str) -> None:
    """Cut the power of a machine: the emulator is killed, and all data that the machine has not written to its disk is lost."""
    _check_name(lab, host)
    _end(_socket(lab, host, "pid"))


def give_power(lab: str, host: str, *words: str) -> None:
    """Start a machine whose power was cut, and wait for its boot. `words`: more options of QEMU, for this time."""
    _call(*json.loads(_command(lab, host).read_text()), *words)
    wait(lab, host)


def _choose(lab: str, host: str | None) -> list[str]:
    """The machine that is meant, or all of a lab."""
    if host is None:
        return sorted(path.name[: -len(".pid")] for path in _sockets(lab).glob("*.pid"))
    _check_name(lab, host)
    return [host]


def restart(lab: str, host: str | None = None) -> None:
    """Reboot a machine, or all of a lab one after the other, and wait for the boot."""
    for name in _choose(lab, host):
        reboot(lab, name)


def cut_and_give_power(lab: str, host: str | None = None) -> None:
    """Cut the power of a machine for a moment, or of all of a lab, and wait for the boot."""
    names = _choose(lab, host)
    for name in names:
        cut_power(lab, name)
    for name in names:
        give_power(lab, name)


def _wait_for_another_boot(lab: str, host: str, read: str, before: str) -> None:
    deadline = time.monotonic() + BOOT_SECONDS
    while time.monotonic() < deadline:
        with contextlib.suppress(LabError):
            if run(lab, host, read, timeout=5) != before:
                wait(lab, host)
                return
        time.sleep(1)
    raise LabError(f"{host} has not booted again within {BOOT_SECONDS:.0f} s.")


# The end


def _end(pidfile: Path) -> None:
    """End a machine of ours by its process id."""
    try:
        pid = int(pidfile.read_text())
        if str(pidfile) in Path(f"/proc/{pid}/cmdline").read_text().split("\0"):
            os.kill(pid, signal.SIGKILL)
            while Path(f"/proc/{pid}/stat").exists() and Path(f"/proc/{pid}/stat").read_text().split()[2] != "Z":
                time.sleep(0.05)
    except (OSError, ValueError):
        pass


def list_labs() -> list[str]:
    """The labs of virtual machines of this checkout."""
    first = f"{CHECKOUT}-vm-"
    return sorted(path.name[len(first) :] for path in SOCKETS.glob(f"{first}*"))


def take_down(lab: str) -> None:
    """Remove a lab: its machines, their disks, its namespace. A signal counts when that is done."""
    with defer_signals():
        for pidfile in _sockets(lab).glob("*.pid"):
            _end(pidfile)
        if Path("/run/netns", namespace(lab)).exists():
            _call("ip", "netns", "delete", namespace(lab))
        shutil.rmtree(_sockets(lab), ignore_errors=True)
        shutil.rmtree(_folder(lab), ignore_errors=True)


def take_down_all(lab: str | None) -> None:
    """Remove a lab, or all labs of virtual machines of this checkout."""
    for name in list_labs() if lab is None else [lab]:
        take_down(name)


@contextlib.contextmanager
def remove_at_end(lab: str) -> Iterator[None]:
    """Remove a lab after the block, also if a signal ends this program: make a lab inside the block."""
    with exit_on_signals():
        try:
            yield
        finally:
            take_down(lab)


# The way in


def _address(host: Host) -> str:
    return str(ipaddress.ip_interface(host.interfaces[0].address).ip)


def enter(lab: str, address: str) -> list[str]:
    """The command that connects to sshd of a machine, and hands the connection to the ssh client (ProxyUseFdpass)."""
    program = str(Path(__file__).with_name("enter.py"))
    return ["ip", "netns", "exec", namespace(lab), sys.executable, "-IS", program, address, "22"]


def write_inventory(lab: str, hosts: Sequence[Host]) -> Path:
    """Write the connection variables of a lab, to be given after the shipped inventory; return the file."""

    def connection(host: Host) -> dict[str, object]:
        options = [
            shlex.quote(f"ProxyCommand={shlex.join(enter(lab, _address(host)))}"),
            "ProxyUseFdpass=yes",
            "StrictHostKeyChecking=no",
            "UserKnownHostsFile=/dev/null",
            "LogLevel=ERROR",
        ]
        return {
            "ansible_host": f"{CHECKOUT}-vm-{lab}-{host.name}",
            "ansible_connection": "ssh",
            "ansible_user": "root",
            "ansible_ssh_private_key_file": str(root_files.ssh_key()),
            "ansible_ssh_common_args": " ".join(f"-o {option}" for option in options),
            "ansible_control_path_dir": f"/tmp/rosfleet-{os.getuid()}",  # a socket's path is short
            "ansible_timeout": 120,  # seconds; without KVM
            "ansible_pipelining": True,
            "ansible_python_interpreter": "/usr/bin/python3",
        }

    path = WORK / lab / "hosts.yml"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({"all": {"hosts": {host.name: connection(host) for host in hosts}}}, indent=2) + "\n")
    return path


def shell(lab: str, host: str) -> None:
    """Become a shell on a machine, by ssh with its connection variables."""
    _check_name(lab, host)
    connection = json.loads((WORK / lab / "hosts.yml").read_text())["all"]["hosts"][host]
    options = shlex.split(connection["ansible_ssh_common_args"])
    os.execvp("ssh", ["ssh", "-i", connection["ansible_ssh_private_key_file"], *options, f"root@{host}"])
