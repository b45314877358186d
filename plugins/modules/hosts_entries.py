# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

DOCUMENTATION = r"""
module: hosts_entries
short_description: Bind the names of all computers to their addresses in /etc/hosts
version_added: "1.0.0"
description:
  - Gives C(/etc/hosts) all bindings of the fleet in one run, as sections 3.2 and 4.2 of the report IRI-TR-15-1 ask for
    (its Fig. 6 and Fig. 12), and returns the answers of libc then.
  - A line of this module ends with the mark C(# rosfleet.multimaster). The module repairs or removes it as a whole,
    wherever it is. To own such a line yourself, remove the mark. All other lines are kept byte for byte.
  - If a line of yours has a binding already, no line is added for it.
  - A managed name on a loopback line, such as the C(127.0.1.1) line that installers write and the report keeps
    (its Fig. 6), would resolve to the computer itself. So the name is removed from that line; the other names stay, and
    C(localhost) always does. The old line is kept behind the mark and restored on a rollback.
  - Names that are no longer listed are removed. So O(entries=[]) is the rollback; it restores the old content.
  - The file is written by rename, so there is the old or the new one at any moment. If it is a mount point, as in
    containers, it is written in place, from a copy. If such a run is killed half way, the next one repairs the file.
    Owner, mode, ACL and other extended attributes are kept; if one cannot be kept, nothing is changed.
  - At its end it asks libc for every name if O(path) is C(/etc/hosts), and fails if the answer is different.
  - cloud-init writes C(/etc/hosts) at every boot if C(manage_etc_hosts) is set, for example in the user data that
    Raspberry Pi Imager writes. If cloud-init is installed, and O(path) is C(/etc/hosts), its services get a file with
    C(manage_etc_hosts=false) that counts more than user data (drop-ins in C(/etc/systemd/system), environment
    variable C(CLOUD_CFG)). It goes on a rollback. A C(CLOUD_CFG) of your own in a later drop-in stays in force. systemd
    reads it at the next boot, before cloud-init runs again; run C(systemctl daemon-reload) before you restart cloud-init by hand.
extends_documentation_fragment:
  - rosfleet.multimaster.attributes
options:
  entries:
    description:
      - >-
        All bindings of the fleet, for example V([{address: 192.168.1.229, names: [kobuki1computer]}]). V([]) is the
        rollback.
      - A name may have one IPv4 and one IPv6 address; an address has one entry.
    type: list
    elements: dict
    required: true
    suboptions:
      address:
        description:
          - The IPv4 or IPv6 address at which other computers reach this one, for example V(192.168.1.229).
        type: str
        required: true
      names:
        description:
          - The names of the computer, for example V([kobuki1computer, kobuki1]). The first is the canonical one, the
            others are aliases.
          - Letters, digits, hyphens and dots; also underscores, as in V(my_robot), which are no part of RFC 1123 but are
            common, and which libc and ROS take.
        type: list
        elements: str
        required: true
  path:
    description:
      - The file, for example V(/etc/hosts). Of a symbolic link, the target is written.
    type: path
    default: /etc/hosts
  own_name:
    description:
      - The name of this computer, for example V(kobuki1computer). By default its host name.
      - It is only used in RV(msg).
    type: str
  backup:
    description:
      - V(true) copies the file in its folder before it is changed, with the time in the name of the copy, for example as
        V(/etc/hosts.4711.2026-11-21@03:14:15~). The copies stay; the rollback does not need them.
    type: bool
    default: false
  on_conflict:
    description:
      - The reaction to a conflict, which is a line of yours that gives a name of O(entries) another address of the same
        family, for example V(report).
      - With V(fail), the module fails before it changes anything. With V(report), it warns and goes on.
    type: str
    choices: [fail, report]
    default: fail
  records:
    description:
      - The folder for the copy from which a mounted file is written, for example V(/var/lib/rosfleet-multimaster).
        It is made when needed, and removed when empty.
    type: path
    default: /var/lib/rosfleet-multimaster
author:
  - rosfleet contributors (@rosfleet)
seealso:
  - module: ansible.builtin.blockinfile
  - module: ansible.builtin.lineinfile
  - module: rosfleet.multimaster.managed_files
  - name: hosts(5)
    description: How libc reads the file.
    link: https://man7.org/linux/man-pages/man5/hosts.5.html
"""

EXAMPLES = r"""
- name: Bind the names of both robots, as in Fig. 6 of the report
  rosfleet.multimaster.hosts_entries:
    entries:
      - {address: 192.168.1.229, names: [kobuki1computer]}
      - {address: 192.168.1.239, names: [kobuki2computer]}

- name: Only warn if a foreign line gives another address
  rosfleet.multimaster.hosts_entries:
    entries:
      - {address: 192.168.11.202, names: [tibi-monitor, tibi]}
      - {address: "fd00:11::202", names: [tibi-monitor]}
    on_conflict: report

- name: Keep a copy of the file from before, as well
  rosfleet.multimaster.hosts_entries:
    entries:
      - {address: 192.168.1.229, names: [my_robot, kobuki1computer]}
    backup: true

- name: Remove all bindings of this module
  rosfleet.multimaster.hosts_entries:
    entries: []
"""

RETURN = r"""
entries:
  description: Each entry of O(entries), and the line that gives it.
  returned: when the options are right
  type: list
  elements: dict
  sample:
    - address: 192.168.1.229
      names: [kobuki1computer]
      state: added
      ours: true
      line: 3
      resolved: {kobuki1computer: [192.168.1.229]}
  contains:
    address:
      description: The address in its normal form.
      returned: always
      type: str
      sample: 192.168.1.229
    names:
      description: The names, the canonical one first.
      returned: always
      type: list
      elements: str
      sample: [kobuki1computer]
    state:
      description: V(unchanged), V(added) or V(changed).
      returned: always
      type: str
      sample: added
    ours:
      description: V(true) if this module owns the line; V(false) if a foreign line has the binding already.
      returned: always
      type: bool
      sample: true
    line:
      description: The number of the line in the new file, from 1.
      returned: always
      type: int
      sample: 3
    resolved:
      description:
        - For each name, the addresses of this family that libc answers after the change, best first. No more names
          are asked for after 2 seconds; a name that was not asked for is left out.
        - Empty in check mode, and when O(path) is not the file that libc reads.
      returned: always
      type: dict
      sample: {kobuki1computer: [192.168.1.229]}
unresolved:
  description: The names for which libc's best answer is not the planned address. Empty if RV(entries[].resolved) is.
  returned: when the options are right
  type: list
  elements: dict
  sample: []
  contains:
    name:
      description: The name that was asked for.
      returned: always
      type: str
      sample: kobuki1computer
    found:
      description: The addresses that libc answers.
      returned: always
      type: list
      elements: str
      sample: [127.0.1.1]
    expected:
      description: The planned address.
      returned: always
      type: str
      sample: 192.168.1.229
removed:
  description: The lines of this module that were removed, because no entry needs them any more.
  returned: when the options are right
  type: list
  elements: dict
  sample: [{line: 3, text: "192.168.1.230\tkobuki3computer # rosfleet.multimaster"}]
  contains:
    line:
      description: The number of the line in the old file, from 1.
      returned: always
      type: int
      sample: 3
    text:
      description: The line.
      returned: always
      type: str
      sample: "192.168.1.230\tkobuki3computer # rosfleet.multimaster"
replaced:
  description: The foreign loopback lines from which managed names were removed, or which were restored.
  returned: when the options are right
  type: list
  elements: dict
  sample: [{before: 127.0.1.1 kobuki1computer, after: "", line: 2, state: replaced}]
  contains:
    before:
      description: The line without this module.
      returned: always
      type: str
      sample: 127.0.1.1 kobuki1computer
    after:
      description: The line without the managed names; empty if no name is left.
      returned: always
      type: str
      sample: ""
    line:
      description: The number of the line in the new file, from 1.
      returned: always
      type: int
      sample: 2
    state:
      description: V(replaced) or V(restored) in this run, or V(unchanged) when it was replaced before.
      returned: always
      type: str
      sample: replaced
conflicts:
  description: The names that have another address in a foreign line.
  returned: when the options are right
  type: list
  elements: dict
  sample:
    - line: 7
      text: 192.168.1.99 kobuki1computer
      name: kobuki1computer
      found: 192.168.1.99
      expected: 192.168.1.229
      effect: shadows
  contains:
    line:
      description: The number of the line in the old file, from 1.
      returned: always
      type: int
      sample: 7
    text:
      description: The line.
      returned: always
      type: str
      sample: 192.168.1.99 kobuki1computer
    name:
      description: The name as it is there.
      returned: always
      type: str
      sample: kobuki1computer
    found:
      description: The address that the line gives.
      returned: always
      type: str
      sample: 192.168.1.99
    expected:
      description: The address in O(entries).
      returned: always
      type: str
      sample: 192.168.1.229
    effect:
      description: V(shadows) when the line comes before the right one, V(adds) when it adds a second address behind it.
      returned: always
      type: str
      sample: shadows
written:
  description:
    - The way in which the file was written, V(rename), V(in_place) if it is a mount point, or V(removed) if this
      module had made the file. Empty when it was not written.
  returned: when the options are right
  type: str
  sample: rename
repaired:
  description:
    - V(true) if the file was torn by a run that was killed while it wrote in place, and was repaired (not in check mode).
  returned: when the options are right
  type: bool
  sample: false
backup_file:
  description: The copy of the file from before; empty without one.
  returned: when the options are right
  type: str
  sample: ""
cloud_init:
  description:
    - The files that keep cloud-init from writing the file at boot, with their state V(written), V(unchanged), V(edited)
      (changed by hand, and restored), V(foreign) (as planned, but not written by this module) or V(removed).
    - Empty without cloud-init.
  returned: when the options are right
  type: list
  elements: dict
  sample: [{path: /etc/rosfleet-multimaster/cloud-init.cfg, state: written}]
path:
  description: The file, after symbolic links.
  returned: when the options are right
  type: str
  sample: /etc/hosts
diff:
  description: The file before and after; a list, with those that keep cloud-init away, if these change, too.
  returned: when the options are right
  type: dict
  sample:
    before_header: /etc/hosts
    after_header: /etc/hosts
    before: "127.0.0.1 localhost\n"
    after: "127.0.0.1 localhost\n192.168.1.229\tkobuki1computer # rosfleet.multimaster\n"
msg:
  description: A report in sentences of all that was found and done.
  returned: always
  type: str
  sample: >-
    /etc/hosts: 2 added. Line 2 (127.0.1.1 kobuki1computer) no longer binds this computer's own name to loopback; of it
    remains: nothing.
"""

from ..module_utils._apply.hosts.run import CONCERN
from ..module_utils._apply.transaction.module import run_module


def main() -> None:
    """Plan, and apply unless in check mode."""
    run_module(CONCERN)


if __name__ == "__main__":
    main()
