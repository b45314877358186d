# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
# GNU General Public License v3.0+ (see LICENSES/GPL-3.0-or-later.txt or https://www.gnu.org/licenses/gpl-3.0.txt)

"""The lookup file_tree: a folder of the controller as the files of managed_files."""

from __future__ import annotations

DOCUMENTATION = r"""
name: file_tree
short_description: The text files below a folder, ready for managed_files
version_added: "1.0.0"
author:
  - rosfleet contributors (@rosfleet)
description:
  - Reads all regular text files below folders of the controller and returns them, sorted by path, as the option
    C(files) of M(rosfleet.multimaster.managed_files) wants them.
  - Byte code and what editors leave behind is skipped, that is, C(__pycache__), C(*.pyc), C(*.pyo), C(*~), and every
    name that starts with a dot or with C(#).
  - The mode is V(0755) for a file that its owner may execute, and V(0644) for any other.
options:
  _terms:
    description:
      - The folders to read, for example V(files) of a role as C(role_path ~ '/files').
      - One that is not absolute is a folder of this collection, also outside of a role.
    type: list
    elements: path
    required: true
  destination:
    description:
      - The absolute folder of the managed computer that takes the place of each folder to read, for example
        V(/usr/local/lib/example).
    type: str
    required: true
  content:
    description:
      - Whether the files have their C(content). Without it they have C(sha256), its digest in hexadecimal.
    type: bool
    default: true
notes:
  - Call it with C(query), which always returns a list. C(lookup) returns a list only for two files or more; a single
    file it returns as a dictionary, unless it is given C(wantlist=true).
seealso:
  - module: rosfleet.multimaster.managed_files
"""

EXAMPLES = r"""
- name: Install the files of this role
  rosfleet.multimaster.managed_files:
    bundle: example
    files: "{{ query('rosfleet.multimaster.file_tree', role_path ~ '/files', destination='/usr/local/lib/example') }}"
"""

RETURN = r"""
_raw:
  description: The files, sorted by path.
  type: list
  elements: dict
  sample:
    - path: /usr/local/lib/example/python/example/__init__.py
      content: ""
      mode: "0644"
  contains:
    path:
      description: The path on the managed computer.
      type: str
      sample: /usr/local/lib/example/python/example/__init__.py
    content:
      description: The text; with O(content=false) there is C(sha256) in its place.
      type: str
      sample: ""
    mode:
      description: The permission bits.
      type: str
      sample: "0644"
"""

from typing import Any

from ansible.plugins.lookup import LookupBase

from ..plugin_utils._robot_io.trees import COLLECTION, read_tree


class LookupModule(LookupBase):
    """See DOCUMENTATION."""

    def run(self, terms: list[str], variables: Any = None, **kwargs: Any) -> list[dict[str, str]]:
        """Return the files below each of the folders."""
        self.set_options(var_options=variables, direct=kwargs)
        destination, content = self.get_option("destination"), self.get_option("content")
        return [file for source in terms for file in read_tree(str(COLLECTION / source), destination, content)]
