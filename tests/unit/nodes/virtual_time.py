# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Discoveries that talk over a network made of nothing: it loses what it is told to, and hours pass in a moment."""

import heapq
import itertools
import random

from rosfleet_multimaster.discovery.core.actions import Ask, MasterEvent, Send
from rosfleet_multimaster.discovery.core.discovery import Discovery
from rosfleet_multimaster.discovery.core.peer import Contact
from rosfleet_multimaster.protocol.messages import AnnouncedMaster
from rosfleet_multimaster.protocol.parameters import Settings

PORT, RPC = 11511, 11611
LATENCY = 0.001  # seconds
SYN = (0.0, 1.0, 3.0, 7.0)  # seconds after which TCP sends again while it connects,
DATA = (0.0, 0.2, 0.6, 1.4, 3.0)  # and afterwards


class Robot:
    """A discovery with its clock and its events."""

    def __init__(self, name, address, **settings):
        self.name, self.address, self.alive = name, address, True
        self.core = Discovery(Settings(**{"heartbeat_hz": 1.0, **settings}), [address], RPC)
        self.stamp, self.events, self.last_heard = 1000.0, [], {}

    @property
    def uri(self):
        return f"http://{self.name}:11311/"

    def master(self):
        monitor = f"http://{self.address}:{RPC}"
        return AnnouncedMaster(self.name, self.uri, monitor, "/master_discovery", self.stamp, self.stamp, True)

    def contact(self):
        return Contact(self.stamp, self.uri, self.name, "/master_discovery")


class World:
    """`lost(now, source, target)`: whether a packet is lost; a robot that is not `alive` hears and says nothing."""

    def __init__(self, robots, seed=0, lost=lambda now, source, target: False):
        self.robots = {robot.address: robot for robot in robots}
        self.chance, self.lost = random.Random(seed), lost
        self.now, self._queue, self._count = 0.0, [], itertools.count()
        for robot in robots:
            self.at(self.chance.random(), self.start, robot)

    def at(self, when, job, *arguments):
        heapq.heappush(self._queue, (when, next(self._count), job, arguments))

    def run(self, until):
        """Let time pass."""
        while True:
            ticks = [(robot.core.next_tick(), robot) for robot in self.robots.values() if robot.alive]
            due = min(ticks, key=lambda pair: pair[0], default=(until, None))
            if self._queue and self._queue[0][0] <= due[0]:
                when, _number, job, arguments = heapq.heappop(self._queue)
                if when > until:
                    self.at(when, job, *arguments)
                    break
                self.now = max(self.now, when)
                job(*arguments)
            elif due[0] > until or due[1] is None:
                break
            else:
                self.now = max(self.now, due[0])
                due[1].core.tick(self.now)
                self.carry_out(due[1])
        self.now = until

    def start(self, robot):
        robot.core.take_own_state(robot.master(), self.now)
        self.carry_out(robot)

    def carry_out(self, robot):
        while robot.core.actions:
            action = robot.core.actions.popleft()
            if isinstance(action, MasterEvent):
                robot.events.append((self.now, action.change, action.master))
            elif isinstance(action, Send) and robot.alive:
                targets = [action.host] if action.host else [*self.robots]
                for target in targets:
                    self.deliver(robot, target, action)
            elif isinstance(action, Ask):
                self.ask(robot, action)

    def deliver(self, robot, target, action):
        if target in self.robots and not self.passes(robot.address, target, self.now):
            return
        self.at(self.now + LATENCY, self.arrive, target, action.datagram, (robot.address, PORT), action.host is None)

    def arrive(self, target, datagram, source, multicast=True):
        """A datagram, also a spoofed one, arrives at a robot."""
        robot = self.robots.get(target)
        if robot is not None and robot.alive:
            robot.last_heard[source[0]] = self.now
            robot.core.datagram(datagram, source, multicast, self.now)
            self.carry_out(robot)

    def ask(self, robot, action):
        """masterContacts over TCP: connecting and the exchange each need a way there and back, and are tried again."""
        other = self.robots.get(action.key[0])
        end, now = self.now + action.limit, self.now
        for again in (SYN, DATA):
            tried = (now + after for after in again)
            now = next((at for at in tried if at < end and self.both_ways(robot, action.key[0], at)), None)
            if now is None:
                self.at(end, self.answered, robot, action, None, "timed out")
                return
        self.at(now + LATENCY, self.answered, robot, action, other.contact(), "")

    def both_ways(self, robot, address, at):
        there = address in self.robots and self.robots[address].alive
        return there and self.passes(robot.address, address, at) and self.passes(address, robot.address, at)

    def passes(self, source, target, at):
        return not self.lost(at, source, target)

    def answered(self, robot, action, contact, problem):
        if robot.alive:
            if contact is not None:
                robot.last_heard[action.key[0]] = self.now
            robot.core.take_contact(action.key, contact, problem, self.now)
            self.carry_out(robot)
