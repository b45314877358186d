# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The record of imports: a parameter of the roscore with the registrations of master_sync, and their masters.

It is JSON: {"node": name of master_sync, "uri": its URI, "imports": {URI of a master: {node: URI of the node}}}. It
lives on the parameter server, so it lives as long as the registrations do.
"""

import json
from typing import Any, Dict, NamedTuple

from . import json_text
from .messages import NodeKey

IMPORTS = "/rosfleet_multimaster/imports"

Claims = Dict[NodeKey, str]  # nodes that we registered -> URI of the master that they are of


def write(node: str, uri: str, claims: Claims) -> str:
    """The text of the record. `node` and `uri` are those of master_sync."""
    imports: Dict[str, Dict[str, str]] = {}
    for (name, node_uri), master in sorted(claims.items()):
        imports.setdefault(master, {})[name] = node_uri
    return json.dumps({"node": node, "uri": uri, "imports": imports})


class ImportRecord(NamedTuple):
    """The record: the name and the URI of master_sync, and the nodes that it registered."""

    node: str = ""
    uri: str = ""
    claims: Claims = {}


def read(text: Any) -> ImportRecord:
    """The record in a value of the parameter server; an empty one if it is damaged."""
    try:
        found = json_text.from_json(text) if isinstance(text, str) else {}
        claims = {
            (node, uri): master
            for master, nodes in found["imports"].items()
            for node, uri in nodes.items()
            if isinstance(uri, str)
        }
        return ImportRecord(str(found.get("node") or ""), str(found.get("uri") or ""), claims)
    except (AttributeError, KeyError, TypeError, ValueError):
        return ImportRecord()
