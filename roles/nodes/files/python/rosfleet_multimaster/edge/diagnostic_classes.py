# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Messages of /diagnostics: the classes of diagnostic_msgs are those of the robot, or else made here of the same definitions.

On a robot without the package no program looks at them, but one on its other computers may. Nothing is installed, so
nothing is in the place of the package when it comes.
"""

import io
import struct
from types import SimpleNamespace
from typing import Any, Sequence

from ..protocol.messages import DiagnosticEntry
from ..protocol.plain_text import LINE, plain

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


def to_time(seconds: float) -> Any:
    """Return a time of ROS, of seconds since 1970."""
    from genpy import Time

    return Time.from_sec(max(seconds, 0.0))  # ROS has no earlier ones, whatever the clock says


def build_array(classes: Any, parts: Sequence[DiagnosticEntry], now: float, hardware: str) -> Any:
    """Return a DiagnosticArray with these entries. `classes`: of `messages`; `now`: the wall clock."""
    message = classes.DiagnosticArray(
        status=[
            classes.DiagnosticStatus(
                level=part.level,
                name=plain(part.name),
                message=plain(part.message, LINE),
                hardware_id=hardware,
                values=[classes.KeyValue(plain(key), plain(text, LINE)) for key, text in part.values],
            )
            for part in parts
        ]
    )
    message.header.stamp = to_time(now)
    return message


def serialize(message: Any) -> bytes:
    """Return a message as TCPROS has it, its length in front."""
    buffer = io.BytesIO()
    message.serialize(buffer)
    return struct.pack("<I", buffer.tell()) + buffer.getvalue()
