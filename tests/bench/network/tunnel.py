# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The cost of a tunnel: the same two computers without one, and with it.

    python tests/bench/network/tunnel.py

Prints a table: the first message of a new publisher, the throughput of one TCP stream, and the share of a core that the tunnel
takes on each side with a camera of 10 MB a second. wireguard-go makes the tunnel where the kernel cannot, and the table says so.
"""

from __future__ import annotations

import shutil
import statistics
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

ROOT = Path(__file__).resolve().parents[3]
sys.path[:0] = [str(ROOT / "lab"), str(ROOT / "tests/bench")]

import measures  # noqa: E402
from machines.podman import LabError  # noqa: E402
from setups.links import wait_until  # noqa: E402
from subject import Lab, lab_of  # noqa: E402
from systems import ADDRESSES, GIVER, HERE, TAKER  # noqa: E402

#: name -> the inventory, the address of the taker in it
CASES = {
    "without": (HERE / "inventory", ADDRESSES[TAKER]),
    "with": (ROOT / "tests" / "systems" / "tunnel", "10.77.0.22"),
}
PORT = 26010
SECONDS, REPETITIONS = 5, 5
CAMERA = 10_000_000  # bytes a second
UNIT = "multimaster-tunnel"


def stream(lab: Lab, address: str, rate: float) -> float:
    """Send a TCP stream from the giver to the taker; the bytes a second that came."""
    lab.start(TAKER, "take", f"python3 /run/stream.py take {address} {PORT}")
    wait_until(lambda: f":{PORT} " in lab.run(TAKER, "ss -Hltn"), 10, "the taker listens")
    lab.run(GIVER, f"python3 /run/stream.py give {address} {PORT} {SECONDS} {rate}")
    wait_until(lambda: lab.run(TAKER, "cat /run/take.out", check=False).strip(), 30, "the taker has counted")
    return float(lab.run(TAKER, "cat /run/take.out; rm /run/take.out"))


def measure(name: str) -> dict[str, list[float]]:
    """All figures of one case."""
    inventory, address = CASES[name]
    with TemporaryDirectory() as folder:
        copied = Path(shutil.copytree(inventory, Path(folder) / "inventory"))  # the keys are kept beside it
        return _measure(copied, address)


def _measure(inventory: Path, address: str) -> dict[str, list[float]]:
    with lab_of("bench-tunnel", inventory, {}) as lab:
        status, output = lab.play("site.yml")
        if status:
            raise LabError(f"site.yml has failed: {output[-600:]}")
        wait_until(
            lambda: "ana_pc" in lab.run(TAKER, "rosservice call /master_discovery/list_masters").replace("-", "_"),
            60,
            "ana",
        )
        for host in (GIVER, TAKER):
            lab.run(host, "cat > /run/stream.py", stdin=(HERE / "programs" / "stream.py").read_text())
        found = {"first message, ms": [1000 * seconds for seconds in measures.first_messages(lab)]}
        found["TCP, MB/s"] = [stream(lab, address, 0) / 1e6 for _number in range(REPETITIONS)]
        before = [measures.observe_units(lab, host, UNIT)["seconds"] for host in (GIVER, TAKER)]
        found["camera, MB/s"] = [stream(lab, address, CAMERA) / 1e6]
        for host, was in zip((GIVER, TAKER), before, strict=True):
            found[f"tunnel on {host}, % of a core"] = [
                100 * (measures.observe_units(lab, host, UNIT)["seconds"] - was) / SECONDS
            ]
        return found


def main() -> int:
    """Exit status 1 where nothing could be measured."""
    try:
        found = {name: measure(name) for name in CASES}
    except (AssertionError, LabError) as problem:
        print(f"bench: {problem}", file=sys.stderr)
        return 1
    print(f"{'median':<32}" + "".join(f"{name:>12}" for name in found))
    for figure in found["with"]:
        print(f"{figure:<32}" + "".join(f"{statistics.median(of[figure]):>12.1f}" for of in found.values()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
