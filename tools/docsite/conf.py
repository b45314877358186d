# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The settings of Sphinx for the pages."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import yaml
from docutils import nodes

_GALAXY = yaml.safe_load((Path(__file__).resolve().parents[2] / "galaxy.yml").read_text(encoding="utf-8"))

project = f"{_GALAXY['namespace']}.{_GALAXY['name']}"
author = ", ".join(_GALAXY["authors"])
copyright = author
version = release = _GALAXY["version"]

extensions = ["myst_parser", "sphinx_antsibull_ext"]
root_doc = "index"
# A heading has the name that it has at GitHub, so links to it are the same in both places.
myst_heading_anchors = 6
html_theme = "furo"
html_title = f"{project} {release}"
html_static_path = ["static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sphinx = False
smartquotes = False  # code and commands are to be pasted

#: Pages of Ansible's documentation that those of antsibull-docs name. It is not asked: the site is built without a network.
_ANSIBLE = "https://docs.ansible.com/projects/ansible/latest/"
_THEIR_PAGES = {
    "action_plugins": "plugins/action.html#action-plugins",
    "ansible_configuration_settings": "reference_appendices/config.html#ansible-configuration-settings",
    "common_return_values": "reference_appendices/common_return_values.html#common-return-values",
}
# The theme has a list of the headings next to each page.
_CONTENTS = re.compile(r"^\.\. contents::.*\n(?: +:.*\n)*", re.MULTILINE)
_THEIR_PLUGIN = re.compile(r"ansible_collections\.(\w+)\.(\w+)\.(\w+)")


def lead_to_ansible(_app: Any, _env: Any, node: Any, text: nodes.Element) -> nodes.Element | None:
    """The address of a name in Ansible's documentation."""
    name = node["reftarget"]
    plugin = _THEIR_PLUGIN.fullmatch(name)
    if node["reftype"] == "envvar":
        page: str | None = f"reference_appendices/config.html#envvar-{name}"
    elif plugin:
        page = "collections/{}/{}/{}.html".format(*plugin.groups())
    else:
        page = _THEIR_PAGES.get(name)
    return nodes.reference("", "", text, internal=False, refuri=_ANSIBLE + page) if page else None


def leave_contents_out(_app: Any, _name: str, source: list[str]) -> None:
    """Take the list of its headings from a page of antsibull."""
    source[0] = _CONTENTS.sub("", source[0])


def setup(app: Any) -> None:
    app.connect("source-read", leave_contents_out)
    app.connect("missing-reference", lead_to_ansible)
