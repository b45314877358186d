# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Half an hour of a busy fleet: topics come and go, a robot leaves and comes back, a roscore is killed. Nothing may grow or get lost.

SOAK_MINUTES sets another length. Writes .work/bench/soak.json and a picture of it, soak.svg.
"""

import json
import os
import random
import statistics
import threading
import time
from pathlib import Path

import pytest
from setups.links import chat, cut, message_times, repair, wait_until
from subject import NODES, three_robots

ROOT = Path(__file__).resolve().parents[2]

MINUTES = float(os.environ.get("SOAK_MINUTES", "30"))
WORK = ROOT / ".work" / "bench"
PORT = 26000  # below those that the kernel gives to any program
ADDRESSES = {"ana-pc": "192.168.20.21", "bob-pc": "192.168.20.22"}
LEAVER = "cid-pc"
UNITS = {
    "nodes": ("multimaster-discovery", "multimaster-sync", "multimaster-connections"),
    "roscore": ("multimaster-roscore",),
}
AWAY, LEAVES, KILLS, SAMPLES = 20.0, 60.0, 120.0, 10.0  # seconds
CHURN = 100  # topics of each robot, of which some come or go each second
#: what a process may hold more at the end than in the second sixth: share, and as a number
FLAT = {"bytes": (1.10, 6e6), "threads": (1.0, 6), "descriptors": (1.0, 12)}


class Every(threading.Thread):
    """Something that is done again and again until the end."""

    def __init__(self, seconds, act):
        super().__init__(daemon=True)
        self.seconds, self.act, self.over, self.problem = seconds, act, threading.Event(), None

    def run(self):
        while not self.over.wait(self.seconds):
            try:
                self.act()
            except Exception as problem:  # told at the end
                self.problem = problem
                return

    def end(self):
        self.over.set()
        self.join(60)
        if self.problem is not None:
            raise self.problem


class Churn:
    """Topics of one robot that come and go."""

    def __init__(self, lab, host):
        self.lab, self.host, self.there = lab, host, set()
        lab.run(host, "cat > /run/giver.py; mkfifo -m 600 /run/orders", stdin=(NODES / "programs/giver.py").read_text())
        lab.start(host, "giver", f"python3 /run/giver.py {ADDRESSES[host]} {PORT}")
        lab.wait_until_ready(host, "giver")

    def turn(self):
        """Some topics go, others come."""
        go = set(random.sample(sorted(self.there), min(len(self.there), random.randint(0, 10))))
        rest = sorted(set(range(CHURN)) - self.there)
        come = set(random.sample(rest, min(len(rest), random.randint(0, 10))))
        for order, numbers in (("unregister", go), ("register", come)):
            name = self.host.replace("-", "_")
            wanted = [[f"/soak_{name}_{number % 5}", f"/soak/{name}/{number}"] for number in sorted(numbers)]
            self._order(order, wanted)
        self.there = self.there - go | come

    def _order(self, order, wanted):
        ask = f"import socket; s = socket.create_connection(('{ADDRESSES[self.host]}', {PORT})).makefile('rw'); "
        ask += "import sys; s.write(sys.stdin.read() + chr(10)); s.flush(); assert s.readline()"
        self.lab.run(self.host, f'python3 -c "{ask}"', stdin=json.dumps([order, wanted]))

    def topics(self):
        return {f"/soak/{self.host.replace('-', '_')}/{number}" for number in self.there}


def usage(lab, host, kind):
    return json.loads(
        lab.run(host, f"python3 - {' '.join(UNITS[kind])}", stdin=(NODES / "observers/usage.py").read_text())
    )


def known(lab, host):
    """The topics of the churn that a roscore knows."""
    ask = "import os, json, xmlrpc.client as x; r = x.ServerProxy(os.environ['ROS_MASTER_URI'])"
    code = f"{ask}; print(json.dumps([row[0] for row in r.getSystemState('/soak')[2][0]]))"
    return {topic for topic in json.loads(lab.run(host, f'python3 -c "{code}"')) if topic.startswith("/soak/")}


@pytest.fixture(scope="module")
def soaked():
    """The fleet after half an hour, the samples, and who churned."""
    with three_robots("long-soak") as lab:
        for here, there in (("ana", "bob"), ("bob", "ana"), ("cid", "ana")):
            chat(lab, here, there)
        wait_until(lambda: all(message_times(lab, "bob").values()), 60, "bob hears")
        churns = [Churn(lab, host) for host in ADDRESSES]
        samples, began = [], time.monotonic()

        def sample():
            found = {host: {kind: usage(lab, host, kind) for kind in UNITS} for host in ADDRESSES}
            samples.append({"at": time.monotonic() - began, **found})

        def leave():
            cut(lab, LEAVER)
            time.sleep(AWAY)
            repair(lab, LEAVER)

        def kill():
            lab.run("ana-pc", "systemctl kill --signal=KILL multimaster-roscore")

        jobs = [Every(SAMPLES, sample), Every(LEAVES - AWAY, leave), Every(KILLS, kill)]
        jobs += [Every(1.0, churn.turn) for churn in churns]
        for job in jobs:
            job.start()
        time.sleep(60 * MINUTES)
        for job in reversed(jobs):
            job.end()
        WORK.mkdir(parents=True, exist_ok=True)
        (WORK / "soak.json").write_text(json.dumps(samples) + "\n")
        draw(samples, WORK / "soak.svg")
        yield lab, samples, churns


def draw(samples, path):
    """The holdings of each service of each robot over the time."""
    import matplotlib

    matplotlib.use("svg")
    from matplotlib import pyplot

    figure, places = pyplot.subplots(len(FLAT), 1, figsize=(8, 6), sharex=True, layout="constrained")
    for place, (what, factor) in zip(places, {"bytes": 1e-6, "threads": 1, "descriptors": 1}.items(), strict=True):
        for host in ADDRESSES:
            for kind in UNITS:
                values = [sample[host][kind][what] * factor for sample in samples]
                place.plot([sample["at"] / 60 for sample in samples], values, label=f"{host}: {kind}")
        place.set(ylabel="MB" if what == "bytes" else what, ylim=(0, None))
        place.grid(alpha=0.3)
    places[0].legend(ncols=2, frameon=False, fontsize=8)
    places[-1].set_xlabel("minutes")
    figure.savefig(path, metadata={"Date": None})
    pyplot.close(figure)


@pytest.mark.parametrize("what", FLAT)
@pytest.mark.parametrize("kind", UNITS)
@pytest.mark.parametrize("host", ADDRESSES)
def test_nothing_grows(soaked, host, kind, what):
    _lab, samples, _churns = soaked
    # A roscore that was just killed holds nothing.
    values = [sample[host][kind][what] for sample in samples if sample[host][kind]["processes"]]
    sixth = max(1, len(values) // 6)
    early, late = statistics.median(values[sixth : 2 * sixth]), statistics.median(values[-sixth:])
    share, more = FLAT[what]
    assert late <= early * share + more, f"{what} of {kind} on {host}: {early:.0f}, {late:.0f} at the end"


def test_nothing_is_lost(soaked):
    lab, _samples, churns = soaked
    wanted = set().union(*(churn.topics() for churn in churns))
    for host in (*ADDRESSES, LEAVER):
        wait_until(lambda host=host: known(lab, host) == wanted, 30, f"{host} knows what there is, and nothing else")


def test_messages_flow(soaked):
    lab, _samples, _churns = soaked
    for here in ("ana", "bob"):
        since = time.monotonic()
        wait_until(
            lambda here=here, since=since: all(t and t[-1] > since for t in message_times(lab, here).values()), 20, here
        )
