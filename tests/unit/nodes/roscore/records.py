# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Records as tests write them: in the order of their rows."""

from rosfleet_multimaster.roscore.core.registry import Record

_FIELDS = {
    "service": ("name", "node", "place", "uri", "there"),
    "type": ("name", "value"),
    "node": ("name", "uri"),
    "set": ("name", "value"),
    "delete": ("name",),
    "refused": ("name", "uri", "value"),
    "parameter": ("name", "value"),
}


def rec(kind, *parts):
    """A record; a registration is there where nothing else is said."""
    return Record(kind, **dict(zip(_FIELDS.get(kind, ("name", "node", "uri", "there")), parts)))
