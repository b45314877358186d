# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The seconds until a robot is back after it changed its network, with the WireGuard of a kernel, which the lab does not have.

    apt-get install --no-install-recommends qemu-system-x86 busybox-static cpio iputils-ping wireguard-tools
    python tests/bench/network/roaming.py

A virtual machine with Debian's kernel has three network namespaces: ana-pc, the robot bob-pc, and a router between them. The
tunnel is that of tests/systems/tunnel, as the plan renders it. ana-pc pings bob-pc five times a second, while bob-pc
gets another address in its network, and while it leaves for another network. Prints the longest silence of each.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).resolve().parents[3]
sys.path[:0] = [str(ROOT / ".work/collections"), str(ROOT / "lab")]

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._features.tunnel.files import render_tunnel  # noqa: E402
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._features.tunnel.model import Tunnel  # noqa: E402
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._inventory.read import Inventory, read_fleet  # noqa: E402
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.plan import fleet_plan  # noqa: E402
from machines.layout import read_inventory  # noqa: E402

INVENTORY = ROOT / "tests" / "systems" / "tunnel"
ANA, BOB = "ana-pc", "bob-pc"
KERNEL = "linux-image-cloud-amd64"
MODULES = ("wireguard", "veth")
PROGRAMS = ("ip", "wg", "ping")
SECONDS = 120  # that the machine has
# Each change as the robot's own programs make it: a new lease in the same network, and another wifi.
CHANGES = {
    "another address": "/own/ip address flush dev first; /own/ip address add 192.168.30.77/24 dev first; /own/ip route replace default via 192.168.30.1",
    "another network": "/own/ip link set first down; /own/ip link set second up; /own/ip address add 192.168.31.9/24 dev second; "
    "/own/ip route replace default via 192.168.31.1",
}
INIT = """\
#!/bin/busybox sh
/bin/busybox --install -s /bin
mkdir -p /proc /sys /run /tmp /dev
mount -t proc none /proc; mount -t sysfs none /sys; mount -t tmpfs none /run; mount -t devtmpfs none /dev
{insert}
for one in ana bob router; do /own/ip netns add $one; /own/ip -n $one link set lo up; done
/own/ip netns exec router sysctl -qw net.ipv4.ip_forward=1
{wires}
for one in ana bob; do
  /own/ip -n $one link add multimaster0 type wireguard
  /own/ip netns exec $one /own/wg setconf multimaster0 /$one.conf
done
/own/ip -n ana address add {ana}/24 dev multimaster0; /own/ip -n ana link set multimaster0 up
/own/ip -n bob address add {bob}/24 dev multimaster0; /own/ip -n bob link set multimaster0 up
{changes}
poweroff -f
"""
WIRE = """\
/own/ip link add {name} netns {who} type veth peer name {port} netns router
/own/ip -n {who} address add {address}/24 dev {name}; /own/ip -n router address add {gateway}/24 dev {port}; /own/ip -n router link set {port} up
"""
CHANGE = """\
/own/ip netns exec ana /own/ping -D -n -i 0.2 {bob} > /run/pings &
sleep 8; (cat > /run/change) <<'END'
{change}
END
/own/ip netns exec bob /bin/sh /run/change; sleep 25; killall ping; sleep 1
echo "begin {name}"; cat /run/pings; echo "end {name}"
"""


class BenchError(Exception):
    """Nothing could be measured; the text says why."""


def run(*words: str, folder: Path | None = None, text: str = "") -> str:
    """Run a program to its end; return what it printed. Raises BenchError."""
    done = subprocess.run(words, cwd=folder, input=text, capture_output=True, text=True, check=False, timeout=SECONDS)
    if done.returncode:
        raise BenchError(f"{words[0]} has failed: {done.stderr[-400:]}")
    return done.stdout


def find_program(name: str) -> Path:
    """Return the path of a program. Raises BenchError."""
    path = shutil.which(name)
    if path is None:
        raise BenchError(f"{name} is missing: install it as said above")
    return Path(path)


def fetch_kernel(folder: Path) -> tuple[Path, Path]:
    """Fetch Debian's kernel; return it, and the folder of its modules."""
    name = re.findall(r"Depends: (linux-image-\S+)", run("apt-cache", "depends", KERNEL))[0]
    run("apt-get", "-qq", "download", name, folder=folder)
    run("dpkg-deb", "--extract", str(next(folder.glob("*.deb"))), "kernel", folder=folder)
    return next(folder.glob("kernel/boot/vmlinuz-*")), next(folder.glob("kernel/lib/modules/*"))


def list_modules(modules: Path, names: tuple[str, ...]) -> list[Path]:
    """List the files of modules, each after those that it needs."""
    files = {path.name.partition(".")[0].replace("-", "_"): path for path in modules.rglob("*.ko")}
    found: list[Path] = []

    def add(name: str) -> None:
        path = files.get(name.replace("-", "_"))
        if path is None or path in found:  # it is built in
            return
        for needed in re.findall(rb"\0depends=([^\0]*)\0", path.read_bytes())[0].decode().split(","):
            add(needed)
        found.append(path)

    for name in names:
        add(name)
    return found


def render_peers() -> dict[str, str]:
    """Return what wg reads on each of the two: the tunnel of the plan, with keys of this run."""
    listing = read_inventory(INVENTORY)
    robots = {name: listing[name]["hosts"] for name in listing["robots"]["children"]}
    variables = {
        host: {name: value for name, value in values.items() if name.startswith("multimaster_")}
        for host, values in listing["_meta"]["hostvars"].items()
    }
    fleet = fleet_plan(read_fleet(Inventory(robots=robots, variables=variables)))
    private = {name: run("wg", "genkey").strip() for name in (ANA, BOB)}
    public = {name: run("wg", "pubkey", text=key).strip() for name, key in private.items()}
    texts = {}
    for name in (ANA, BOB):
        rendered = render_tunnel(Tunnel.find(fleet.computers[name]), public)[-1]["content"]
        of_wg = ("[", "ListenPort", "PublicKey", "AllowedIPs", "Endpoint", "PersistentKeepalive")
        lines = [line for line in rendered.splitlines() if line.startswith(of_wg)]  # the others are wg-quick's
        texts[name] = "\n".join(lines).replace("[Interface]", f"[Interface]\nPrivateKey = {private[name]}") + "\n"
    return texts


def make_system(folder: Path, modules: list[Path]) -> Path:
    """Make the file system of the machine, which is in its memory."""
    system = folder / "system"
    programs = [find_program(name) for name in PROGRAMS]
    libraries = {Path(found) for path in programs for found in re.findall(r"(/\S+) \(0x", run("ldd", str(path)))}
    for path in (*programs, *libraries):
        target = system / (f"own/{path.name}" if path in programs else str(path)[1:])
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(path, target)
    (system / "bin").mkdir()
    shutil.copy(find_program("busybox"), system / "bin" / "busybox")
    for path in modules:
        shutil.copy(path, system)
    for name, text in render_peers().items():
        (system / f"{name.partition('-')[0]}.conf").write_text(text)
    wires = [("bob", "first", "192.168.30.22", "192.168.30.1"), ("bob", "second", "192.168.31.8", "192.168.31.1")]
    wires.append(("ana", "eth0", "192.168.28.21", "192.168.28.1"))
    lines = [
        WIRE.format(who=who, name=name, port=f"{who}-{name}", address=address, gateway=gateway)
        for who, name, address, gateway in wires
    ]
    lines += ["/own/ip -n bob link set first up; /own/ip -n bob route add default via 192.168.30.1"]
    lines += ["/own/ip -n ana link set eth0 up; /own/ip -n ana route add default via 192.168.28.1"]
    changes = [CHANGE.format(name=name, change=change, bob="10.77.0.22") for name, change in CHANGES.items()]
    insert = "\n".join(f"insmod /{path.name}" for path in modules)
    text = INIT.format(
        insert=insert, wires="\n".join(lines), changes="".join(changes), ana="10.77.0.21", bob="10.77.0.22"
    )
    (system / "init").write_text(text)
    (system / "init").chmod(0o755)
    names = "\n".join(str(path.relative_to(system)) for path in system.rglob("*"))
    archive = folder / "system.cpio"
    with archive.open("wb") as file:
        subprocess.run(
            ("cpio", "--quiet", "-o", "-H", "newc"), cwd=system, input=names.encode(), stdout=file, check=True
        )
    return archive


def boot(kernel: Path, archive: Path) -> str:
    """Run the machine until it ends; return what it printed. It has no network of its own, and no processor of its own either."""
    words = ["-m", "512", "-nographic", "-no-reboot", "-nic", "none", "-kernel", str(kernel), "-initrd", str(archive)]
    return run("qemu-system-x86_64", *words, "-append", "console=ttyS0 quiet panic=-1")


def main() -> int:
    """Exit status 1 where nothing could be measured."""
    try:
        with TemporaryDirectory() as name:
            folder = Path(name)
            kernel, modules = fetch_kernel(folder)
            said = boot(kernel, make_system(folder, list_modules(modules, MODULES)))
        for change in CHANGES:
            pings = said.partition(f"begin {change}")[2].partition(f"end {change}")[0]
            times = [float(at) for at in re.findall(r"\[(\d+\.\d+)\] 64 bytes", pings)]
            if len(times) < 50:
                raise BenchError(f"{change}: {len(times)} answers came: {said[-800:]}")
            silence = max(after - before for before, after in zip(times, times[1:], strict=False))
            print(f"{change}: back after {silence:.1f} s, of {len(times)} answers in {times[-1] - times[0]:.0f} s")
    except (BenchError, subprocess.SubprocessError) as problem:
        print(f"bench: {problem}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
