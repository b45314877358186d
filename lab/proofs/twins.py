# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Robots of one kind, distinguished at a station: by rostopic, rosservice, actionlib and tf2, which know nothing of it.

Each robot runs the same program (lab/nodes/programs/twin_robot.py).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from proofs.proof import NODES, Computer, Result, wait_for

TREE = NODES / "programs/tree.py"
CLIENT = NODES / "programs/action_client.py"


def distinguish_twins(robots: Mapping[str, Computer], station: Computer) -> Iterator[Result]:
    """Yield the results at the station for each robot (namespace -> its computer), whose programs run."""
    for robot, computer in robots.items():
        whom = f"{computer.name} -> {station.name}"
        ok, seen = wait_for(
            lambda robot=robot: station.run("rostopic list"), lambda text, robot=robot: f"/{robot}/scan" in text.split()
        )
        yield Result("rostopic list has the topic in the robot's namespace", whom, ok, " ".join(seen.split()))
        for topic in ("scan", "map", "camera/image_raw/compressed"):
            seen = station.run(f"timeout -k 5 20 rostopic echo -n 1 /{robot}/{topic}")
            yield Result(f"a message of /{topic} is this robot's", whom, computer.name in seen, seen[:60])
        seen = station.run(f"timeout -k 5 20 rostopic echo -n 1 /{robot}/odom/header/frame_id")
        yield Result("a header names this robot's frame", whom, f"{robot}/odom" in seen, " ".join(seen.split()))
        ok, seen = wait_for(
            lambda robot=robot: station.run(f"rosservice call /{robot}/reset"),
            lambda text, name=computer.name: name in text,
        )
        yield Result("a service of this robot answers", whom, ok, " ".join(seen.split()))
        seen = station.run(f"python3 - /{robot}/move_base", CLIENT, seconds=100)
        yield Result(
            "an action gives feedback and its result",
            whom,
            seen.split() in (["1", "42"], ["2", "42"], ["3", "42"]),
            seen,
        )
        seen = station.run(f"rosparam get /{robot}/robot_description")
        yield Result("the model is this robot's", whom, computer.name in seen, seen.strip())
    yield _find_tree(robots, station)


def _find_tree(robots: Mapping[str, Computer], station: Computer) -> Result:
    """Look up each robot's laser, which is as far ahead as its number says."""
    wanted = [
        f"{robot}/laser={float(''.join(filter(str.isdigit, computer.name)))}" for robot, computer in robots.items()
    ]
    seen = station.run(f"python3 - world {' '.join(f'{robot}/laser' for robot in robots)}", TREE)
    return Result("tf2 has one tree of all robots", f"all -> {station.name}", seen.split() == wanted, seen.strip())
