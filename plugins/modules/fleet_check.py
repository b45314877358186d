# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

DOCUMENTATION = r"""
module: fleet_check
short_description: Compare a computer's plan with its machine before anything changes
version_added: "1.0.0"
description:
  - Compares the plan of M(rosfleet.multimaster.fleet_plan) with the facts that M(rosfleet.multimaster.multimaster_info) found on the machine.
    Are the addresses on its interfaces, are there the routes that it is said to have, is ROS there, who holds the ports.
  - Fails with one sentence per problem, each naming the host, the variable, the found value, the expected value, and the remedy.
  - A small matter, such as an older export of C(ROS_MASTER_URI) in a person's C(~/.bashrc), is a warning.
extends_documentation_fragment:
  - rosfleet.multimaster.attributes.info
options:
  plan:
    description: The entry of the computer in RV(rosfleet.multimaster.fleet_plan#module:computers).
    type: dict
    required: true
  machine:
    description:
      - The return of M(rosfleet.multimaster.multimaster_info) on the computer.
      - Of a module that failed there, the sentence names the needs of such a look.
    type: dict
    required: true
  networks:
    version_added: "1.1.0"
    description:
      - The networks of all robots, RV(rosfleet.multimaster.fleet_plan#module:networks). An interface of the machine with an address or
        a route in that of another robot is a problem, whichever route counts today.
    type: list
    elements: dict
    default: []
  refuse:
    description:
      - Whether a problem fails the task on this computer, which then falls out of the run; the others go on. With V(false), for
        example in a run that changes nothing, nothing fails, and each problem is an entry of RV(noted).
    type: bool
    default: true
author:
  - rosfleet contributors (@rosfleet)
seealso:
  - module: rosfleet.multimaster.fleet_plan
  - module: rosfleet.multimaster.multimaster_info
"""

EXAMPLES = r"""
- name: Compare the plan with every machine
  hosts: robots
  gather_facts: false
  become: true
  tasks:
    - name: Compute the plan of the fleet
      rosfleet.multimaster.fleet_plan:
      run_once: true
      register: multimaster_fleet

    - name: Look at the machine
      rosfleet.multimaster.multimaster_info:
      register: multimaster_info

    - name: Compare the plan with the machine
      rosfleet.multimaster.fleet_check:
        plan: "{{ multimaster_fleet.computers[inventory_hostname] }}"
        machine: "{{ multimaster_info }}"
        networks: "{{ multimaster_fleet.networks }}"
      register: multimaster_plan
"""

RETURN = r"""
problems:
  description: The reasons against the plan on this machine, one sentence each.
  returned: always
  type: list
  elements: str
  sample: []
noted:
  description: With O(refuse=false) the reasons against the plan on this machine, one sentence each.
  returned: always
  type: list
  elements: str
  sample: []
computer:
  description:
    - The name of the computer. With it are all other keys of the plan, with the names of the interfaces and other facts that only the
      machine knows; so a task may register the result as C(multimaster_plan), which the roles read.
  returned: when nothing is refused
  type: str
  sample: kobuki1computer
found:
  description:
    - "The state of the machine, for a run that changes nothing: C(set_up) says whether the collection has records there, C(runs) and
      C(noted) are sentences about other programs on the ports of the plan and about all other problems, C(overlaps) names the
      interfaces that lead into the network of another robot, C(warned) has the warnings, C(set_by) the line of a person that sets a variable
      of ROS to another value, C(broken_ros) says why
      nodes of the ROS that is there cannot start, C(environment) is that of ROS if no file of ours has it."
  returned: when nothing is refused
  type: dict
  sample: {set_up: true, runs: [], noted: [], overlaps: [], warned: [], set_by: {}, broken_ros: "", environment: {}}
sysctl:
  description: The kernel settings of the plan, for example; see RV(rosfleet.multimaster.fleet_plan#module:computers) for all keys.
  returned: when nothing is refused
  type: list
  elements: dict
  sample:
    - name: net.ipv4.conf.eth0.send_redirects
      value: "0"
"""
