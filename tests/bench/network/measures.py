# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The measurements: each returns samples, in seconds, bytes or shares, of two robots that run."""

from __future__ import annotations

import contextlib
import json
import time

from setups.links import cut, repair, wait_until
from subject import NODES, Lab
from systems import ADDRESSES, GIVER, HERE, TAKER, System, take

PAUSE = {False: 0.05, True: 0.5}  # before each change; upstream polls each two seconds
FIRST = 30  # publishers for the first message
IDLE = 30.0  # seconds
FULL_NODES, FULL_TOPICS = 30, 100  # of the large graph: 3,000 topics


def changes(lab: Lab, system: System, count: int) -> dict[str, list[float]]:
    """New publisher -> registered on the other roscore; publisher gone -> gone there. 60 s stands for never."""
    seen = take(lab, count, PAUSE[system.upstream])
    assert len(seen) == count, "the taker broke off"
    new, gone = ([60.0 if value is None else value for value in column] for column in zip(*seen, strict=True))
    return {"new": new, "gone": gone}


def fill(lab: Lab) -> float:
    """Make the graph large; seconds until the other roscore has it."""
    (seconds,) = take(lab, "fill", FULL_NODES, FULL_TOPICS)
    assert seconds is not None, "the topics did not come"
    return seconds


def first_messages(lab: Lab) -> list[float]:
    """Publisher created -> first message at a waiting subscriber on the other robot. Both are rospy nodes."""
    for program in ("maker.py", "waiter.py"):
        for host in ADDRESSES:
            lab.run(host, f"cat > /run/{program}", stdin=(HERE / "programs" / program).read_text())
    lab.start(TAKER, "waiter", f"python3 /run/waiter.py {FIRST}")
    wait_until(lambda: any(text == "ready" for _at, text in lab.output(TAKER, "waiter")), 60, "the subscribers")
    time.sleep(3)
    lab.start(GIVER, "maker", f"python3 /run/maker.py {FIRST}")
    wait_until(lambda: any(text == "done" for _at, text in lab.output(GIVER, "maker")), 120, "the publishers")
    with contextlib.suppress(AssertionError):
        wait_until(lambda: len(lab.output(TAKER, "waiter")) > FIRST, 30, "the messages")
    heard = {text: at for at, text in reversed(lab.output(TAKER, "waiter"))}
    made = {text: at for at, text in lab.output(GIVER, "maker") if text != "done"}
    lab.stop(GIVER, "maker")
    lab.stop(TAKER, "waiter")
    return [heard[number] - at if number in heard else 60.0 for number, at in made.items()]


def losses(lab: Lab, repetitions: int) -> dict[str, list[float]]:
    """Robot without power -> gone elsewhere; back -> messages flow again."""
    script = (HERE / "programs" / "listener.py").read_text()
    lab.run(TAKER, "cat > /run/listener.py", stdin=script)
    lab.start(GIVER, "ticks", "rostopic pub -r 50 /ticks std_msgs/Empty")
    lab.start(TAKER, "listener", "python3 /run/listener.py /ticks")

    def heard() -> float:
        return float(lab.run(TAKER, "tail -n 1 /run/listener.out", check=False) or 0)

    gone, back = [], []
    for _number in range(repetitions):
        # A connection that has survived brings messages before the topic is registered again: it must be there to be lost.
        wait_until(lambda: time.monotonic() - heard() < 0.5 and "ticks" in held(lab), 60, "messages")
        began = cut(lab, GIVER)
        wait_until(lambda: "ticks" not in held(lab), 400, "the other robot is gone")
        gone.append(time.monotonic() - began)
        time.sleep(2)
        ended = repair(lab, GIVER)
        wait_until(lambda ended=ended: heard() > ended, 400, "messages again")
        back.append(first_after(lab, ended) - ended)
    lab.stop(GIVER, "ticks")
    lab.stop(TAKER, "listener")
    return {"lost": gone, "back": back}


def held(lab: Lab, host: str = TAKER) -> str:
    """The publishers that a roscore knows."""
    ask = "import os, xmlrpc.client as x; print(x.ServerProxy(os.environ['ROS_MASTER_URI']).getSystemState('/bench')[2][0])"
    return lab.run(host, f'python3 -c "{ask}"')


def first_after(lab: Lab, moment: float) -> float:
    """The time at which the first message after a moment was heard."""
    times = map(float, lab.run(TAKER, "cat /run/listener.out").split())
    return next(at for at in times if at > moment)


def traffic(lab: Lab) -> int:
    """The bytes that the giver has sent and received so far."""
    return sum(map(int, lab.run(GIVER, "cat /sys/class/net/eth0/statistics/[rt]x_bytes").split()))


def bytes_per_change(lab: Lab, system: System, count: int) -> float:
    """Bytes for one new topic, both directions: what changes cost beyond an idle time of the same length."""
    before, began = traffic(lab), time.monotonic()
    time.sleep(15)
    idle = (traffic(lab) - before) / (time.monotonic() - began)
    before, began = traffic(lab), time.monotonic()
    changes(lab, system, count)
    spent = traffic(lab) - before - idle * (time.monotonic() - began)
    return max(0.0, spent / (2 * count))  # a new one and one that is gone


def observe_units(lab: Lab, host: str, *units: str) -> dict[str, float]:
    """Processor time (seconds), memory (bytes) and number of the processes of units; 0 where there are none."""
    text = (NODES / "observers/usage.py").read_text()
    found: dict[str, float] = json.loads(lab.run(host, f"python3 - {' '.join(units)}", stdin=text))
    return found


def usage(lab: Lab, system: System, kind: str) -> dict[str, float]:
    """Processor time, memory and number of the processes of a robot's "nodes" or "roscore"."""
    found = observe_units(lab, TAKER, *system.units[kind])
    assert found["processes"], f"there is no process of {system.units[kind]}"
    return found


def cpu(lab: Lab, system: System) -> dict[str, float]:
    """Shares of a core while nothing happens: the nodes of a robot, and its roscore with and without them."""

    def shares(*kinds: str) -> list[float]:
        before, began = [usage(lab, system, kind)["seconds"] for kind in kinds], time.monotonic()
        time.sleep(IDLE)
        after = [usage(lab, system, kind)["seconds"] for kind in kinds]
        return [(now - was) / (time.monotonic() - began) for was, now in zip(before, after, strict=True)]

    time.sleep(5)
    nodes, roscore = shares("nodes", "roscore")
    lab.run(TAKER, f"systemctl stop {' '.join(reversed(system.units['nodes']))}")
    time.sleep(2)
    (alone,) = shares("roscore")
    return {"nodes": nodes, "caused": max(0.0, roscore - alone), "roscore": roscore}


def memory(lab: Lab, system: System) -> float:
    """Bytes of memory of a robot's nodes and of its roscore, with all that belongs to it."""
    return sum(usage(lab, system, kind)["bytes"] for kind in system.units)
