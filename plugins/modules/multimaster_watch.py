# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

DOCUMENTATION = r"""
module: multimaster_watch
short_description: Watch a computer of a fleet for a while, and report the losses and their times
version_added: "1.0.0"
description:
  - Watches values of this computer that cost little to read. These are the heartbeats of the discovery nodes of all masters (on the
    group, and by any way), the membership of the group, addresses and links, routes, kernel settings,
    services, the TCP ports of the discovery nodes, C(/etc/hosts) and steps of the clock.
  - The values of the first measurement are those to keep, so verify the fleet before. A value that differs is lost, and one that is
    as before has returned.
  - Some faults need minutes. An example is a switch with IGMP snooping and without a querier, which forgets a group after
    about 260 seconds.
  - It takes several tasks. O(action=start) leaves a process behind on the computer, each O(action=collect) asks it, and
    O(action=stop) ends it. The process ends by itself after O(lifetime), or ten minutes after the last question.
  - It joins no group, opens no port for others and sends nothing but a TCP connection every three seconds to each master.
extends_documentation_fragment:
  - rosfleet.multimaster.attributes.probe
attributes:
  check_mode:
    support: full
    details: It does the same in check mode, since it changes nothing.
options:
  action:
    description:
      - With V(start), a watch begins; an older one of this computer ends.
      - With V(collect), the watch of the same O(run) is asked, and the result is returned.
      - With V(stop), every watch of this computer ends.
      - V(started), V(collected) and V(stopped) are the former words for the same, as C(state) is the former name of the option.
    type: str
    choices: [start, collect, stop, started, collected, stopped]
    aliases: [state]
    required: true
  run:
    description: The label of the run, for example V(watch-1730000000), of 1 to 64 letters, digits, dots, hyphens and underscores.
    type: str
    default: default
  group:
    description: The IPv4 multicast group of discovery, for example V(226.0.0.0).
    type: str
    default: 226.0.0.0
  port:
    description: The UDP port of discovery, for example V(11511).
    type: int
    default: 11511
  addresses:
    description: The IPv4 addresses of this computer that are to stay, for example V([192.168.1.229]).
    type: list
    elements: str
    default: []
  masters:
    description:
      - The masters of the fleet, as M(rosfleet.multimaster.fleet_plan) returns them; that of this computer may be among them.
      - Of each entry are used C(computer) (its name), C(address) (the IPv4 address from which its heartbeats come) and
        C(rpc_port) (the TCP port of its discovery node).
    type: list
    elements: dict
    default: []
  services:
    description: The services that are to stay active, for example V([roscore, discovery]); each is the unit C(multimaster-<name>.service).
    type: list
    elements: str
    default: []
  settings:
    description: The kernel settings that are to stay, for example V([net.ipv4.ip_forward]).
    type: list
    elements: str
    default: []
  destinations:
    description: The destinations whose routes are to stay, for example V([default, 192.168.11.0/24]).
    type: list
    elements: str
    default: []
  until:
    description:
      - With O(action=collect), how long the watch has lasted when it answers, in seconds, for example V(30). It answers
        earlier if something is lost, and at once with V(0). From 0 to 604800; at most 600 seconds from now.
    type: int
    default: 0
  lifetime:
    description: How long the watch lives at most, in seconds, for example V(960); from 1 to 604800 (a week).
    type: int
    default: 900
notes:
  - The return values have one level of fields here, each with its first sentence. All fields, sentences and examples are in
    C(plugins/module_utils/_contract) of the collection.
author:
  - rosfleet contributors (@rosfleet)
seealso:
  - module: rosfleet.multimaster.multimaster_verify
  - name: Verification
    description: The role that uses it, with C(verify_watch).
    link: https://github.com/rosfleet/multimaster/tree/main/docs/operate/verification.md
"""

EXAMPLES = r"""
- name: Watch from now on
  rosfleet.multimaster.multimaster_watch:
    action: start
    addresses: [192.168.1.229]
    masters:
      - {computer: kobuki2computer, address: 192.168.1.239, rpc_port: 11611}
    services: [roscore, discovery, sync]
    lifetime: 960

- name: Wait until something is lost, or the first half minute is over
  rosfleet.multimaster.multimaster_watch:
    action: collect
    until: 30
  register: watched

- name: End the watch
  rosfleet.multimaster.multimaster_watch:
    action: stop
"""

RETURN = r"""
watched:
  description: How many values are watched.
  returned: when O(action=collect)
  type: int
  sample: 23
seconds:
  description: How long the watch has lasted, in seconds.
  returned: when O(action=collect)
  type: float
  sample: 312.4
events:
  description: The losses and returns, in the order of time, 500 at most.
  returned: when O(action=collect)
  type: list
  elements: dict
  contains:
    kind: {description: 'V(group) for heartbeats on the group and V(master) for those by any way, then V(membership), V(address),
          V(link), V(route), V(setting), V(service), V(port), V(hosts) and V(clock).', type: str}
    name: {description: 'The computer, interface, address, destination, setting, unit or file.', type: str}
    well: {description: Whether it has returned; false for a loss., type: bool}
    expected: {description: The first value., type: str}
    found: {description: The value since then., type: str}
    time: {description: 'The time on this computer''s clock, in seconds since 1970.', type: float}
    after: {description: 'How long after the start, in seconds.', type: float}
dropped:
  description: How many events there were beyond those of RV(events).
  returned: when O(action=collect)
  type: int
  sample: 0
lost:
  description: The values that are lost now.
  returned: when O(action=collect)
  type: list
  elements: dict
  contains:
    kind: {description: 'As in RV(events[].kind).', type: str}
    name: {description: 'As in RV(events[].name).', type: str}
msg:
  description: The result, in a sentence.
  returned: always
  type: str
  sample: 23 values are watched since 312 s; 1 of them is lost.
"""

import re
import typing

from ..module_utils._base import actions, background
from ..module_utils._base.module import Module
from ..module_utils._base.problem import Problem
from ..module_utils._machine.network import is_address
from ..module_utils._probe.multicast.packets import open_copies
from ..module_utils._probe.watch.process import serve

KIND = "watch"  # of the doors of watches
LONGEST = 600  # seconds that a task waits
ANSWER = 30  # seconds that a busy watch may take beyond that

Params = typing.Dict[str, typing.Any]
Result = typing.Dict[str, typing.Any]


def find_wrong_setting(params: Params) -> typing.Optional[str]:
    """Name in one sentence the option that cannot be used; None if all can."""
    bounds = (("port", 1, 65535), ("until", 0, 604800), ("lifetime", 1, 604800))
    return background.find_wrong_value(params, bounds) or find_wrong_place(params)


def find_wrong_place(params: Params) -> typing.Optional[str]:
    """Find a text that is no master, address or kernel setting, as a sentence; None if all are right."""
    for master in params["masters"]:
        absent = [key for key in ("computer", "address", "rpc_port") if key not in master]
        if absent or not str(master["rpc_port"]).isdigit():
            return f"masters has {master!r}, expected the keys computer, address, and rpc_port as a number."
    places = [("group", params["group"])] + [("addresses", address) for address in params["addresses"]]
    places += [(f"masters: the address of {master['computer']}", master["address"]) for master in params["masters"]]
    for place, address in places:
        if not is_address(address):
            return f"{place} is {address!r}, expected an IPv4 address such as 192.168.1.239."
    for name in params["settings"]:
        if not re.match(r"[A-Za-z0-9_./-]+\Z", name) or ".." in name:
            return f"settings has {name!r}, expected the name of a kernel setting such as net.ipv4.ip_forward."
    return None


def start_watch(params: Params, _check_mode: bool) -> Result:
    """Leave a watch behind. Its sockets are opened first, so an error shows in this task."""
    path = background.path_of(KIND, params["run"])
    with background.explain_refusal(f"Cannot watch the heartbeats on port {params['port']}"):
        background.end_others(KIND)
        raw = open_copies(params["port"])
        door = background.open_door(path)
    background.leave(lambda: serve(raw, door, path, params), (raw, door), "multimaster_watch")
    return {"msg": f"The watch lives for {params['lifetime']} s at most."}


def collect_losses(params: Params, _check_mode: bool) -> Result:
    """Ask the watch. It answers at the end of `until`, or as soon as a value is lost."""
    wait = min(params["until"], LONGEST) + ANSWER
    reply = background.ask(background.path_of(KIND, params["run"]), {"until": params["until"]}, wait)
    if not reply:
        raise Problem(
            f"No watch of the run {params['run']!r} lives on this computer: its task with action=start did not run, its "
            "lifetime was over, or the computer was started again."
        )
    lost = len(reply["lost"])
    verb = "is" if lost == 1 else "are"
    return dict(
        reply, msg=f"{reply['watched']} values are watched since {reply['seconds']:.0f} s; {lost} of them {verb} lost."
    )


def stop_watches(_params: Params, _check_mode: bool) -> Result:
    """End every watch of this computer."""
    with background.explain_refusal("Cannot end the watches of this computer"):
        background.end_others(KIND)
    return {"msg": "No watch lives here."}


ACTIONS = {"start": start_watch, "collect": collect_losses, "stop": stop_watches}
ARGUMENTS = {
    "action": {"type": "str", "choices": actions.list_words(*ACTIONS), "aliases": ["state"], "required": True},
    "run": {"type": "str", "default": "default"},
    "group": {"type": "str", "default": "226.0.0.0"},
    "port": {"type": "int", "default": 11511},
    "addresses": {"type": "list", "elements": "str", "default": []},
    "masters": {"type": "list", "elements": "dict", "default": []},
    "services": {"type": "list", "elements": "str", "default": []},
    "settings": {"type": "list", "elements": "str", "default": []},
    "destinations": {"type": "list", "elements": "str", "default": []},
    "until": {"type": "int", "default": 0},
    "lifetime": {"type": "int", "default": 900},
}


def main() -> None:
    actions.carry_out(Module(argument_spec=ARGUMENTS, supports_check_mode=True), find_wrong_setting, ACTIONS)


if __name__ == "__main__":
    main()
