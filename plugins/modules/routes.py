# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

DOCUMENTATION = r"""
module: routes
short_description: Routes, at run time and at boot
version_added: "1.0.0"
description:
  - Makes routes now, in the kernel, and brings them back at boot, by whatever manages the interface of each route.
    Both are one resource with one result per route.
  - A route takes the place of another one in one step, and a route that moves to another metric or table is added before
    the old one is removed, so that there is no moment without a route.
  - Foreign routes, made by a person or another program, stay. One that is already as wanted is adopted, which means that it is brought back at boot,
    and that it stays when it is no longer listed. One with the same destination, table and metric and another way
    is a conflict, see O(on_conflict). The routes that the kernel makes for the addresses of an interface are never replaced.
  - The routes of this module are recorded. A route that is no longer listed is taken back, so that an empty list takes back everything,
    and gives their place back to the routes that it had replaced.
  - When something fails half way, everything is put back, the kernel's routes and the files.
  - With O(confirm_within), a change that cuts the controller off is taken back by the machine itself.
notes:
  - Routes of this module have C(proto static), as those of systemd-networkd and NetworkManager.
  - With C(ifupdown), the routes are in the hook C(/etc/network/if-up.d/rosfleet-multimaster), which C(ifup) runs.
  - With C(networkd), they are in a drop-in C(90-rosfleet-multimaster.conf) of the C(.network) file that configures the interface.
    systemd-networkd is then restarted. By itself that would delete foreign addresses, routes and rules, so files below C(/run/systemd)
    let it keep all that it finds (C(KeepConfiguration=static), C(ManageForeignRoutes=no), C(ManageForeignRoutingPolicyRules=no)).
    They are in force until the next boot.
  - Before systemd 249, and if an interface of systemd-networkd has an address by DHCP or router advertisements, or may get one,
    systemd-networkd is not restarted. It reads the routes at the next boot, and a warning says so.
  - With C(networkmanager), they are added to the profile that is active on the interface. NetworkManager then writes the file of that
    profile anew, so comments in it are lost.
  - With C(netplan), they are in C(/etc/netplan/zz-rosfleet-multimaster.yaml).
  - Needs the command C(ip) (iproute2).
extends_documentation_fragment:
  - rosfleet.multimaster.attributes
  - rosfleet.multimaster.confirmation
options:
  routes:
    description:
      - The routes that this computer shall have; V([]) takes back everything that this module made.
    type: list
    elements: dict
    required: true
    suboptions:
      destination:
        description:
          - The network or the address that the route leads to, for example V(192.168.11.0/24), V(fd00:11::/64) or V(192.168.1.5).
          - V(default) is the default route of IPv4, as is V(0.0.0.0/0); that of IPv6 is V(::/0).
        type: str
        required: true
      gateway:
        description:
          - The address of the next computer on the way, for example V(192.168.1.201). Without it the destination is on the link itself.
        type: str
      device:
        description:
          - The interface, for example V(eth0). The default is the interface with the network that holds O(routes[].gateway).
          - For a type without a way, such as V(blackhole), it is the interface with which the route comes back at boot;
            the default is that of another route of the list.
        type: str
      metric:
        description:
          - The metric, for example V(100); of several routes to a destination the one with the lowest metric is taken.
          - The default is the kernel's, which is V(0) with IPv4 and V(1024) with IPv6.
        type: int
      table:
        description:
          - The routing table by its number or its name, for example V(100) or V(robots); V(254) is the table V(main), which is always
            asked. Names are those of C(rt_tables) and C(rt_tables.d) below C(/usr/share/iproute2) and C(/etc/iproute2). What
            brings the route back at boot gets the number.
        type: str
        default: "254"
      source:
        description:
          - The address of this computer that it prefers as the sender on this way, for example V(192.168.11.100).
        type: str
      on_link:
        description:
          - Whether the gateway is on the link of O(routes[].device) though no network of that interface holds it, for example V(true).
        type: bool
        default: false
      type:
        description:
          - The fate of packets that are sent there, for example V(blackhole).
        type: str
        default: unicast
        choices:
          unicast: It goes its way.
          blackhole: It is dropped in silence.
          unreachable: It is refused with the answer that the destination cannot be reached.
          prohibit: It is refused with the answer that it is forbidden.
          throw: This table has no answer, so that the next rule decides.
      scope:
        description:
          - How far the destination is, with IPv4, for example V(link). The default is the kernel's, V(link) without a gateway, else V(global).
        type: str
        choices:
          global: Behind other computers.
          link: On the link itself.
          host: On this computer.
      mtu:
        description:
          - The size in bytes of the largest packet on this way, for example V(1400). By default the kernel finds it out itself.
        type: int
      advmss:
        description:
          - The size in bytes of the largest TCP segment that is asked of the other side on this way, for example V(1360).
            netplan and NetworkManager cannot bring it back at boot.
        type: int
      initcwnd:
        description:
          - How many segments of a TCP connection are sent on this way before the first answer, for example V(20).
        type: int
      backend:
        description:
          - The program that brings the route back at boot, for example V(none).
        type: str
        default: auto
        choices:
          auto: The program that O(backends) names for the interface, else the one that manages the interface now.
          ifupdown: The hook of C(ifup).
          networkd: systemd-networkd.
          networkmanager: NetworkManager.
          netplan: netplan, with whatever it configures.
          none: Nothing, the route is made at run time only.
  backends:
    description:
      - The program that brings the routes of an interface back at boot, by interface, if it cannot be found out, for example
        V(ifupdown) for C(eth0). The values are those of O(routes[].backend).
    type: dict
    default: {}
  on_conflict:
    description:
      - What to do if there is a foreign route with the same destination, table and metric and another way, for example V(replace).
        A route from the configuration of systemd-networkd, NetworkManager or netplan is not replaced, since they would make both at boot.
    type: str
    default: fail
    choices:
      fail: Fail before anything changes, naming that route.
      replace: Take its place at run time, and give it back when the route is no longer listed.
  root:
    description:
      - The root folder of the files of the boot part, for example V(/mnt/image) for the image of a machine, if O(backends)
        has to be given. Routes at run time and the record are those of the running machine, not of the image.
    type: path
    default: /
  records:
    description:
      - The folder of the record of the routes of this module, for example V(/var/lib/rosfleet-multimaster).
    type: path
    default: /var/lib/rosfleet-multimaster
seealso:
  - module: rosfleet.multimaster.sysctl
  - module: rosfleet.multimaster.multimaster_info
author:
  - rosfleet contributors (@rosfleet)
"""

EXAMPLES = r"""
- name: The default gateway of section 4.2 of the report, on a computer inside the robot tibi
  rosfleet.multimaster.routes:
    routes:
      - destination: default
        gateway: 192.168.11.101
    confirm_within: 30

- name: A way with smaller packets, in the table that /etc/iproute2/rt_tables.d names robots
  rosfleet.multimaster.routes:
    routes:
      - destination: 192.168.10.0/24
        gateway: 192.168.1.202
        table: robots
        mtu: 1400

- name: The static routes of the router
  rosfleet.multimaster.routes:
    routes:
      - destination: 192.168.11.0/24
        gateway: 192.168.1.201
      - destination: 192.168.10.0/24
        gateway: 192.168.1.202

- name: Multicast by the wire whatever the default route is, and packets for no robot go nowhere
  rosfleet.multimaster.routes:
    routes:
      - destination: 226.0.0.0/8
        device: eth0
      - destination: 192.168.0.0/16
        type: blackhole

- name: Take everything back
  rosfleet.multimaster.routes:
    routes: []
"""

RETURN = r"""
routes:
  description: The result per route, in the order of the list.
  returned: always, unless an option is wrong
  type: list
  elements: dict
  contains:
    destination:
      description: The destination in normal form.
      type: str
      returned: always
      sample: default
    gateway:
      description: The next computer on the way, null if the destination is on the link or there is no way.
      type: str
      returned: always
      sample: 192.168.11.101
    device:
      description: The interface, also if it was found by the gateway; null for a type without a way.
      type: str
      returned: always
      sample: eth0
    metric:
      description: The metric.
      type: int
      returned: always
      sample: 0
    table:
      description: The routing table.
      type: int
      returned: always
      sample: 254
    source:
      description: The preferred address of the sender, null if the kernel chooses.
      type: str
      returned: always
      sample: 192.168.11.100
    on_link:
      description: Whether the gateway is taken to be on the link.
      type: bool
      returned: always
      sample: false
    scope:
      description: The scope, null for the kernel's own choice.
      type: str
      returned: always
      sample: link
    mtu:
      description: The size of the largest packet in bytes, null if the kernel finds it out.
      type: int
      returned: always
      sample: 1400
    advmss:
      description: The size of the largest TCP segment in bytes that is asked of the other side, null if the kernel chooses.
      type: int
      returned: always
      sample: 1360
    initcwnd:
      description: The number of TCP segments that are sent before the first answer, null if the kernel chooses.
      type: int
      returned: always
      sample: 20
    type:
      description: The type of the route.
      type: str
      returned: always
      sample: unicast
    backend:
      description: The program that brings it back at boot.
      type: str
      returned: always
      sample: ifupdown
    before:
      description: The kernel's route with this destination, table and metric before the run, as C(ip route) writes it; null for none.
      type: str
      returned: always
      sample: default via 192.168.11.1 dev eth0 proto static
    after:
      description: The same after the run, in check mode the planned one.
      type: str
      returned: always
      sample: default via 192.168.11.101 dev eth0 proto static
    boot_file:
      description: The file or the profile that brings it back at boot; null with the back end V(none).
      type: str
      returned: always
      sample: /etc/network/if-up.d/rosfleet-multimaster
    changed:
      description: Whether the kernel's route changed, or its place for the next boot.
      type: bool
      returned: always
      sample: true
    state:
      description:
        - V(ok) or V(changed), or why it is not made. V(conflict) means that a foreign one is in its place,
          V(refused) that the one in its place is never replaced.
      type: str
      returned: always
      sample: changed
    problem:
      description: The sentence for a route that is not made, else null.
      type: str
      returned: always
      sample:
conflicts:
  description: One sentence per conflict that O(on_conflict) decides.
  returned: always, unless an option is wrong
  type: list
  elements: str
  sample: []
taken_back:
  description: The routes that are no longer listed.
  returned: always, unless an option is wrong
  type: list
  elements: dict
  contains:
    destination:
      description: The destination.
      type: str
      returned: always
      sample: 192.168.11.0/24
    gateway:
      description: The next computer on the way, null for none.
      type: str
      returned: always
      sample: 192.168.1.201
    device:
      description: The interface, null for none.
      type: str
      returned: always
      sample: eth0
    metric:
      description: The metric.
      type: int
      returned: always
      sample: 0
    table:
      description: The routing table.
      type: int
      returned: always
      sample: 254
    type:
      description: The type of the route.
      type: str
      returned: always
      sample: unicast
    before:
      description: The kernel's route of this key before the run, null for none.
      type: str
      returned: always
      sample: 192.168.11.0/24 via 192.168.1.201 dev eth0 proto static
    after:
      description: The same after the run, null for none.
      type: str
      returned: always
      sample:
    state:
      description:
        - V(removed), V(restored) if the route came back that had been replaced, V(lost) if that one could not come back
          as the interfaces are now, V(gone) if it was no longer there,
          or V(left) if a foreign one is in its place since.
      type: str
      returned: always
      sample: removed
other_defaults:
  description: Foreign default routes in addition to one that is listed; a lower metric than that of the listed one wins.
  returned: always, unless an option is wrong
  type: list
  elements: dict
  contains:
    destination:
      description: Which default route it is, V(default) or V(::/0).
      type: str
      returned: always
      sample: default
    gateway:
      description: Its gateway, null for none.
      type: str
      returned: always
      sample: 10.0.0.1
    device:
      description: Its interface, null for none or several.
      type: str
      returned: always
      sample: wlan0
    metric:
      description: Its metric.
      type: int
      returned: always
      sample: 600
    table:
      description: Its table.
      type: int
      returned: always
      sample: 254
    protocol:
      description: The program that made it, as C(ip route) shows it.
      type: str
      returned: always
      sample: dhcp
    text:
      description: The whole route, as C(ip route) writes it.
      type: str
      returned: always
      sample: default via 10.0.0.1 dev wlan0 proto dhcp metric 600
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
  sample: "1 of 2 routes changed."
"""

from ..module_utils._apply.routes.run import CONCERN
from ..module_utils._apply.transaction.module import run_module


def main() -> None:
    run_module(CONCERN)


if __name__ == "__main__":
    main()
