# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

DOCUMENTATION = r"""
module: fleet_report
short_description: Judge the measurements of all computers
version_added: "1.0.0"
description:
  - Reads the results of M(rosfleet.multimaster.multicast_verify) and M(rosfleet.multimaster.multimaster_verify) on
    all computers of the play, compares it with the plan of M(rosfleet.multimaster.fleet_plan), prints the findings, and
    writes the report. With C(-v) it also prints a table of all checks, and a matrix of at most sixteen computers.
  - A finding is a component of the fleet that is broken, such as a route, a packet filter or a clock, with its evidence, the results that
    follow from it, and the remedy. The findings are the fewest components that explain all that failed, and that no success
    contradicts. If two components explain the same, both are named, with the command that decides.
  - It is a judgement, so a failed check is a result and no failure; RV(passed) has the result, for an assertion after it.
  - A computer that is unreachable, or gave no result, is a finding of its own.
  - With C(--limit), only the computers of the play are judged, each against all others as far as these take part.
  - Runs on the controller and connects to no host, so it is run once.
extends_documentation_fragment:
  - rosfleet.multimaster.attributes.info
  - rosfleet.multimaster.results
  - rosfleet.multimaster.results.packet_trace
options:
  bundle:
    description:
      - A file that M(rosfleet.multimaster.fleet_bundle) has written, for example V(bundle.zip), which is judged in place of the data that this run has
        seen. It can come from any sender. Nothing of it is unpacked or run, and a result that is too large is refused.
      - One of this and O(fleet), O(multicast) and O(probe) is needed.
    type: str
    default: ""
  each:
    description:
      - Whether the findings are returned once more in RV(each), for a task for each of them (M(rosfleet.multimaster.fleet_finding)).
      - V(auto) does so if callbacks are set up in addition to that of the terminal, as ARA and C(ansible-navigator) do.
    type: str
    choices: [auto, always, never]
    default: never
  marks:
    description:
      - When the parts of the run began, in seconds since 1970, by the names that the report shows, in their order. The last part
        ends now. For example C(measurement) with V(1763820132.5).
    type: dict
    default: {}
  fleet:
    description: The return of M(rosfleet.multimaster.fleet_plan).
    type: dict
  multicast:
    description: The name of the variable that every computer registered from C(multicast_verify), for example
      V(verify_multicast); if C(multimaster_verify) has measured that, too, for example V(verify_probe.multicast).
    type: str
  probe:
    description: The name of the variable that every computer registered from C(multimaster_verify), for example
      V(verify_probe).
    type: str
  path:
    description:
      - The place of the report on the controller, as a page (HTML) and as data (JSON).
      - With V(auto), into the folder C(rosfleet/reports) below E(ANSIBLE_HOME), that is C(~/.ansible/rosfleet/reports), with a folder for each
        inventory. The files are only for the user, and those of the last twenty runs are kept.
      - A folder, which exists or ends with a slash, such as V(reports/), gets two files with the time as their name.
      - Another text is the file for the data, for example V(verification.json); it has all results, good ones too. The page is next to it,
        here C(verification.html).
      - Nothing is written if it is empty.
      - Differences from the run before are listed, if its data are there.
    type: str
    default: ""
  junit:
    description: A file on the controller for the results as JUnit XML, with a test case for each check, for example V(verify.xml). None, if empty.
    type: str
    default: ""
  explain:
    version_added: "1.1.0"
    description:
      - The numbers of findings, with commas, or V(all). After the report it is printed why each of them was made, in ten lines at most. They name the rule that
        decided, its evidence, the results that it explains, and the rivals with the successes that cleared them.
      - Nothing is explained if it is empty.
    type: str
    default: ""
author:
  - rosfleet contributors (@rosfleet)
seealso:
  - module: rosfleet.multimaster.multicast_verify
  - module: rosfleet.multimaster.multimaster_verify
  - module: rosfleet.multimaster.fleet_bundle
  - module: rosfleet.multimaster.fleet_finding
"""

EXAMPLES = r"""
- name: Verify the fleet, and judge it once more for a page of another name
  hosts: robots
  gather_facts: false
  become: true
  roles:
    - role: rosfleet.multimaster.verify # it registers the measurements of its tasks, and fails after its judgement
      ignore_errors: true
  tasks:
    - name: Judge the measurements of all computers
      rosfleet.multimaster.fleet_report:
        fleet: "{{ multimaster_fleet }}"
        multicast: verify_probe.multicast
        probe: verify_probe
        machine: verify_started.machine
        path: friday.json
      run_once: true
      register: verification

    - name: Fail if a check failed
      ansible.builtin.assert:
        that: verification.passed
        fail_msg: "{{ verification.msg }}"
      run_once: true
"""

RETURN = r"""
passed:
  description: Whether no check failed.
  returned: success
  type: bool
  sample: true
report:
  description: The page that was written; empty if there is none.
  returned: success
  type: str
  sample: /home/operator/.ansible/rosfleet/reports/fleet-1f6a3c20/2026-11-22T140212.html
since_last_s:
  description: The seconds since the last verification, by the report before, or V(0) for the first one.
  returned: success
  type: float
  sample: 86412.0
checks:
  description: The checks that were made.
  returned: success
  type: list
  elements: dict
  sample: [{check: ping_name, title: ping by name, ok: 2, warning: 0, failed: 0, unknown: 0}]
  contains:
    check:
      description: The name of the check.
      returned: always
      type: str
      sample: ping_name
    title:
      description: The object of the check.
      returned: always
      type: str
      sample: ping by name
    ok:
      description: For how many computers or pairs it is as expected.
      returned: always
      type: int
      sample: 2
    warning:
      description: For how many it is not, without keeping the robots from each other.
      returned: always
      type: int
      sample: 0
    failed:
      description: For how many it failed.
      returned: always
      type: int
      sample: 0
    unknown:
      description: For how many it could not be judged.
      returned: always
      type: int
      sample: 0
pairs:
  description: How many pairs of computers were to be tried.
  returned: success
  type: dict
  sample: {tried: 40400, of: 159600}
  contains:
    tried:
      description: The number of pairs of O(pairs).
      returned: always
      type: int
      sample: 40400
    of:
      description: The number of all pairs of an observer of the play and another computer.
      returned: always
      type: int
      sample: 159600
findings:
  description: The parts of the fleet that are broken, the most important first.
  returned: success
  type: list
  elements: dict
  sample:
    - id: RF-202
      page: https://github.com/rosfleet/multimaster/blob/main/docs/findings/2xx.md#rf-202
      kind: names
      place: kobuki1computer
      mode: loopback
      what: kobuki2computer
      verdict: failed
      sentence: /etc/hosts on kobuki1computer binds kobuki2computer to the loopback interface
      do:
        - where: the controller
          text: ansible-playbook -i hosts.yml rosfleet.multimaster.site --limit kobuki1computer
          effect: writes /etc/hosts
      look:
        - where: kobuki1computer
          text: getent ahostsv4 kobuki2computer
          effect: ""
      remedy: "on the controller: ansible-playbook -i hosts.yml rosfleet.multimaster.site --limit kobuki1computer (writes /etc/hosts)"
      since: /etc/hosts was changed 2026-11-22 09:12:44 UTC
      rivals: []
      seen:
        - {check: name, observer: kobuki1computer, target: kobuki2computer, verdict: failed, expected: 192.168.1.239, found: 127.0.1.1}
      follows: 3
  contains:
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
      description: The kind of the component, such as V(names), V(route) or V(filter).
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
      description: A detail of the component, such as the names that are looked up; or empty.
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
      description: The steps of RV(findings[].do) as one text, or those of RV(findings[].look) if there is nothing to do.
      returned: always
      type: str
      sample: "on the controller: ansible-playbook -i hosts.yml rosfleet.multimaster.site --limit kobuki1computer (writes /etc/hosts)"
    decide:
      description: Deprecated, see RV(findings[].look). The steps of RV(findings[].look) as one text. It goes with version 2.0.0.
      returned: always
      type: str
      sample: "on kobuki1computer: getent ahostsv4 kobuki2computer"
    since:
      description: Since when it is so, if the computer reports it; else empty.
      returned: always
      type: str
      sample: /etc/hosts was changed 2026-11-22 09:12:44 UTC
    rivals:
      description: Other parts that explain the same, each with C(id), C(kind), C(place), C(mode) and C(sentence). It is one of all these.
      returned: always
      type: list
      elements: dict
      sample: []
    because:
      version_added: "1.1.0"
      description: Why the finding was made. Empty beyond the first fifty findings.
      returned: always
      type: dict
      sample: {}
      contains:
        rule:
          description: The id of the decision rule that won, a row of the table in C(_verify/diagnose/rules.py).
          returned: success
          type: str
          sample: value
        title:
          description: The rule in words.
          returned: success
          type: str
          sample: a value that was read is not the expected one
        place:
          description: The place of the rule in the table.
          returned: success
          type: int
          sample: 3
        rules:
          description: The number of rules.
          returned: success
          type: int
          sample: 10
        certainty:
          description: V(seen), V(located) or V(inferred), as RV(findings[].sure).
          returned: success
          type: str
          sample: seen
        cost:
          description: How rare the fault is.
          returned: success
          type: float
          sample: 2.0
        looked_at:
          description: For how many results of the finding rivals were weighed.
          returned: success
          type: int
          sample: 4
        shown_by:
          description:
            - The evidence, each with C(kind) (V(value), V(blocking rule), V(errno), V(packet trace) or V(inference)), C(rule), C(check), C(observer),
              C(target), C(expected), C(found), C(source) (the file of the check), C(detail) (the rule of the packet filter, or the errno) and C(trace).
            - A C(trace) has C(packets), C(disposition), C(answer), and C(hops), each with C(computer) and C(steps) of C(action) and C(detail).
          returned: success
          type: list
          elements: dict
          sample: []
        explains:
          description: How many results it explains, each with C(check), the decision C(rule) that gave them to it, and C(rows).
          returned: success
          type: list
          elements: dict
          sample: [{check: name, rule: value, rows: 1}]
        rivals:
          description:
            - Other components that may be the reason, each with C(id), C(kind), C(mode), C(place), C(what), C(rows), C(cost), C(cleared), C(reason),
              and the success (C(check), C(observer), C(target)) that cleared it.
          returned: success
          type: list
          elements: dict
          sample: []
    seen:
      description: The results with a value that shows it; none if it was concluded.
      returned: always
      type: list
      elements: dict
      sample:
        - {check: name, observer: kobuki1computer, target: kobuki2computer, verdict: failed, expected: 192.168.1.239, found: 127.0.1.1}
    sure:
      description:
        - How sure it is. V(seen), a value on a computer shows it. V(located), a packet trace ends at it. V(inferred), it explains best what
          failed; then RV(findings[].do) is empty.
      returned: always
      type: str
      sample: seen
    followed:
      description: The results of the packet trace about it, a sentence for each place; see M(rosfleet.multimaster.multimaster_packet_trace).
      returned: always
      type: list
      elements: str
      sample: []
    ways:
      description: The way of the packets to each place of RV(findings[].followed), as the page draws it.
      returned: always
      type: list
      elements: dict
      sample: []
      contains:
        computers:
          description: The planned computers, from the one that sends to the one that is to answer.
          returned: always
          type: list
          elements: str
          sample: [router, tibi-visio, tibi-nav]
        hops:
          description: The steps that were seen, those of the answer last. At most 16 in each direction.
          returned: always
          type: list
          elements: dict
          sample: []
          contains:
            sender:
              description: The computer that the packet has left.
              returned: always
              type: str
              sample: tibi-nav
            receiver:
              description: The computer with the hardware address; empty if none of the fleet has it.
              returned: always
              type: str
              sample: tibi-visio
            network:
              description: The planned network between the two; empty if none is planned.
              returned: always
              type: str
              sample: the network of tibi
            left:
              description: The interface that it has left by.
              returned: always
              type: str
              sample: eth0
            target_mac:
              description: The hardware address for which it has left; empty on a link that has none.
              returned: always
              type: str
              sample: 02:42:c0:a8:0b:65
            ttl:
              description: Its time to live when it left.
              returned: always
              type: int
              sample: 1
            answer:
              description: Whether it is a step of the answer.
              returned: always
              type: bool
              sample: true
            arrived:
              description: Whether the receiver saw it come in.
              returned: always
              type: bool
              sample: true
            came:
              description: The interface that it came in by; empty if it was not seen there.
              returned: always
              type: str
              sample: eth1
        at:
          description: The computer that saw the packet last, or the one that reports its end.
          returned: always
          type: str
          sample: tibi-visio
        words:
          description: The sentence in RV(findings[].followed).
          returned: always
          type: str
          sample: the answers to pings from router to tibi-nav came in at tibi-visio on eth1, and did not leave it
    follows:
      description: How many results are not as expected because of it. The file of O(path) lists them.
      returned: always
      type: int
      sample: 3
each:
  description: The first twenty of RV(findings) if O(each) says so, else none; the sentence of one of several has all of them.
  returned: success
  type: list
  elements: dict
  sample: []
unexplained:
  description: The results that are not as expected, and that no broken part explains, as after lost packets.
  returned: success
  type: list
  elements: dict
  sample:
    - check: rpc_port
      observer: kobuki1computer
      target: kobuki2computer
      verdict: failed
      expected: TCP port 11611 of 192.168.1.239 opens
      found: no answer within 2 s
  contains:
    check:
      description: The name of the check.
      returned: always
      type: str
      sample: rpc_port
    observer:
      description: The computer that has looked.
      returned: always
      type: str
      sample: kobuki1computer
    target:
      description: The computer at which it has looked, or itself.
      returned: always
      type: str
      sample: kobuki2computer
    verdict:
      description: V(warning), V(failed) or V(unknown).
      returned: always
      type: str
      sample: failed
    expected:
      description: The expected value.
      returned: always
      type: str
      sample: TCP port 11611 of 192.168.1.239 opens
    found:
      description: The found value.
      returned: always
      type: str
      sample: no answer within 2 s
msg:
  description: The result in one sentence.
  returned: success
  type: str
  sample: "PASSED: none of 38 checks failed."
"""
