# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The options of the modules that own files whole."""


class ModuleDocFragment:
    """The files, and the place of their record."""

    DOCUMENTATION = r"""
options:
  files:
    description:
      - All files that the module owns.
    type: list
    elements: dict
    default: []
    suboptions:
      path:
        description: The absolute path of the file, for example V(/etc/rosfleet-multimaster/master_sync.json).
        type: str
        required: true
      content:
        description: The whole content as text, written in UTF-8, for example V({}\\n).
        type: str
        required: true
      mode:
        description:
          - The permission bits as M(ansible.builtin.copy) takes them, for example V("0755") or V(u=rwx,go=rx).
          - Octal digits are best in quotes. A symbolic mode changes C(0644), whatever is there.
        type: raw
        default: "0644"
      owner:
        description:
          - The name or number of the user to own the file, for example V(root). By default the user that the module
            runs as.
        type: str
      group:
        description:
          - The name or number of the group of the file, for example V(dialout). By default the group that the module
            runs as.
        type: str
      validate:
        description:
          - A command and its arguments that gets the content on its standard input and fails when it is not fit to be
            written, for example V([visudo, -c, -f, -]). It runs only if the file is to change, in check mode too,
            and before anything changes.
        type: list
        elements: str
        default: []
  records:
    description:
      - The folder of this collection's records on the computer, for example V(/var/lib/rosfleet-multimaster).
    type: str
    default: /var/lib/rosfleet-multimaster
"""
