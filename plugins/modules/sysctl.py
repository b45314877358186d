# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

DOCUMENTATION = r"""
module: sysctl
short_description: Kernel settings, at run time and at boot
version_added: "1.0.0"
description:
  - Sets kernel settings now, through C(/proc/sys), and at boot, by a drop-in that this module owns whole.
    It never changes a foreign file.
  - Computes which file decides every setting at boot, over all folders of V(sysctl.d) in the order in which they are read,
    C(/etc/sysctl.conf) if something reads it, ufw's own file, systemd-networkd and docker.
    A setting that would have another value after the next boot is a conflict, see O(on_conflict).
  - C(net/ipv4/ip_forward), C(-net.ipv4.ip_forward) and C(net.ipv4.ip_forward) are one key,
    and so is C(net.ipv4.conf.all.forwarding), which is another name of the same variable of the kernel.
  - The values from before are recorded. A setting that is no longer listed is taken back,
    so that an empty list takes back everything. A value that was changed by hand since then is left and named.
  - Check mode has the kernel try values below V(net), in an empty network namespace, and fails if the run would.
    If that is not possible, as in most containers, a warning names the values that it cannot judge.
  - A key that comes with a kernel module (V(net.netfilter.nf_conntrack_max), V(net.bridge.bridge-nf-call-iptables) and the like) is not
    there when the settings are made at boot, if the module is loaded later. So rules of udev
    (C(/etc/udev/rules.d/90-rosfleet-multimaster.rules)) set it when the module comes.
  - With some keys, the kernel changes others, for example those of every interface with C(net.ipv4.ip_forward),
    C(net.ipv4.conf.default.rp_filter) or C(net.ipv6.conf.all.disable_ipv6). This module knows them, writes such a key first, and
    so gives every listed key its own value.
  - The settings are written in the order of the list, after the keys that change others, and are taken back in the reverse order.
    So two keys of which the kernel refuses one while the other has its present value are to be listed in the order that works.
  - When a write fails half way, the values that were written before it are put back, with those that the kernel has changed
    with them, and the drop-in is untouched. Addresses and routes that the kernel removes with V(disable_ipv6) do not come back with
    the value; the failure says so.
  - With O(confirm_within), a change that cuts the controller off is taken back by the machine itself.
extends_documentation_fragment:
  - rosfleet.multimaster.attributes
  - rosfleet.multimaster.confirmation
options:
  settings:
    description:
      - The kernel settings that this computer shall have; V([]) takes back everything that this module set.
    type: list
    elements: dict
    required: true
    suboptions:
      name:
        description:
          - The key, with dots or slashes as in C(sysctl.d(5\)), for example V(net.ipv4.ip_forward)
            or, if an interface has a dot in its name, V(net.ipv4.conf.eth0/100.rp_filter). Patterns are not allowed.
        type: str
        required: true
      value:
        description:
          - The value as the kernel says it, for example V("1"); several numbers are separated by spaces, for example
            V("4096 131072 6291456"). A boolean means V("1") or V("0").
        type: raw
        required: true
      ignore_missing:
        description:
          - Whether this kernel may lack the key, as that of an interface that is not there, for example V(true).
            The drop-in has its line nevertheless, and the key gets its value when it is there at a boot or at a later run.
        type: bool
        default: false
      enough:
        description:
          - Further values that serve as well, for example V(["1", "2"]). If a foreign file sets one of them at boot, that
            one is taken in place of O(settings[].value), so the file decides, and is no conflict.
        type: list
        elements: raw
        default: []
  drop_in:
    description:
      - The file that sets the values at boot, for example V(/etc/sysctl.d/90-rosfleet-multimaster.conf).
      - When it gets another name, the file of the earlier name is removed.
    type: path
    default: /etc/sysctl.d/90-rosfleet-multimaster.conf
  on_conflict:
    description:
      - What to do when something else decides a setting at boot, with another value, for example V(report).
    type: str
    default: fail
    choices:
      fail: Fail before anything changes, naming key, file, line and value.
      report: Apply the settings, warn, and return the conflicts.
  root:
    description:
      - The root folder of the configuration files, for example V(/mnt/image) for the image of a machine.
        Values at run time and the record are those of O(proc) and O(records), not of the image.
    type: path
    default: /
  proc:
    description:
      - The folder of the kernel's settings at run time, for example V(/proc/sys).
    type: path
    default: /proc/sys
  records:
    description:
      - The folder of the record of the values from before, for example V(/var/lib/rosfleet-multimaster).
    type: path
    default: /var/lib/rosfleet-multimaster
seealso:
  - module: rosfleet.multimaster.routes
  - module: ansible.posix.sysctl
    description: One key in one run, in a file that it shares with others.
author:
  - rosfleet contributors (@rosfleet)
"""

EXAMPLES = r"""
- name: Answer the broadcast pings of section 3.2 and forward as section 4.2 of the report asks
  rosfleet.multimaster.sysctl:
    settings:
      - name: net.ipv4.icmp_echo_ignore_broadcasts
        value: "0"
      - name: net.ipv4.ip_forward
        value: "1"

- name: Turn forwarding off, but not if that cuts us off
  rosfleet.multimaster.sysctl:
    settings:
      - name: net.ipv4.ip_forward
        value: "0"
    confirm_within: 30

- name: Filter by the way back on all interfaces, loosely, and not at all on one that may be unplugged
  rosfleet.multimaster.sysctl:
    settings:
      - name: net.ipv4.conf.default.rp_filter
        value: 2
      - name: net.ipv4.conf.eth1.rp_filter
        value: false
        ignore_missing: true

- name: Take everything back
  rosfleet.multimaster.sysctl:
    settings: []
"""

RETURN = r"""
settings:
  description: The result per setting; those that change others come first.
  returned: always, unless an option is wrong
  type: list
  elements: dict
  contains:
    name:
      description: The key with dots.
      type: str
      returned: always
      sample: net.ipv4.ip_forward
    value:
      description: The value that it shall have.
      type: str
      returned: always
      sample: "1"
    runtime_before:
      description: The value before the run, null if there is no such key or it cannot be read.
      type: str
      returned: always
      sample: "0"
    runtime_after:
      description: The value after the run, in check mode the planned one.
      type: str
      returned: always
      sample: "1"
    boot_value:
      description: The value that the next boot sets, null if nothing sets it.
      type: str
      returned: always
      sample: "1"
    boot_file:
      description: The file that decides at boot.
      type: str
      returned: always
      sample: /etc/sysctl.d/90-rosfleet-multimaster.conf
    changed:
      description: Whether the value at run time or the line of the drop-in changed.
      type: bool
      returned: always
      sample: true
    state:
      description:
        - V(ok) or V(changed), or why it cannot be set. V(missing) means that this kernel has no such key
          (no failure with O(settings[].ignore_missing)),
          V(read_only) that it is on a read-only mount, V(denied) that the user may not write it,
          V(invalid) that the kernel refuses the value.
      type: str
      returned: always
      sample: changed
    problem:
      description: The sentence for a setting that cannot be set, else null.
      type: str
      returned: always
      sample:
    conflict:
      description: The file that gives the setting another value at boot; null without one.
      type: dict
      returned: always
      sample:
      contains:
        file:
          description: The file.
          type: str
          returned: always
          sample: /etc/ufw/sysctl.conf
        line:
          description: The line, V(0) if the whole file decides.
          type: int
          returned: always
          sample: 17
        value:
          description: The value that it sets, null if nothing sets any.
          type: str
          returned: always
          sample: "1"
        masks:
          description: Whether the drop-in is not read at all, because a file of its name hides it or the service is masked.
          type: bool
          returned: always
          sample: false
conflicts:
  description: One sentence per conflict.
  returned: always, unless an option is wrong
  type: list
  elements: str
  sample: []
taken_back:
  description: The settings that are no longer listed.
  returned: always, unless an option is wrong
  type: list
  elements: dict
  contains:
    name:
      description: The key with dots.
      type: str
      returned: always
      sample: net.ipv4.ip_forward
    runtime_before:
      description: The value before the run, null if the key is gone.
      type: str
      returned: always
      sample: "1"
    runtime_after:
      description: The value after the run.
      type: str
      returned: always
      sample: "0"
    expected:
      description: The value that this module had set.
      type: str
      returned: always
      sample: "1"
    state:
      description:
        - V(restored) to the value from before, V(left) because it was changed by hand since,
          or V(missing) because the key is gone.
      type: str
      returned: always
      sample: restored
also_changed:
  description: Keys with a value of their own that the kernel changed with a listed one, such as C(net.ipv4.ip_forward).
  returned: always, unless an option is wrong
  type: list
  elements: dict
  contains:
    name:
      description: The key with dots.
      type: str
      returned: always
      sample: net.ipv4.conf.wlan0.forwarding
    before:
      description: The value before the run.
      type: str
      returned: always
      sample: "1"
    after:
      description: The value after the run.
      type: str
      returned: always
      sample: "0"
drop_in:
  description: The file of ours that sets the values at boot.
  returned: always, unless an option is wrong
  type: str
  sample: /etc/sysctl.d/90-rosfleet-multimaster.conf
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
  sample: "1 of 2 kernel settings changed."
"""

from ..module_utils._apply.sysctl.run import CONCERN
from ..module_utils._apply.transaction.module import run_module


def main() -> None:
    run_module(CONCERN)


if __name__ == "__main__":
    main()
