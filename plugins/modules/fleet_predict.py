# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

DOCUMENTATION = r"""
module: fleet_predict
short_description: Predict which computers reach each other after site.yml
version_added: "1.0.0"
description:
  - Follows packets hop by hop, through the facts that M(rosfleet.multimaster.multimaster_info) has read on all computers and the plan of
    M(rosfleet.multimaster.fleet_plan), as the kernels would pass them on. Nothing is sent.
  - It does so for the machines as they are now, and as C(site.yml) would leave them, each way with its way back.
  - For a way that would not work it names the first place at which packets end, in one sentence.
  - A computer that has failed in this play, such as one that preflight refused, stays as it is, so it is left out.
  - A computer that was not looked at, and a device of another make, is taken as planned.
  - Runs on the controller and connects to no host, so it is run once.
extends_documentation_fragment:
  - rosfleet.multimaster.attributes.info
options:
  fleet:
    description: The return of M(rosfleet.multimaster.fleet_plan).
    type: dict
    required: true
  machine:
    description: The name of the variable that every computer registered from C(multimaster_info), for example V(multimaster_info),
      with the parts V(interfaces), V(routing), V(forwarding) and V(filters).
    type: str
    required: true
  table:
    description: Whether to print a table, a matrix of at most sixteen computers, and the ways that would fail, for example V(true).
      Otherwise such a way is a warning.
    type: bool
    default: false
author:
  - rosfleet contributors (@rosfleet)
seealso:
  - module: rosfleet.multimaster.multimaster_info
  - module: rosfleet.multimaster.fleet_report
"""

EXAMPLES = r"""
- name: Predict who reaches whom
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
        destinations: "{{ multimaster_fleet.computers[inventory_hostname].look_at.destinations }}"
      register: multimaster_info

    - name: Predict who reaches whom
      rosfleet.multimaster.fleet_predict:
        fleet: "{{ multimaster_fleet }}"
        machine: multimaster_info
        table: true
      run_once: true
      register: prediction

    - name: Stop before anything changes, if a way would not work
      ansible.builtin.assert:
        that: prediction.works
        fail_msg: "{{ prediction.sentences | join(' ') }}"
      run_once: true
"""

RETURN = r"""
works:
  description: Whether nothing is known to end on its way after C(site.yml).
  returned: success
  type: bool
  sample: true
sentences:
  description: One sentence for each place at which packets would end.
  returned: success
  type: list
  elements: str
  sample:
    - "tibi-visio: after site.yml a packet filter on it drops ping, so tibi-nav -> dabo-nav would not work; expected a way there and
      back: let them pass between the robots' networks; see on tibi-visio: nft list ruleset."
assumed:
  description: The computers and devices that were not looked at, and are taken as planned.
  returned: success
  type: list
  elements: str
  sample: [192.168.11.1]
refused:
  version_added: "1.1.0"
  description: The computers that have failed in this play, such as those that preflight refused. They are left out.
  returned: success
  type: list
  elements: str
  sample: [tibi-arm]
ways:
  description: The ways that would not work, or that do not work now.
  returned: success
  type: list
  elements: dict
  sample: [{from: tibi-nav, to: dabo-nav, traffic: ping, now: fails, after: reaches, where: "", why: "", id: ""}]
  contains:
    from:
      description: The computer that sends.
      returned: always
      type: str
      sample: tibi-nav
    to:
      description: The computer that is to answer.
      returned: always
      type: str
      sample: dabo-nav
    traffic:
      description: V(ping), V(heartbeats), V(connections of nodes), V(large packets), V(topics by the relay) or V(the time).
      returned: always
      type: str
      sample: ping
    now:
      description: V(reaches), V(fails), or V(unsure) if a packet filter says more than is understood.
      returned: always
      type: str
      sample: fails
    after:
      description: The same after C(site.yml).
      returned: always
      type: str
      sample: reaches
    where:
      description: The computer, device or network at which packets would end after C(site.yml), or empty.
      returned: always
      type: str
      sample: tibi-visio
    why:
      description: Why they would end there, or empty.
      returned: always
      type: str
      sample: a packet filter on tibi-visio drops ping
    id:
      version_added: "1.1.0"
      description: The id of the reason, with a page in docs/findings, or empty.
      returned: always
      type: str
      sample: RF-709
msg:
  description: The result in one sentence.
  returned: success
  type: str
  sample: "PREDICTED: all of 288 ways would work after site.yml, 120 more than now."
"""
