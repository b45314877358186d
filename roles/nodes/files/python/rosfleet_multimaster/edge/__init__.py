# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The outside, for more than one program: sockets, threads, clock, ROS."""

__all__ = (
    "addresses",
    "clock",
    "connections",
    "core",
    "diagnostic_classes",
    "display",
    "journal",
    "lifeline",
    "local_roscore",
    "loop",
    "patience",
    "process",
    "ros",
    "roscore",
    "rpc_client",
    "rpc_server",
)
