# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The clock of a computer: its source, the files of chrony for that, and a user-managed time service, which stays.

Pure: the plan and a description of the machine in, files and sentences out. chrony runs as its Debian package has it, in the
package's unit and sandbox. A drop-in gives it another configuration, in a place where AppArmor's profile lets it read.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from ..._base.plain_text import LINE, plain, quote
from ..._inventory.model import Computer, Fleet, Robot
from ..._plan.hooks import PlanHooks
from ..._plan.model import ComputerPlan
from .inventory import find_source
from .model import Clock

PACKAGE = "chrony"
UNIT = "chrony.service"
# The first one that comes to the configuration of the package. A unit test compares it with multimaster_info.
CONFIGURATION = "/etc/chrony/rosfleet-multimaster.conf"
DROP_IN = f"/etc/systemd/system/{UNIT}.d/rosfleet-multimaster.conf"
STOCK = "/etc/chrony/chrony.conf"
# Seconds that the services of ROS wait at a start for a clock that is right. Some 3 if the source answers.
WAIT = 10

_HEADER = "# Managed by rosfleet.multimaster: the clock of this computer; the fleet follows {source}\n"
# A source keeps its own sources. If it reaches no source, it gives its own time (chrony.conf(5), local).
_SOURCE = """\
include {stock}
local stratum 10
{allowed}"""
# One source and no other, so all are right together or wrong together. It is asked each 4 to 16 s. The first three answers may
# set the clock by a step, which nodes do not see if the source answers at the start. Later it is made slower or faster.
_FOLLOWER = """\
server {server} iburst minpoll 2 maxpoll 4
driftfile /var/lib/chrony/chrony.drift
makestep 0.1 3
rtcsync
maxupdateskew 100.0
logdir /var/log/chrony
"""
_DROP_IN = """\
[Unit]
{condition}# Nodes start with stamps that are right.
Before=multimaster-roscore.service multimaster-discovery.service

[Service]
EnvironmentFile=
Environment="DAEMON_OPTS=-F 1{options} -f {configuration}"
# It waits for the source, and for nobody longer than this.
ExecStartPost=-/usr/bin/chronyc -n waitsync {wait} 0 0 1
"""
# In some containers systemd may not set the clock. chronyd follows and answers there, and sets nothing (chronyd(8), -x).
_UNSETTABLE = "ConditionCapability=\n"


def make_clock(fleet: Fleet, robot: Robot, computer: Computer) -> Clock | None:
    """Return the clock of a computer. It reaches a source of its own robot by the address there, any other one by that for others."""
    source = find_source(fleet)
    if source is None:
        return None
    if source != computer:
        return Clock(source.name, source.address if source.robot == robot.name else source.discovery_address)
    networks = [fleet.variables.common_network, *(other.network for other in fleet.robots), *fleet.variables.allow]
    return Clock(source.name, networks=tuple(dict.fromkeys(networks)))


def render_clock(clock: Clock | None) -> list[dict[str, str]]:
    """Return the files of chrony as managed_files takes them; an empty list without a source, or if a user-managed service is kept."""
    if clock is None or clock.kept:
        return []
    if clock.server is None:
        allowed = "".join(f"allow {network}\n" for network in clock.networks)
        text = _SOURCE.format(stock=STOCK, allowed=allowed)
    else:
        text = _FOLLOWER.format(server=clock.server)
    condition, options = ("", "") if clock.settable is not False else (_UNSETTABLE, " -x")
    header = _HEADER.format(source=plain(clock.source, LINE))
    drop_in = _DROP_IN.format(condition=condition, options=options, configuration=CONFIGURATION, wait=WAIT)
    return [{"path": CONFIGURATION, "content": header + text}, {"path": DROP_IN, "content": header + drop_in}]


def add_machine(clock: Clock, info: Mapping[str, Any]) -> Clock:
    """Return the clock with the facts of multimaster_info."""
    machine = info.get("clock")
    if machine is None:
        return clock
    kept = next((quote(other["service"]) for other in _list_others(clock, machine)), None)
    return replace(clock, kept=kept, settable=machine["settable"])


def list_clock_packages(plan: ComputerPlan, info: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the packages that the clock needs."""
    clock = Clock.find(plan)
    return () if clock is None or clock.kept else (PACKAGE,)


def _list_others(clock: Clock, machine: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """List the user-managed time services. A file that chrony's own one includes counts at the source, and is its own time there."""
    own = [
        other for other in machine["others"] if other["service"] == UNIT and other["file"].startswith("/etc/chrony/")
    ]
    return [other for other in machine["others"] if clock.server is not None or other not in own]


def list_clock_warnings(plan: ComputerPlan, info: Mapping[str, Any]) -> Iterator[str]:
    """Yield a sentence for a time service that stays, for a clock that cannot be set, and for a unit that does not start at boot."""
    clock, machine = Clock.find(plan), info.get("clock")
    if clock is None or machine is None:
        return
    others = _list_others(clock, machine)
    if others:
        role = f"the one that follows {clock.source}" if clock.server else "the source of the fleet's time"
        found = others[0]
        yield (
            f"{plan.computer}: {quote(found['service'])} has a configuration of its own ({quote(found['file'], LINE)}: {quote(found['line'], LINE)}), "
            f"and stays as it is; expected no other time service than {role}: {_advise(clock)}."
        )
        return
    if not machine["settable"]:
        yield (
            f"{plan.computer}: systemd may not set the clock, as in some containers; expected CAP_SYS_TIME for {UNIT}, which only measures: "
            "let the clock of the computer that runs the container follow the source."
        )
    if machine["chronyd"] and not machine["enabled"]:
        yield (
            f"{plan.computer}: {UNIT} does not start at boot; expected it to, so that the clock is right before nodes start: enable it, and run "
            "site.yml again."
        )


def _advise(clock: Clock) -> str:
    """Return the advice on a foreign time service."""
    if clock.server is None:
        return "let it answer the fleet as well, name another computer in multimaster_clock, or remove it and run site.yml again"
    return f"let it follow {clock.server}, or remove it and run site.yml again"


HOOKS = PlanHooks(
    make_part=make_clock,
    list_facts=lambda fleet: ("clock",) if find_source(fleet) else (),
    list_warnings=list_clock_warnings,
    fill=lambda plan, clock, info: add_machine(clock, info),
    list_packages=list_clock_packages,
)
