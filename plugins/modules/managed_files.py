# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

DOCUMENTATION = r"""
module: managed_files
short_description: Own a set of files whole
version_added: "1.0.0"
description:
  - Writes a set of files, the bundle, and removes its files that are no longer listed. An empty list removes the whole
    bundle, with the folders that were made for it.
  - A file that is there already and was not written by this module is never changed. If its content and mode are as
    planned, it stays as it is and stays foreign; otherwise the module fails before it changes anything.
  - A file of the bundle that was changed by hand (drift) is restored, and the result says so.
  - All files are written or none. Each is replaced by renaming. If one cannot be written, those that were written
    before are rolled back. After a run that was killed, the next one repairs everything.
  - Files belong to the user and group that the module runs as, so to root with C(become), unless O(files[].owner) or
    O(files[].group) says another. Missing folders are made with mode C(0755). Only folders that were made for files of
    this collection are removed again, when they are empty; byte code that Python cached in such a folder goes with its
    source.
  - Root acts in no folder that another user than root can replace. A planned file there is refused, and a file
    of the bundle that is there by now stays, which the result says. A group that may write is trusted.
  - A file that is replaced keeps its ACL and other extended attributes; its mode bounds the ACL.
extends_documentation_fragment:
  - rosfleet.multimaster.attributes
  - rosfleet.multimaster.bundle
options:
  bundle:
    description:
      - The label of the set, for example V(nodes), of 1 to 64 letters, digits, dots, hyphens and underscores. Each
        label is a set of its own, with the record C(files-<bundle>.json) in O(records).
    type: str
    required: true
  files:
    description:
      - All files of the bundle; for example V([]) removes it.
  reload:
    description:
      - A service that reads files only at a reload. It is reloaded if this run changes a file of its folder.
    type: dict
    suboptions:
      service:
        description: The unit, for example V(ssh.service); empty for none.
        type: str
        required: true
      folder:
        description: The beginning of the paths of its files, for example V(/etc/ssh/).
        type: str
        required: true
      due:
        description: Whether it is reloaded in any case, for example V(true) if it runs with other files than it should.
        type: bool
        default: false
      restart:
        version_added: "1.1.0"
        description: Whether it is started again instead, after systemd has read its units, for example V(true) for a service that cannot be reloaded.
        type: bool
        default: false
  trees:
    description: Folders of the controller of which all text files belong to the bundle, as M(rosfleet.multimaster.managed_files) takes them.
    type: list
    elements: dict
    default: []
    suboptions:
      folder:
        description: The folder, for example V(/home/me/nodes). One that is not absolute is a folder of this collection.
        type: str
        required: true
      destination:
        description: The absolute folder of the computer that takes its place, for example V(/usr/local/lib/example).
        type: str
        required: true
      left_out:
        description: A regular expression; a file whose path on the computer has it is left out, for example V(/tests/).
        type: str
        default: ""
  brief:
    description:
      - The difference counts the files below each of these folders in one line, instead of their content, for example
        V([/usr/local/lib/example]) if the content is code.
    type: list
    elements: str
    default: []
author:
  - rosfleet contributors (@rosfleet)
seealso:
  - module: rosfleet.multimaster.managed_services
  - plugin: rosfleet.multimaster.file_tree
    plugin_type: lookup
"""

EXAMPLES = r"""
- name: Install a program and its parameters
  rosfleet.multimaster.managed_files:
    bundle: example
    files:
      - {path: /usr/local/lib/example/example.py, content: "print('example')\n", mode: "0755"}
      - {path: /etc/example/parameters.json, content: "{}\n"}
  register: installed

- name: Install the files of a folder of the role
  rosfleet.multimaster.managed_files:
    bundle: library
    files: "{{ query('rosfleet.multimaster.file_tree', role_path ~ '/files', destination='/usr/local/lib/example') }}"
  when: role_path is defined

- name: Write a file that a group may read
  rosfleet.multimaster.managed_files:
    bundle: secret
    files:
      - {path: /etc/example/key, content: "a key\n", owner: root, group: dialout, mode: "u=rw,g=r,o="}

- name: Remove them
  rosfleet.multimaster.managed_files:
    bundle: "{{ item }}"
    files: []
  loop: [example, library, secret]
"""

RETURN = r"""
files:
  description: Every planned file in the order of O(files).
  returned: success
  type: list
  elements: dict
  sample: [{path: /etc/example/parameters.json, state: written, mode: "0644"}]
  contains:
    path:
      description: The path.
      returned: always
      type: str
      sample: /etc/example/parameters.json
    state:
      description:
        - V(unchanged), V(written) (new, or with another content or mode than before), V(edited) (it had been changed or
          removed by hand, and was restored) or V(foreign) (not written by this module, but as planned, so it stays). In
          check mode, the state that it would have.
      returned: always
      type: str
      sample: written
    mode:
      description: The planned permission bits.
      returned: always
      type: str
      sample: "0644"
removed:
  description: The files of the bundle that were no longer listed and were removed.
  returned: success
  type: list
  elements: str
  sample: [/etc/example/old.json]
folders_made:
  description: The folders that were made, outermost first.
  returned: success
  type: list
  elements: str
  sample: [/etc/example]
folders_removed:
  description: The folders that were removed, innermost first.
  returned: success
  type: list
  elements: str
  sample: [/usr/local/lib/example/__pycache__, /usr/local/lib/example]
notes:
  description: A sentence for everything unusual, such as a file that had been changed by hand.
  returned: success
  type: list
  elements: str
  sample: [/etc/example/parameters.json had been changed or removed by hand since we wrote it.]
reloaded:
  description: The service that was reloaded (in check mode, that would be); empty for none.
  returned: success
  type: str
  sample: ssh.service
digest:
  description: One SHA-256 over the paths, modes and contents of O(files), to notice a change of any of them.
  returned: success
  type: str
  sample: 5891b5b522d5df086d0ff0b110fbd9d21bb4fc7163af34d08286a2e846f6be03
msg:
  description: A sentence on the changes; after a failure, on the found value, the expected one and the remedy.
  returned: always
  type: str
  sample: 2 files of the bundle nodes were written, 1 was removed and 31 were right.
"""

from ..module_utils._apply.transaction.file_bundle import CONCERN
from ..module_utils._apply.transaction.module import run_module


def main() -> None:
    """Plan, and apply unless in check mode."""
    run_module(CONCERN)


if __name__ == "__main__":
    main()
