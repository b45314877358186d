# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

DOCUMENTATION = r"""
module: multimaster_packet_trace
short_description: Trace packets from computer to computer, and report the place at which they vanish
version_added: "1.0.0"
description:
  - The packet trace of a verification. Several computers listen while some of them send once more the packets that did not arrive. Each reports
    which of these packets came in and went out, by which interface, from and to which hardware address.
  - It takes three tasks. With O(action=listen), a listener is left running. With O(action=send), the computer sends its
    O(probes). With O(action=collect), the listener reports the packets that it saw, and ends. Use the C(linear) strategy (the default), so that a
    task is through on every computer before the next one begins.
  - A listener sees only packets of this O(run), ICMP errors and ARP messages, 500 of each protocol at most and 100 of one sender.
    It is in no promiscuous mode, and ends by itself after O(lifetime), also if the controller has vanished.
  - Version 1.0.0 called it C(multimaster_follow), a name that works as before.
extends_documentation_fragment:
  - rosfleet.multimaster.attributes.probe
attributes:
  check_mode:
    support: full
    details: It does the same in check mode, since it changes nothing.
options:
  action:
    description:
      - With V(listen), a listener begins; an older one of this computer ends.
      - With V(send), this computer sends those of O(probes) whose C(sender) is O(name).
      - With V(collect), the listener of the same O(run) reports the packets that it saw, and ends.
    type: str
    choices: [listen, send, collect]
    required: true
  run:
    description:
      - The label of the run, for example V(verify-1730000000), of 1 to 64 letters, digits, dots, hyphens and underscores. The tag of
        its packets is made of it.
    type: str
    required: true
  name:
    description: The name of this computer, as in O(probes[].sender), for example V(kobuki1computer).
    type: str
    default: ""
  probes:
    description: The packets to send, by all computers of the run; 16 at most.
    type: list
    elements: dict
    default: []
    suboptions:
      number:
        description: The number of the probe, from 0 to 255, for example V(3).
        type: int
        required: true
      sender:
        description: The computer that sends it, for example V(kobuki1computer).
        type: str
        required: true
      target:
        description: The computer for which it is, for example V(kobuki2computer). Not read; accepted so that
          RV(rosfleet.multimaster.fleet_packet_trace#module:probes) can be given as it is.
        type: str
        default: ""
      traffic:
        description: The kind of packets that failed, for example V(rpc). Not read; accepted as O(probes[].target) is.
        type: str
        default: ""
      protocol:
        description:
          - V(icmp) for echo requests, V(udp) for datagrams, V(tcp) for a connection in which a question is asked.
        type: str
        choices: [icmp, udp, tcp]
        required: true
      address:
        description: The IPv4 address to which it is sent, for example V(192.168.1.239), or that of a multicast group.
        type: str
        required: true
      port:
        description: The port to which it is sent, for example V(11311); without a meaning for V(icmp).
        type: int
        default: 0
      size:
        description: The bytes of the IPv4 packet of an echo request, for example V(1500); as small as possible with V(0).
        type: int
        default: 0
      interface_address:
        description: For a datagram, the IPv4 address from which it is sent, for example V(192.168.1.229). The kernel chooses, if empty.
        type: str
        default: ""
  lifetime:
    description: How many seconds a listener lives at most, for example V(30); from 1 to 120.
    type: int
    default: 30
notes:
  - The return values have one level of fields here, each with its first sentence. All fields, sentences and examples are in
    C(plugins/module_utils/_contract) of the collection.
author:
  - rosfleet contributors (@rosfleet)
seealso:
  - module: rosfleet.multimaster.fleet_packet_trace
  - module: rosfleet.multimaster.multimaster_verify
  - name: Verification
    description: The role that uses it, with C(verify_packet_trace).
    link: https://github.com/rosfleet/multimaster/tree/main/docs/operate/verification.md
"""

EXAMPLES = r"""
- name: Follow a connection from one robot to another
  hosts: robots
  gather_facts: false
  become: true
  module_defaults:
    rosfleet.multimaster.multimaster_packet_trace:
      run: morning
      name: "{{ inventory_hostname }}"
      probes:
        - {number: 0, sender: kobuki1computer, protocol: tcp, address: 192.168.1.239, port: 11311}
  tasks:
    - name: Listen
      rosfleet.multimaster.multimaster_packet_trace:
        action: listen

    - name: Send
      rosfleet.multimaster.multimaster_packet_trace:
        action: send

    - name: Show the packets that were seen
      rosfleet.multimaster.multimaster_packet_trace:
        action: collect
      register: followed
"""

RETURN = r"""
sent:
  description: The fate of each probe of this computer, as far as it knows itself.
  returned: when O(action=send)
  type: list
  elements: dict
  contains:
    number: {description: The number of the probe., type: int}
    outcome: {description: 'The outcome as one word, as RV(rosfleet.multimaster.multimaster_verify#module:members) has it,
          for example V(refused).', type: str}
    errno: {description: 'The number of the kernel''s error, for example V(99) (EADDRNOTAVAIL); none without an error.',
        type: int}
    source_port: {description: 'The local port, or V(0).', type: int}
    data: {description: 'The outcome of a question in an open connection, as one word.', type: str}
    unconfirmed: {description: The number of packets of this question that the other kernel has not confirmed., type: int}
seen:
  description: The packets that came in and went out here, in the order of time, 500 of each protocol at most, and
    100 of one sender among them.
  returned: when O(action=collect)
  type: list
  elements: dict
  contains:
    interface: {description: The interface., type: str}
    outgoing: {description: 'Whether it went out, and did not come in.', type: bool}
    kind: {description: 'V(request), V(answer), or V(error) for an ICMP error that quotes the packet.', type: str}
    protocol: {description: 'V(icmp), V(tcp), V(udp) or V(arp).', type: str}
    source: {description: The IPv4 address of the sender; of an ICMP error that of the quoted packet., type: str}
    destination: {description: The IPv4 address of the receiver; of an ARP message the one that is asked for., type: str}
    source_port: {description: 'The port of the sender, or V(0).', type: int}
    port: {description: 'The port of the receiver, or V(0).', type: int}
    number: {description: The number of the probe in echo requests and datagrams; else V(-1)., type: int}
    sequence: {description: The first sequence number of a connection., type: int}
    ttl: {description: The time to live with which it was seen., type: int}
    length: {description: The bytes of the IPv4 packet., type: int}
    intact: {description: Whether its IPv4 header has the right checksum., type: bool}
    source_mac: {description: The hardware address from which it came; empty on an interface without such addresses., type: str}
    target_mac: {description: The hardware address to which it went., type: str}
    icmp_type: {description: The type of an ICMP error; else V(-1)., type: int}
    icmp_code: {description: The code of an ICMP error; else V(-1)., type: int}
    reporter: {description: The address that has sent an ICMP error; else empty., type: str}
missed:
  description: How many packets came beyond the 500 of a protocol, also those for which the kernel had no room.
  returned: when O(action=collect)
  type: int
  sample: 0
full:
  description: The addresses that have sent more than 100 packets of a protocol, of which no more were kept, for
    example V([192.168.1.77]).
  returned: when O(action=collect)
  type: list
  elements: str
  sample: []
counters:
  description: Counters of packets that were given up which have grown meanwhile, 60 at most. They are those of
    C(/proc/net/snmp), C(/proc/net/netstat), C(/proc/net/dev) and conntrack, rules of nftables that drop or reject
    and count, and the reasons for which the kernel has dropped packets of IPv4 or ARP (C(skb:kfree_skb) in C(/sys/kernel/tracing),
    since Linux 5.17).
  returned: when O(action=collect)
  type: list
  elements: dict
  contains:
    counter: {description: 'The name of the counter, the rule, or the reason as C(drop reason NETFILTER_DROP).', type: str}
    more: {description: By how much it has grown., type: int}
fixed:
  description: The hardware addresses of neighbours that a person or a program has set.
  returned: when O(action=collect)
  type: list
  elements: str
  sample: []
msg:
  description: The result, in a sentence.
  returned: always
  type: str
  sample: Saw 14 packets.
"""

from ..module_utils._base import actions
from ..module_utils._base.module import Module
from ..module_utils._probe.trace.run import ACTIONS, find_wrong_option

PROBE = {
    "number": {"type": "int", "required": True},
    "sender": {"type": "str", "required": True},
    "target": {"type": "str", "default": ""},
    "traffic": {"type": "str", "default": ""},
    "protocol": {"type": "str", "choices": ["icmp", "udp", "tcp"], "required": True},
    "address": {"type": "str", "required": True},
    "port": {"type": "int", "default": 0},
    "size": {"type": "int", "default": 0},
    "interface_address": {"type": "str", "default": ""},
}
ARGUMENTS = {
    "action": {"type": "str", "choices": list(ACTIONS), "required": True},
    "run": {"type": "str", "required": True},
    "name": {"type": "str", "default": ""},
    "probes": {"type": "list", "elements": "dict", "default": [], "options": PROBE},
    "lifetime": {"type": "int", "default": 30},
}


def main() -> None:
    actions.carry_out(Module(argument_spec=ARGUMENTS, supports_check_mode=True), find_wrong_option, ACTIONS)


if __name__ == "__main__":
    main()
