# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

DOCUMENTATION = r"""
module: fleet_finding
short_description: Report a finding as the result of a task
version_added: "1.0.0"
description:
  - Returns a finding of M(rosfleet.multimaster.fleet_report), for callbacks that record the results of tasks, such as ARA, the replay of
    C(ansible-navigator) or the callback P(ansible.builtin.junit#callback).
  - Fails if RV(verdict) is V(failed), so use it with C(ignore_errors).
  - Runs on the controller and connects to no host.
extends_documentation_fragment:
  - rosfleet.multimaster.attributes.info
options:
  finding:
    description: An entry of C(findings) or C(each), which M(rosfleet.multimaster.fleet_report) returns.
    type: dict
    required: true
author:
  - rosfleet contributors (@rosfleet)
seealso:
  - module: rosfleet.multimaster.fleet_report
"""

EXAMPLES = r"""
- name: Verify the fleet, and report each finding as a result of its own
  hosts: robots
  gather_facts: false
  become: true
  roles:
    - role: rosfleet.multimaster.verify # it registers the measurements of its tasks, and fails after its judgement
      ignore_errors: true
  tasks:
    - name: Report each finding
      rosfleet.multimaster.fleet_finding:
        finding: "{{ item }}"
      loop: "{{ verify_result.findings }}"
      loop_control:
        label: "{{ item.sentence }}"
      run_once: true
      ignore_errors: true # noqa: ignore-errors each finding is a failure, and all are to be reported
"""

RETURN = r"""
id:
  version_added: "1.1.0"
  description: The kind of the fault. It never changes its meaning.
  returned: always
  type: str
  sample: RF-202
page:
  version_added: "1.1.0"
  description: The address of the page about it.
  returned: always
  type: str
  sample: https://github.com/rosfleet/multimaster/blob/main/docs/findings/2xx.md#rf-202
kind:
  description: The kind of the broken component, such as V(names), V(route) or V(filter).
  returned: always
  type: str
  sample: names
place:
  description: The place of the component, a computer, a robot, a network, or two of them.
  returned: always
  type: str
  sample: kobuki1computer
mode:
  description: How it is broken.
  returned: always
  type: str
  sample: loopback
what:
  description: A detail of the component, or empty.
  returned: always
  type: str
  sample: kobuki2computer
verdict:
  description: The worst result that follows from it, V(failed), V(warning) or V(unknown).
  returned: always
  type: str
  sample: failed
sentence:
  description: The same in a sentence.
  returned: always
  type: str
  sample: /etc/hosts on kobuki1computer binds kobuki2computer to the loopback interface
do:
  version_added: "1.1.0"
  description: The remedy, step by step. Empty if the finding is only inferred.
  returned: always
  type: list
  elements: dict
  sample:
    - where: the controller
      text: ansible-playbook -i hosts.yml rosfleet.multimaster.site --limit kobuki1computer
      effect: writes /etc/hosts
  contains:
    where:
      description:
        - The place of the command, C(the controller), C(the inventory), a computer, or words for one, such as C(its companion).
        - Empty if no command does it.
      returned: always
      type: str
      sample: the controller
    text:
      description: The command to paste, the change of the inventory, or words.
      returned: always
      type: str
      sample: ansible-playbook -i hosts.yml rosfleet.multimaster.site --limit kobuki1computer
    effect:
      description: The effect; it is no part of the command.
      returned: always
      type: str
      sample: writes /etc/hosts
look:
  version_added: "1.1.0"
  description: The commands to look with if that does not help, or if the finding is only inferred. It changes nothing.
  returned: always
  type: list
  elements: dict
  sample:
    - where: kobuki1computer
      text: getent ahostsv4 kobuki2computer
      effect: ""
  contains:
    where:
      description:
        - The place of the command, C(the controller), C(the inventory), a computer, or words for one, such as C(its companion).
        - Empty if no command does it.
      returned: always
      type: str
      sample: kobuki1computer
    text:
      description: The command to paste, the change of the inventory, or words.
      returned: always
      type: str
      sample: getent ahostsv4 kobuki2computer
    effect:
      description: The effect; it is no part of the command.
      returned: always
      type: str
      sample: ""
remedy:
  description: The steps of RV(do) as one text, or those of RV(look) if there is nothing to do.
  returned: always
  type: str
  sample: "on the controller: ansible-playbook -i hosts.yml rosfleet.multimaster.site --limit kobuki1computer (writes /etc/hosts)"
decide:
  description: Deprecated, see RV(look). The steps of RV(look) as one text. It goes with version 2.0.0.
  returned: always
  type: str
  sample: "on kobuki1computer: getent ahostsv4 kobuki2computer"
since:
  description: Since when it is so, if the computer reports it; else empty.
  returned: always
  type: str
  sample: /etc/hosts was changed 2026-11-22 09:12:44 UTC
msg:
  description: The sentence with the remedy.
  returned: always
  type: str
  sample: /etc/hosts on kobuki1computer binds kobuki2computer to the loopback interface; run site.yml
"""
