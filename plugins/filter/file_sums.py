# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The filter file_sums: the digests of files, by which a computer can be compared without their content."""

from __future__ import annotations

DOCUMENTATION = r"""
name: file_sums
short_description: Give the digests of files in place of their content
version_added: "1.0.0"
description:
  - Takes the option O(rosfleet.multimaster.managed_files#module:files) and gives the same with C(sha256) in place of C(content), and the
    digest that M(rosfleet.multimaster.managed_files) returns for them.
options:
  _input:
    description: The files, with path, content and mode each.
    type: list
    elements: dict
    required: true
author:
  - rosfleet contributors (@rosfleet)
"""

EXAMPLES = r"""
- name: Show the digest that a service is started with
  ansible.builtin.debug:
    msg: "{{ ([{'path': '/etc/example.json', 'content': '{}', 'mode': '0644'}] | rosfleet.multimaster.file_sums).digest }}"
"""

RETURN = r"""
_value:
  description: The files and the digest over all of them.
  type: dict
  contains:
    files:
      description: The files, with C(sha256) in place of C(content).
      type: list
      elements: dict
      sample: []
    digest:
      description: One SHA-256 (hexadecimal) over the paths, modes and contents.
      type: str
      sample: 01ba4719c80b6fe911b091a7c05124b64eeece964e09c058ef8f9805daca546b
"""

import hashlib
from collections.abc import Mapping, Sequence
from typing import Any

from ansible.errors import AnsibleFilterError

from ..module_utils._apply.transaction import files
from ..module_utils._base.problem import Problem


def file_sums(planned: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return the files without their content, and their digest; see DOCUMENTATION."""
    sums = []
    for file in planned:
        rest = {name: value for name, value in file.items() if name != "content"}
        if "content" in file:
            rest["sha256"] = hashlib.sha256(str(file["content"]).encode("utf-8", "surrogateescape")).hexdigest()
        sums.append(rest)
    try:
        wanted = files.parse_files({"mode": "0644", **file, "content": ""} for file in sums)
    except Problem as problem:
        raise AnsibleFilterError(f"file_sums: {problem}") from problem
    return {"files": sums, "digest": files.digest(wanted)}


class FilterModule:
    """Ansible's way to find the filter."""

    def filters(self) -> dict[str, Any]:
        """Return the filters by name."""
        return {"file_sums": file_sums}
