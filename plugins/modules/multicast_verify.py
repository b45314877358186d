# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

DOCUMENTATION = r"""
module: multicast_verify
short_description: Measure who hears whom on a multicast group
version_added: "1.0.0"
description:
  - Sends and receives real UDP datagrams on the multicast group and port of the fleet, on a chosen interface, between
    all computers in the same seconds, and returns for every other computer whether it is heard, from which source
    address, whether it hears this computer, how much was lost, the round-trip time and the difference of the clocks.
  - Does the rounds of C(ping 224.0.0.1) of the report IRI-TR-15-1 as well, and lists the multicast groups of every
    interface.
  - It takes two tasks, so that any number of C(--forks) works. The first, with O(action=start), leaves a helper on
    every computer that sends a small datagram twice a second and counts those of the others. The second, with
    O(action=collect), lets the helper of this computer measure and returns the result. Use the C(linear) strategy
    (the default), so that the first task is through on every computer before the second begins.
  - The helper ends by itself when all helpers that it knows of have measured, or after O(lifetime). It opens no port
    of its own for the group. Its datagrams are empty, which a discovery node ignores silently, and it receives copies
    on a raw socket, so a discovery node of any user keeps its port, its datagrams, its log and its list of masters.
  - It is a measurement, so a missing computer is a result and no failure, unless O(fail_on_missing=true).
extends_documentation_fragment:
  - rosfleet.multimaster.attributes.probe
attributes:
  check_mode:
    support: full
    details: In check mode nothing is sent and no helper is started; the result is that of O(action=list).
options:
  action:
    description:
      - With V(list), only the memberships of every interface and the route to O(group) are returned; nothing is
        sent.
      - With V(start), a helper is left running on this computer; an older one of this computer is ended.
      - With V(collect), the helper of the same O(run) measures, and the result is returned.
      - V(listed), V(started) and V(collected) are the former words for the same, as C(state) is the former name of the option.
    type: str
    choices: [list, start, collect, listed, started, collected]
    aliases: [state]
    default: list
  run:
    description:
      - The label of the run, for example V(verify-1730000000), of 1 to 64 letters, digits, dots, hyphens and
        underscores. Helpers with another label are not understood. A secret label keeps others out.
    type: str
    default: default
  group:
    description:
      - The IPv4 multicast group to use, for example V(226.0.0.0) as upstream's nodes or V(224.0.0.1) as the report.
    type: str
    default: 226.0.0.0
  port:
    description:
      - The UDP port of the group, for example V(11511).
    type: int
    default: 11511
  interface_address:
    description:
      - The IPv4 address, for example V(192.168.1.229), of the interface of this computer to send and receive on.
      - Required unless O(action=list).
    type: str
  name:
    description:
      - The name of this computer as in O(computers), for example V(kobuki1computer).
      - Required unless O(action=list).
    type: str
  computers:
    description:
      - All computers of the fleet that are to hear each other on O(group), this one included.
      - Required unless O(action=list).
    type: list
    elements: dict
    suboptions:
      name:
        description: The name of the computer, for example V(kobuki2computer).
        type: str
        required: true
      address:
        description: The IPv4 address, for example V(192.168.1.239), from which the computer is to be heard.
        type: str
        required: true
      multicast:
        description:
          - Whether O(group) reaches the computer, for example V(false) for the master of a robot behind a gateway that
            does not pass multicast on. Such a computer and the others measure each other only by unicast.
        type: bool
        default: true
  rounds:
    description:
      - How many datagrams this computer sends to the group when it measures, for example V(20); from 1 to 1000.
    type: int
    default: 10
  interval:
    description:
      - The time between two of these datagrams in seconds, for example V(0.1); from 0.02 to 10.
        O(rounds) times O(interval) may be 120 seconds at most.
    type: float
    default: 0.2
  unicast:
    description:
      - Whether to send each datagram also to the address and O(port) of every other computer, for example V(true). It
        shows whether the network drops only the group, and lets computers that do not hear each other on the group
        exchange their counts.
    type: bool
    default: true
  icmp:
    description:
      - Whether to do the rounds of ICMP echo requests of the report too, for example V(false) for only UDP.
    type: bool
    default: true
  icmp_group:
    description:
      - The IPv4 multicast group for these requests, for example V(224.0.0.1), which every host is a member of.
    type: str
    default: 224.0.0.1
  lifetime:
    description:
      - How long a helper lives at most, in seconds, for example V(300); from 1 to 3600.
        It must cover the time from the first computer's first task to the last computer's second one.
    type: int
    default: 120
  fail_on_missing:
    description:
      - Whether to fail, with O(action=collect), when it is not proven for every other computer that it is heard and
        hears this one, for example V(true). The message names the computers and the likely causes.
    type: bool
    default: false
notes:
  - The return values have one level of fields here, each with its first sentence. All fields, sentences and examples are in
    C(plugins/module_utils/_contract) of the collection.
author:
  - rosfleet contributors (@rosfleet)
seealso:
  - module: rosfleet.multimaster.multimaster_verify
  - name: Guide
    description: The proof of the measurement, and how to read it.
    link: https://github.com/rosfleet/multimaster/tree/main/docs/operate/multicast_verify.md
"""

EXAMPLES = r"""
- name: Measure who hears whom
  hosts: robots
  gather_facts: false
  become: true
  module_defaults:
    rosfleet.multimaster.multicast_verify:
      run: morning
      group: 226.0.0.0
      port: 11511
      name: "{{ inventory_hostname }}"
      interface_address: "{{ multimaster_fleet.computers[inventory_hostname].address }}"
      computers: "{{ multimaster_fleet.listeners }}"
  tasks:
    - name: Compute the plan of the fleet
      rosfleet.multimaster.fleet_plan:
      run_once: true
      register: multimaster_fleet

    - name: List the multicast groups of every interface
      rosfleet.multimaster.multicast_verify:
        action: list

    - name: Listen on every computer
      rosfleet.multimaster.multicast_verify:
        action: start

    - name: Measure from every computer
      rosfleet.multimaster.multicast_verify:
        action: collect
        rounds: 20
        interval: 0.1
        fail_on_missing: true
"""

RETURN = r"""
memberships:
  description: The multicast groups of every interface, from C(/proc/net/igmp) and C(/proc/net/igmp6), without the
    helper's own membership.
  returned: always
  type: list
  elements: dict
  contains:
    interface: {description: The name of the interface., type: str}
    group: {description: The address of the group., type: str}
    users: {description: 'How many sockets, or parts of the kernel, are members.', type: int}
    family: {description: V(ipv4) or V(ipv6)., type: str}
    querier: {description: 'The IGMP version that the interface speaks, after the queries it last heard.', type: str}
udp:
  description: For every other computer, the result of UDP datagrams on the group and port.
  returned: when O(action=collect)
  type: list
  elements: dict
  contains:
    name: {description: The name of the other computer., type: str}
    address: {description: Its planned address., type: str}
    multicast: {description: 'Whether O(group) is to reach both computers, by O(computers[].multicast).', type: bool}
    heard_from: {description: 'Whether its datagrams to the group arrive here, on the planned interface.', type: bool}
    heard: {description: How many of them arrived since this computer's helper was started., type: int}
    source_address: {description: 'The source address of these datagrams, or null without any.', type: str}
    other_interfaces: {description: Other interfaces of this computer on which they arrive., type: list, elements: str}
    heard_by: {description: 'Whether the other computer heard this computer''s datagrams to the group while it measured, by
          its own count.', type: bool}
    loss: {description: 'The share of this computer''s datagrams to the group that the other did not hear, from 0 to 1.',
        type: float}
    own_source_address: {description: 'The source address from which the other computer sees this one, or null without an answer.', type: str}
    unicast: {description: 'Whether it received unicast datagrams from this computer on O(port), or null without an answer
          or with O(unicast=false).', type: bool}
    rtt_ms: {description: 'The round-trip time of unicast datagrams between the two helpers, in milliseconds, or null without
          an answer.', type: dict}
    clock_offset_s: {description: 'How many seconds the other computer''s clock is ahead of this one''s, or null without an answer.',
        type: float}
unexpected:
  description: Sources of datagrams on the group and port that are no computers of the fleet.
  returned: when O(action=collect)
  type: list
  elements: dict
  contains:
    address: {description: The source address., type: str}
    interface: {description: The interface on which they arrived., type: str}
    datagrams: {description: How many arrived since this computer's helper was started., type: int}
callers:
  description: The senders of empty datagrams to O(port) of this computer itself since the helper was started. A
    computer that has sent some and is not among them is seen from another address, or its datagrams are dropped.
  returned: when O(action=collect)
  type: list
  elements: dict
  contains:
    address: {description: The source address., type: str}
    datagrams: {description: How many arrived., type: int}
icmp:
  description: The rounds of ICMP echo requests. A host whose C(net.ipv4.icmp_echo_ignore_broadcasts) is 1, the
    kernel's default, never answers, though multicast works; and an answer says nothing on UDP and another group.
    Null with O(icmp=false).
  returned: when O(action=collect)
  type: dict
  contains:
    group: {description: The group that was asked., type: str}
    error: {description: 'Why the rounds could not be done, or null.', type: str}
    rounds: {description: At most five rounds., type: list, elements: dict}
    echo_ignore_broadcasts: {description: The value of C(net.ipv4.icmp_echo_ignore_broadcasts) on this computer; with 1 it does not answer
          the others., type: int}
send_errors:
  description: How many datagrams this computer's kernel refused to send, for example because of a firewall's output
    rule.
  returned: when O(action=collect)
  type: dict
  contains:
    count: {description: How many., type: int}
    last: {description: 'The destination and the error of the last one, or null.', type: str}
route:
  description: The interface by which a program's datagrams to the group leave, if it does not choose an interface
    itself.
  returned: always
  type: dict
  contains:
    device: {description: 'The interface, or null when there is no route.', type: str}
    source: {description: 'The source address, or null when there is no route.', type: str}
interface:
  description: The interface that has O(interface_address), or null when that option is not given.
  returned: always
  type: str
  sample: eth0
heard:
  description: The names of the computers that are heard.
  returned: when O(action=collect)
  type: list
  elements: str
  sample: [kobuki2computer]
missing:
  description: The names of the computers that are not heard, or that counted none of this computer's datagrams;
    if the group does not reach one of the two, by unicast.
  returned: when O(action=collect)
  type: list
  elements: str
  sample: []
unanswered:
  description: The names of the computers that are heard, but gave no count, so that it is unknown here whether
    they hear this one.
  returned: when O(action=collect)
  type: list
  elements: str
  sample: []
multicast_ok:
  description: Whether it is proven for every other computer that it is heard and hears this one, that is, none
    is missing or unanswered.
  returned: when O(action=collect)
  type: bool
  sample: true
msg:
  description: The result, in a sentence or a few; of missing computers also the likely causes.
  returned: always
  type: str
  sample: Every other computer (1) is heard on the group and hears this one.
"""

from ..module_utils._base import ends
from ..module_utils._base.module import Module
from ..module_utils._base.problem import Problem
from ..module_utils._probe.multicast import multicast


def main() -> None:
    module = Module(
        argument_spec=multicast.OPTIONS,
        required_if=multicast.REQUIRED_IF,
        supports_check_mode=True,
    )
    module.get_bin_path("ip", required=True)
    try:
        result = multicast.run_action(module.params, module.check_mode)
    except Problem as problem:
        ends.fail(module, msg=str(problem))
    if module.params["fail_on_missing"] and result.get("multicast_ok") is False:
        ends.fail(module, changed=False, **result)
    ends.leave(module, changed=False, **result)


if __name__ == "__main__":
    main()
