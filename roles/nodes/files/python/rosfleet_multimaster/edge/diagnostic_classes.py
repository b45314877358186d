# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The classes of diagnostic_msgs: those of the robot, or else made here of the same definitions.

On a robot without the package no program looks at them, but one on its other computers may. Nothing is installed, so
nothing stands in the place of the package when it comes.
"""

from types import SimpleNamespace
from typing import Any

_RULE = "=" * 80
_DEFINITIONS = f"""\
Header header
DiagnosticStatus[] status
{_RULE}
MSG: std_msgs/Header
uint32 seq
time stamp
string frame_id
{_RULE}
MSG: diagnostic_msgs/DiagnosticStatus
byte OK=0
byte WARN=1
byte ERROR=2
byte STALE=3
byte level
string name
string message
string hardware_id
KeyValue[] values
{_RULE}
MSG: diagnostic_msgs/KeyValue
string key
string value
"""


def messages() -> Any:
    """Return a module with the classes DiagnosticArray, DiagnosticStatus and KeyValue."""
    try:
        from diagnostic_msgs import msg
    except ImportError:
        return generate_messages()
    return msg


def generate_messages() -> Any:
    """The same, as genpy makes them."""
    from genpy.dynamic import generate_dynamic

    classes = generate_dynamic("diagnostic_msgs/DiagnosticArray", _DEFINITIONS)
    return SimpleNamespace(**{name.rpartition("/")[2]: kind for name, kind in classes.items()})
