# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Labs: the containers and networks of an inventory, under a name.

The networks have no address management and no way out; every container configures its own interfaces with its network
manager, as a robot does. So labs with the same addresses can be up side by side, and a restart of a container is a cold
boot. All names begin with a few characters that identify this checkout: labs of two checkouts are never mixed up.
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import os
import shlex
import shutil
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from machines import image
from machines.layout import Host
from machines.podman import CHECKOUT, WORK, LabError, configuration, list_labelled, podman
from machines.root_files import FILES, UNITS, Files, list_files, list_links, pack, ssh_key
from machines.signals import defer_signals, exit_on_signals

# Labels of containers and networks.
LAB, HOST, DIGEST, OWNER = "rosfleet.lab", "rosfleet.host", "rosfleet.digest", "rosfleet.checkout"
BOOT_SECONDS = 60.0
INSTANCES = 12  # of inotify, that a system holds: systemd 5, D-Bus 1, logind 1, the managers of users who are logged in
# A computer's folder here is /mnt/lab in its container, where systemd listens for the lab (files/lab-ssh.socket).
SHARED = Path("/run" if os.getuid() == 0 else f"/run/user/{os.getuid()}") / "rosfleet-lab"

# Enough for systemd, kernel settings, routes and packet filters inside; /sys stays read-only and no device is shown.
RIGHTS = """
--systemd=always --security-opt=unmask=ALL --cap-add=SYS_ADMIN,NET_ADMIN,NET_RAW
--no-hosts --dns=none --restart=always --sysctl=net.ipv4.ip_forward=0
""".split()


def container(lab: str, host: str) -> str:
    """The name of a computer's container."""
    return f"{CHECKOUT}-{lab}-{host}"


def label(lab: str) -> str:
    """The label that the containers and networks of a lab carry."""
    return f"{LAB}={CHECKOUT}-{lab}"


def _network(lab: str, cidr: str) -> str:
    return f"{CHECKOUT}-{lab}-{cidr.replace('/', '-').replace(':', '.')}"


def _files(host: Host) -> Files:
    """Return the files that a computer gets before its first boot: path -> content, mode."""
    return list_files(host, {f"usr/lib/systemd/system/{name}": (FILES / name).read_text() for name in UNITS})


def _archive(host: Host) -> bytes:
    wanted = f"usr/lib/systemd/system/sockets.target.wants/{UNITS[0]}"
    return pack(_files(host), {**list_links(host), wanted: f"../{UNITS[0]}"})


def _digest(image_name: str, host: Host) -> str:
    inputs = json.dumps([image_name, configuration(), RIGHTS, _files(host), dataclasses.asdict(host)])
    return hashlib.sha256(inputs.encode()).hexdigest()[:16]


def _socket_folder(lab: str, host: str) -> Path:
    """The folder that a container shares with the lab; in it is the socket by which ssh enters."""
    return SHARED / f"{CHECKOUT}-{lab}" / host


def _owner_options(lab: str) -> tuple[str, str]:
    """The options for the things of a lab."""
    return f"--label={label(lab)}", f"--label={OWNER}={CHECKOUT}"


def _create(lab: str, host: Host, image_name: str) -> None:
    """One computer, from nothing to the beginning of its first boot."""
    name = container(lab, host.name)
    networks = [f"--network={_network(lab, port.network)}:interface_name={port.name}" for port in host.interfaces]
    labels = {HOST: host.name, DIGEST: _digest(image_name, host)}
    podman(
        "create",
        f"--name={name}",
        f"--hostname={host.name}",
        *_owner_options(lab),
        *(f"--label={key}={value}" for key, value in labels.items()),
        *RIGHTS,
        *networks,
        f"--volume={_socket_folder(lab, host.name)}:/mnt/lab",
        *(f"--volume={mount}:ro" for mount in host.mounts),
        image_name,
    )
    podman("cp", "--archive=false", "-", f"{name}:/", stdin=_archive(host))
    podman("start", name)


def wait(name: str) -> None:
    """Wait until a container has booted; raise with the failed units when it did not boot well."""
    deadline = time.monotonic() + BOOT_SECONDS
    while True:
        state = podman("exec", name, "systemctl", "is-system-running", "--wait", check=False, timeout=BOOT_SECONDS)
        if state == "running":
            return
        if state == "degraded" or time.monotonic() > deadline:
            failed = podman("exec", name, "systemctl", "--failed", "--plain", "--no-legend", check=False)
            raise LabError(f"{name} has not booted well: it is {state or 'not answering'}; failed units: {failed}")
        time.sleep(0.1)


def _do_all(work: Callable[[str], None], names: Iterable[str]) -> None:
    """Do the same to several containers at once."""
    pool = ThreadPoolExecutor(max_workers=2 * (os.cpu_count() or 1))
    try:
        list(pool.map(work, names))
    finally:
        with defer_signals():  # nothing is made any more when this has ended
            pool.shutdown(cancel_futures=True)


def _remove(containers: Sequence[str], networks: Sequence[str]) -> None:
    if containers:
        # With --restart=always a container may be on its way up again, and refuses once.
        podman("rm", "--force", "--time=1", *containers, check=False)
        podman("rm", "--force", "--time=1", "--ignore", *containers)
    if networks:
        podman("network", "rm", *networks)


def _limit(systems: int) -> None:
    """Refuse a lab that would hang at boot: a system that gets no inotify instance waits for ever."""
    allowed = int(Path("/proc/sys/fs/inotify/max_user_instances").read_text())
    if systems * INSTANCES > allowed:
        raise LabError(
            f"the kernel allows a user {allowed} inotify instances (fs.inotify.max_user_instances), and {systems} systems "
            f"need {systems * INSTANCES}: run 'make lab', which raises the limit until the next boot."
        )


def bring_up(lab: str, hosts: Sequence[Host], *, full: bool = True) -> None:
    """Bring a lab to these computers. Those that are there with the same inputs stay as they are; others go.

    `full`: they have all packages of image.py.
    """
    started = time.monotonic()
    images = {suite: image.ensure(suite, full=full) for suite in sorted({host.suite for host in hosts})}
    by_name = {container(lab, host.name): host for host in hosts}
    wanted = {name: _digest(images[host.suite], host) for name, host in by_name.items()}
    networks = {_network(lab, port.network) for host in hosts for port in host.interfaces}
    present = {entry["Names"][0]: entry["Labels"].get(DIGEST) for entry in list_labelled("container", label(lab))}
    present_networks = {entry["name"] for entry in list_labelled("network", label(lab))}

    _limit(len(list_labelled("container", LAB)) - len(present) + len(wanted))
    staying = [name for name in wanted if present.get(name) == wanted[name]]
    new = [name for name in wanted if name not in staying]
    superfluous = sorted(set(present) - set(staying))
    _remove(superfluous, sorted(present_networks - networks))
    for network in sorted(networks - present_networks):
        # With --internal nothing leads out; without address management podman assigns no address.
        podman("network", "create", "--internal", "--disable-dns", "--ipam-driver=none", *_owner_options(lab), network)
    if superfluous:
        print(f"lab {lab}: removed {', '.join(superfluous)}", flush=True)
    if new:
        print(f"lab {lab}: starting {', '.join(by_name[name].name for name in new)} ...", flush=True)
    for host in hosts:
        _socket_folder(lab, host.name).mkdir(mode=0o700, parents=True, exist_ok=True)
    _do_all(lambda name: podman("start", name), staying)
    _do_all(lambda name: _create(lab, by_name[name], images[by_name[name].suite]), new)
    _do_all(wait, by_name)
    print(f"lab {lab}: {len(hosts)} computers are up ({time.monotonic() - started:.1f} s)", flush=True)


def halt(name: str) -> None:
    """Stop a container."""
    # One that ends by itself in the moment before it is killed makes 'podman stop' fail, once.
    podman("stop", "--time=5", name, check=False)
    podman("stop", "--time=5", name)


def reboot(name: str) -> None:
    """Stop a container and start it again, without waiting for its boot."""
    halt(name)
    podman("start", name)


def restart(lab: str, host: str | None = None) -> None:
    """Reboot a computer, or all: processes, addresses, routes and kernel settings go; files stay."""
    _boot(lab, host, reboot)


def cut_power(lab: str, host: str | None = None) -> None:
    """Kill all processes of a computer, or of all, and boot. Files stay as they are: the kernel of this machine goes on, with what it has yet to write."""

    def kill(name: str) -> None:
        podman("kill", name)
        podman("start", name)

    _boot(lab, host, kill)


def _boot(lab: str, host: str | None, again: Callable[[str], None]) -> None:
    names = [
        entry["Names"][0] for entry in list_labelled("container", label(lab)) if host in (None, entry["Labels"][HOST])
    ]
    if not names:
        raise LabError(f"The lab {lab} has no container{f' of {host}' if host else ''}.")

    def whole(name: str) -> None:
        again(name)
        wait(name)

    _do_all(whole, names)
    print(f"lab {lab}: restarted {', '.join(sorted(names))}", flush=True)


def take_down(lab: str | None) -> None:
    """Remove the containers and networks of a lab, or of all labs of this checkout. A signal counts when that is done."""
    wanted = label(lab) if lab else f"{OWNER}={CHECKOUT}"
    with defer_signals():
        containers = [entry["Names"][0] for entry in list_labelled("container", wanted)]
        networks = [entry["name"] for entry in list_labelled("network", wanted)]
        _remove(containers, networks)
        for folder in SHARED.glob(f"{CHECKOUT}-{lab or '*'}"):
            shutil.rmtree(folder, ignore_errors=True)
    if containers or networks:
        print(f"lab {lab or '(all)'}: removed {len(containers)} containers, {len(networks)} networks", flush=True)


@contextlib.contextmanager
def remove_at_end(lab: str) -> Iterator[None]:
    """Remove a lab before the block and after it, also if a signal ends this program: make a lab inside the block."""
    with exit_on_signals():
        try:
            try:
                take_down(lab)
                yield
            finally:
                take_down(lab)
        except BaseException:
            take_down(lab)  # a signal may have come in the moment before the removal began
            raise


def _connection(lab: str, host: str) -> dict[str, object]:
    """The connection variables of a computer: real ssh, but by way of a shared folder instead of a network.

    By 'podman exec' each new connection takes 75 ms more of the processors, and playbooks are measured here.
    """
    name = container(lab, host)
    enter = shlex.join(
        [sys.executable, "-IS", str(Path(__file__).with_name("enter.py")), str(_socket_folder(lab, host) / "ssh")]
    )
    options = [
        shlex.quote(f"ProxyCommand={enter}"),
        "ProxyUseFdpass=yes",
        "StrictHostKeyChecking=no",
        "UserKnownHostsFile=/dev/null",
        "LogLevel=ERROR",
    ]
    return {
        "ansible_host": name,
        "ansible_connection": "ssh",
        "ansible_user": "root",
        "ansible_ssh_private_key_file": str(ssh_key()),
        "ansible_ssh_common_args": " ".join(f"-o {option}" for option in options),
        "ansible_control_path_dir": f"/tmp/rosfleet-{os.getuid()}",  # a socket's path is short
        "ansible_timeout": 60,  # seconds; all systems of a lab share the processors of one machine
        "ansible_pipelining": True,
        "ansible_python_interpreter": "/usr/bin/python3",
    }


def write_inventory(lab: str, hosts: Sequence[Host]) -> Path:
    """Write the connection variables of a lab, to be given after the shipped inventory; return the file."""
    variables = {host.name: _connection(lab, host.name) for host in hosts}
    path = WORK / lab / "hosts.yml"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({"all": {"hosts": variables}}, indent=2) + "\n")  # JSON is YAML
    return path


def script_inventory(lab: str, hosts: Sequence[Host]) -> dict[str, object]:
    """The same in the form that inventory scripts print."""
    variables = {host.name: _connection(lab, host.name) for host in hosts}
    return {"all": {"hosts": list(variables)}, "_meta": {"hostvars": variables}}


def shell(lab: str, host: str) -> None:
    """Become a shell on a computer."""
    name = container(lab, host)
    os.execvp("podman", ["podman", "exec", "-it", name, "bash", "-l"])
