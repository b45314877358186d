# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The fleets of the technical report, and the programs on two of their robots with the ports between them."""

from __future__ import annotations

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import ComputerPlan, FleetPlan
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.report.picture import draw_fleet

from .sheet import EDGE, LINE, WIDTH, Sheet, complete
from .shipped import find_master, read_plan

BOX = 134  # width of the box of a program
FRAME = BOX + 20


def _draw(name: str, figure: str, columns: int) -> str:
    fleet = read_plan(name)
    title = f"{figure} of the report: {len(fleet.master_of)} robots on the common network {fleet.common_network}"
    robots = (f"{robot}: {', '.join(_describe(fleet, robot))}" for robot in fleet.master_of)
    return complete(
        draw_fleet(fleet, width=WIDTH, columns=columns), title, f"Each robot has its own roscore. {'; '.join(robots)}."
    )


def _describe(fleet: FleetPlan, robot: str) -> list[str]:
    """Return the computers of a robot in words."""
    plans = (plan for plan in fleet.computers.values() if plan.robot == robot)
    duties = {"is_master": "master", "is_gateway": "gateway"}
    return [
        " ".join([plan.computer, str(plan.address), *(word for key, word in duties.items() if getattr(plan, key))])
        for plan in plans
    ]


def draw_single_computer() -> str:
    """Draw the robots of one computer."""
    return _draw("single_computer", "Fig. 5", 1)


def draw_multi_computer() -> str:
    """Draw the robots of several computers."""
    return _draw("multi_computer", "Fig. 10 and 12", 2)


def draw_programs() -> str:
    """Draw the programs of two robots: who talks with whom, and at which ports."""
    fleet = read_plan("single_computer")
    sheet, plans = Sheet(), [find_master(fleet, robot) for robot in fleet.master_of]
    left, right = (EDGE, WIDTH - EDGE - FRAME)
    ports = _list_ports(plans[0], fleet)
    for x, plan in zip((left, right), plans):
        rows = _draw_robot(sheet, x, plan, ports)
    nodes, discovery, sync, bottom = rows
    inner, outer, middle = left + 10 + BOX, right + 10, WIDTH / 2
    sheet.arrow(complex(inner, nodes), complex(outer, nodes), "line data", both=True)
    sheet.arrow(complex(inner, discovery), complex(outer, discovery), both=True)
    sheet.arrow(complex(inner, sync), complex(outer, discovery + 20))
    sheet.arrow(complex(outer, sync), complex(inner, discovery + 20))
    for y, what, how in (
        (nodes - 8, "messages", "directly"),
        (discovery - 8 - LINE, f"UDP {fleet.multicast_port}", "who is there"),
        (sync + 18, f"TCP {plans[0].discovery['rpc_port']}", "what is new"),
    ):
        sheet.text(middle, y, what, "middle on strong")
        sheet.text(middle, y + (2 * LINE - 8 if y < nodes else LINE), how, "middle on")
    sheet.stripe(EDGE, bottom + 24, WIDTH - 2 * EDGE)
    for x in (left, right):
        sheet.line(complex(x + FRAME / 2, bottom), complex(x + FRAME / 2, bottom + 24))
    sheet.text(middle, bottom + 52, f"common network {fleet.common_network}", "middle")
    title = f"The programs on {' and '.join(fleet.master_of)}, and the ports between them"
    return sheet.finish(
        int(bottom + 64),
        title,
        "Each robot has a roscore of its own. Discovery tells the other robots by UDP that the robot is there. Sync asks the "
        "other robot's discovery by TCP for what is new, and registers it in the own roscore. Messages go directly from node to node.",
    )


def _list_ports(plan: ComputerPlan, fleet: FleetPlan) -> dict[str, list[str]]:
    """Return what each program of a master's computer listens on; ValueError if the plan opens other ports."""
    rpc = int(plan.discovery["rpc_port"])
    listens = {"roscore": [("tcp", plan.roscore_port)], "discovery": [("udp", fleet.multicast_port), ("tcp", rpc)]}
    if sorted(port for ports in listens.values() for port in ports) != sorted(
        (port.protocol, port.port) for port in plan.ports
    ):
        raise ValueError(f"the picture of the programs lacks a port of {plan.ports}")
    return {name: [f"{protocol.upper()} {port}" for protocol, port in ports] for name, ports in listens.items()}


def _draw_robot(sheet: Sheet, x: float, plan: ComputerPlan, ports: dict[str, list[str]]) -> tuple[float, ...]:
    """Draw the programs of a robot; return the heights of nodes, discovery and sync, and the bottom of the frame."""
    inner, y = x + 10, 22.0
    for kind, line in (("strong", f"robot {plan.robot}"), ("soft", plan.computer), ("soft", str(plan.address))):
        sheet.text(inner, y + 8, line, kind)
        y += LINE
    middles: dict[str, float] = {}
    drawn = ("your nodes", "roscore", "discovery", "sync")
    y += 12
    for name in drawn:
        high = sheet.box(inner, y, BOX, [name, *ports.get(name, ())])
        middles[name] = y + high / 2
        y += high + (14 if name != "discovery" else 30)
        if name != "sync":
            sheet.line(complex(inner + BOX / 2, middles[name] + high / 2), complex(inner + BOX / 2, y))
    others = [name for name in plan.services if name not in drawn]
    for line in ("also services:", ", ".join(others[:2]), ", ".join(others[2:])):
        sheet.text(inner, y + 6, line, "soft")
        y += LINE
    sheet.frame(x, EDGE, FRAME, y - EDGE)
    return middles["your nodes"], middles["discovery"] - 10, middles["sync"], y
