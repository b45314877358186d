# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

DOCUMENTATION = r"""
module: firewall
short_description: A packet filter that lets the fleet in, at run time and at boot
version_added: "1.0.0"
description:
  - Protects the TCP and UDP ports 1024 to 65535 of this computer, on which ROS listens, from everybody but O(members).
    On a gateway or router it protects those of the O(networks) behind it in the same way.
  - If C(ufw) or C(firewalld) is active, it speaks to that one. Otherwise it has a table of its own in C(nftables), which is
    replaced in one transaction, and a small unit that loads it at boot before the network is there. Foreign rules stay.
  - Ports below 1024, ICMP and IGMP are not touched but by O(guards), and neither are connections that are there already.
    Ports of ssh are not touched either, so foreign rules decide about them. These are the ports on which a server of ssh of
    root listens, the port of this connection and O(ssh_ports).
  - Rules of ours that a person or a program has removed come back. With empty O(members) everything of ours is removed.
  - If the controller comes by something else than ssh, on a port that would be closed, the module fails before anything changes.
  - With O(confirm_within), a change that cuts the controller off is taken back by the machine itself.
extends_documentation_fragment:
  - rosfleet.multimaster.attributes
  - rosfleet.multimaster.confirmation
options:
  members:
    description:
      - The addresses and networks that are let in, for example V([192.168.1.229, 192.168.1.239]); V([]) removes everything of ours.
    type: list
    elements: str
    required: true
  also:
    description:
      - Further addresses and networks that may send to it, for example V([192.168.2.201]). They count only if O(members) is not empty.
    type: list
    elements: str
    default: []
  networks:
    description:
      - The networks behind this computer that are protected as well, for example V([192.168.11.0/24]).
    type: list
    elements: str
    default: []
  guards:
    version_added: "1.1.0"
    description:
      - Networks whose addresses come in at one interface only, for all senders. Packets that come in elsewhere with such a source are
        dropped, whether they are for this computer or to be passed on, and whatever their port and protocol are.
      - They are in our table of C(nftables) with each O(backend), so C(nft) has to be there.
    type: list
    elements: dict
    default: []
    suboptions:
      networks:
        description:
          - The networks, of IPv4 or IPv6, for example V([192.168.11.0/24]).
        type: list
        elements: str
        required: true
      interface:
        description:
          - The name of their interface, for example V(eth1). It need not be there yet.
        type: str
        required: true
  open_ports:
    description:
      - Ports that stay open to everybody, each with its protocol, for example V([51820/udp]).
    type: list
    elements: str
    default: []
  ssh_ports:
    description:
      - Further TCP ports of ssh that are not touched, for example V([2222]).
        Without the option, they are those that the inventory names (C(ansible_port)).
    type: list
    elements: int
    default: []
  backend:
    description:
      - The program that filters the packets, for example V(nftables).
    type: str
    default: auto
    choices:
      auto: The first that is active.
      ufw: Rules of ufw with a comment of ours, above foreign ones.
      firewalld: Two policies of firewalld (0.9 or later), which are asked before every zone.
      nftables: A table of our own.
  records:
    description:
      - The folder of the record of our rules, for example V(/var/lib/rosfleet-multimaster).
    type: path
    default: /var/lib/rosfleet-multimaster
author:
  - rosfleet contributors (@rosfleet)
seealso:
  - module: rosfleet.multimaster.multimaster_computer
  - module: rosfleet.multimaster.sysctl
"""

EXAMPLES = r"""
- name: Let only two robots and a laptop in
  rosfleet.multimaster.firewall:
    members: [192.168.1.229, 192.168.1.239, 192.168.1.50]
    confirm_within: 60

- name: Protect the network behind a gateway, too
  rosfleet.multimaster.firewall:
    members: [192.168.1.201, 192.168.11.100, 192.168.11.101]
    networks: [192.168.11.0/24]
    guards:
      - networks: [192.168.11.0/24]
        interface: eth1
    confirm_within: 60

- name: Take everything back
  rosfleet.multimaster.firewall:
    members: []
"""

RETURN = r"""
backend:
  description: The program that filters the packets, null if none of our rules are to be there.
  returned: always, unless an option is wrong
  type: str
  sample: nftables
members:
  description: The result per address or network that may send to it.
  returned: always, unless an option is wrong
  type: list
  elements: dict
  contains:
    address:
      description: The address or network in normal form.
      type: str
      returned: always
      sample: 192.168.1.229
    changed:
      description: Whether our rules did not have it before the run.
      type: bool
      returned: always
      sample: true
    state:
      description: V(ok) or V(changed).
      type: str
      returned: always
      sample: changed
networks:
  description: The result per protected network.
  returned: always, unless an option is wrong
  type: list
  elements: dict
  contains:
    address:
      description: The network in normal form.
      type: str
      returned: always
      sample: 192.168.11.0/24
    changed:
      description: Whether our rules did not have it before the run.
      type: bool
      returned: always
      sample: true
    state:
      description: V(ok) or V(changed).
      type: str
      returned: always
      sample: changed
guards:
  version_added: "1.1.0"
  description: The result per guard.
  returned: always, unless an option is wrong
  type: list
  elements: dict
  contains:
    networks:
      description: The networks in normal form.
      type: list
      elements: str
      returned: always
      sample: [192.168.11.0/24]
    interface:
      description: The interface at which their addresses come in.
      type: str
      returned: always
      sample: eth1
    changed:
      description: Whether the guards change.
      type: bool
      returned: always
      sample: false
    state:
      description: V(ok) or V(changed).
      type: str
      returned: always
      sample: ok
open_ports:
  description: The ports from 1024 up that this module leaves open to all, those of ssh among them.
  returned: always, unless an option is wrong
  type: list
  elements: str
  sample: [2222/tcp]
removed:
  description: The back ends from which our rules were removed.
  returned: always, unless an option is wrong
  type: list
  elements: str
  sample: []
notes:
  description: Sentences about changes by hand.
  returned: always, unless an option is wrong
  type: list
  elements: str
  sample: []
unconfirmed:
  description: Whether the change waits for its confirmation, with O(confirm_within); the controller's result is never this one.
  returned: always, unless an option is wrong
  type: bool
  sample: false
confirm_within:
  version_added: "1.1.0"
  description: Seconds for which the machine waits for the confirmation, more than was asked for after a slow run, and 0 if nothing waits.
  returned: always, unless an option is wrong
  type: int
  sample: 60
confirmed:
  description: Whether the controller confirmed the change over a new connection, with O(confirm_within).
  returned: when it did
  type: bool
  sample: true
rolled_back:
  description: Whether the change was taken back, because it was not confirmed in time or could not be completed.
  returned: failed
  type: bool
  sample: true
same_connection:
  description: Whether the confirming run came over the connection from before the change, which proves nothing.
  returned: with O(confirmation), when it did
  type: bool
  sample: true
msg:
  description: The changes, in a sentence.
  returned: always
  type: str
  sample: "The rules of nftables were changed: 4 addresses are let in, 0 networks behind this computer are protected."
"""

from ..module_utils._apply.firewall.run import CONCERN
from ..module_utils._apply.transaction.module import run_module


def main() -> None:
    run_module(CONCERN)


if __name__ == "__main__":
    main()
