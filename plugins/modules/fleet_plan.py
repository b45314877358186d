# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

DOCUMENTATION = r"""
module: fleet_plan
short_description: Compute the plan of every computer of the fleet
version_added: "1.0.0"
description:
  - Reads the C(multimaster_*) variables of all robots from the inventory, whatever C(--limit) says, validates them, and
    computes the plan of every computer.
  - Fails with one sentence per problem, each naming the host, the variable, the found value and the expected value.
  - Runs on the controller and connects to no host, so it is run once.
extends_documentation_fragment:
  - rosfleet.multimaster.attributes.info
options:
  group:
    description: The group whose child groups are the robots, for example V(robots).
    type: str
    default: robots
  router_group:
    description:
      - The group that holds the router of the common network, if that is a computer under Linux, for example V(routers).
        It may be missing.
    type: str
    default: routers
author:
  - rosfleet contributors (@rosfleet)
seealso:
  - module: rosfleet.multimaster.fleet_check
  - module: rosfleet.multimaster.fleet_predict
"""

EXAMPLES = r"""
- name: Compute the plan of the fleet
  rosfleet.multimaster.fleet_plan:
  run_once: true
  register: multimaster_fleet

- name: Show the plan of this computer
  ansible.builtin.debug:
    var: multimaster_fleet.computers[inventory_hostname]
"""

RETURN = r"""
problems:
  description: The problems of the inventory, one sentence each.
  returned: failure
  type: list
  elements: str
  sample:
    - "kobuki2computer: multimaster_address is 192.168.1.229, which kobuki1computer has too; expected an address of its own: \
       correct one of the two."
hosts_entries:
  description: The bindings of names to addresses that every computer has in its hosts file.
  returned: success
  type: list
  elements: dict
  contains:
    address:
      description: The address of a computer.
      returned: always
      type: str
      sample: 192.168.1.229
    names:
      description: Its names, the name in the inventory first.
      returned: always
      type: list
      elements: str
      sample: [kobuki1computer]
masters:
  description: The masters as every discovery node is expected to list them.
  returned: success
  type: list
  elements: dict
  contains:
    robot:
      description: The robot, a group of the inventory.
      returned: always
      type: str
      sample: kobuki1
    computer:
      description: The computer that runs the roscore; its companion, if that computer is sealed.
      returned: always
      type: str
      sample: kobuki1computer
    address:
      description: The address of that computer that discovery uses, on a gateway the one in the common network.
      returned: always
      type: str
      sample: 192.168.1.229
    name:
      description: The name of the master.
      returned: always
      type: str
      sample: kobuki1computer
    uri:
      description: The master URI.
      returned: always
      type: str
      sample: http://kobuki1computer:11311/
    monitor_uri:
      description: The URI at which the discovery node answers the others.
      returned: always
      type: str
      sample: http://192.168.1.229:11611
    rpc_port:
      description: The TCP port of O(ignore:monitor_uri).
      returned: always
      type: int
      sample: 11611
    declared:
      description:
        - Whether the robot declares the topics that it gives to the others (C(multimaster_exports)). One that does not gives everything to
          everybody.
      returned: always
      type: bool
      sample: false
flows:
  description:
    - The topics that robots with a declaration give to others, empty if none declares. Several entries for two robots
      add up, and topics without an entry do not flow.
    - In a name C(*) matches any text. The case of letters does not count.
    - The topics of the verification, C(/multimaster_verify/*), flow wherever anything does, and are not listed.
  returned: success
  type: list
  elements: dict
  contains:
    from:
      description: The robots that give, each of them to each of RV(flows[].to).
      returned: always
      type: list
      elements: str
      sample: [tibi]
    to:
      description: The robots that are given it.
      returned: always
      type: list
      elements: str
      sample: [dabo, car]
    topics:
      description: The topics whose publishers are exchanged, those of actions among them.
      returned: always
      type: list
      elements: str
      sample: [/tibi/pose, /tibi/dock/status, /tibi/dock/feedback, /tibi/dock/result]
    services:
      description: The services that are exchanged.
      returned: always
      type: list
      elements: str
      sample: [/tibi/reset]
    parameters:
      version_added: "1.1.0"
      description: The parameters that are copied, each with all that is below its name.
      returned: if there are any
      type: list
      elements: str
      sample: [/robot_description]
common_network:
  description: The network that all robots share.
  returned: success
  type: str
  sample: 192.168.1.0/24
networks:
  description: The networks of the robots that have one of their own.
  returned: success
  type: list
  elements: dict
  contains:
    robot:
      description: The robot.
      returned: always
      type: str
      sample: tibi
    network:
      description: Its network.
      returned: always
      type: str
      sample: 192.168.11.0/24
    gateway:
      description: The address of its gateway in this network.
      returned: always
      type: str
      sample: 192.168.11.101
    common_address:
      description: The address of its gateway in the common network.
      returned: always
      type: str
      sample: 192.168.1.201
    device:
      description: Whether the gateway is a device of another make, and no computer of the inventory.
      returned: always
      type: bool
      sample: false
router:
  description: The device that manages the common network, empty if none is named.
  returned: success
  type: dict
  contains:
    name:
      description: The host, empty for a device of another make.
      returned: always
      type: str
      sample: router
    address:
      description: Its address in the common network.
      returned: always
      type: str
      sample: 192.168.1.1
transport:
  description: How the discovery nodes find each other.
  returned: success
  type: str
  sample: both
multicast_group:
  description: The multicast group of the discovery nodes.
  returned: success
  type: str
  sample: 224.0.0.1
multicast_port:
  description: The UDP port of the discovery nodes.
  returned: success
  type: int
  sample: 11511
multicast_routing:
  description: The program that passes the multicast group on between the networks, V(none) if nothing does.
  returned: success
  type: str
  sample: none
members:
  description: All computers of the robots as the others see them.
  returned: success
  type: list
  elements: dict
  contains:
    name:
      description: The name of the computer.
      returned: always
      type: str
      sample: kobuki1computer
    robot:
      description: Its robot.
      returned: always
      type: str
      sample: kobuki1
    address:
      description: Its address.
      returned: always
      type: str
      sample: 192.168.1.229
    network:
      description: The network of its robot.
      returned: always
      type: str
      sample: 192.168.1.0/24
    discovery_address:
      description: The address that discovery uses, on a gateway the one in the common network.
      returned: always
      type: str
      sample: 192.168.1.229
    discovery:
      description: Whether it takes part in discovery's traffic, as masters and all computers on the common network do.
      returned: always
      type: bool
      sample: true
    multicast:
      description: Whether it hears the multicast group of the others.
      returned: always
      type: bool
      sample: true
listeners:
  description:
    - The computers that measure datagrams, as M(rosfleet.multimaster.multicast_verify) takes them.
    - They are the members that take part in discovery, and those that hear the multicast group come first.
  returned: success
  type: list
  elements: dict
  contains:
    name:
      description: The name of the computer.
      returned: always
      type: str
      sample: kobuki1computer
    address:
      description: The address that discovery uses.
      returned: always
      type: str
      sample: 192.168.1.229
    multicast:
      description: Whether it hears the multicast group of the others.
      returned: always
      type: bool
      sample: true
ssh_ports:
  description: The ports of ssh that the inventory names (C(ansible_port)), which no packet filter of the fleet touches.
  version_added: 1.1.0
  returned: success
  type: list
  elements: int
  sample: [2222]
belonging:
  description: The members of the fleet, and the treatment of strangers.
  returned: success
  type: dict
  contains:
    strangers:
      description: The treatment of masters that are not in the inventory, V(ignore) or V(allow).
      returned: always
      type: str
      sample: ignore
    allow:
      description: Networks of computers that are not in the inventory and belong to the fleet all the same; an address is a network of one.
      returned: always
      type: list
      elements: str
      sample: [192.168.1.77/32]
    robots:
      description: The robots by their marks in the network; the router has an entry without a master.
      returned: always
      type: list
      elements: dict
      contains:
        robot:
          description: The name of the robot, or of the router.
          returned: always
          type: str
          sample: kobuki1
        name:
          description: The name of its master.
          returned: always
          type: str
          sample: kobuki1computer
        uris:
          description: The URIs that its master may have, the planned one first.
          returned: always
          type: list
          elements: str
          sample: ["http://kobuki1computer:11311/", "http://192.168.1.229:11311/"]
        rpc_port:
          description: The TCP port of its discovery node.
          returned: always
          type: int
          sample: 11611
        addresses:
          description: The addresses of the computer with its master, the one that discovery uses first.
          returned: always
          type: list
          elements: str
          sample: [192.168.1.229]
        hosts:
          description: Names and addresses of all its computers.
          returned: always
          type: list
          elements: str
          sample: [kobuki1computer, 192.168.1.229]
    computers:
      description: All addresses of all computers, the router's among them.
      returned: always
      type: list
      elements: str
      sample: [192.168.1.229, 192.168.1.239]
computers:
  description: The plan of each computer, by its name; the router's too.
  returned: success
  type: dict
  sample:
    kobuki1computer:
      address: 192.168.1.229
      environment:
        ROS_HOSTNAME: kobuki1computer
        ROS_MASTER_URI: http://kobuki1computer:11311
      is_master: true
      robot: kobuki1
"""
