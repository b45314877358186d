# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause
"""A client of ROS without rospy."""

__all__ = (
    "documents",
    "facts",
    "header",
    "hosts",
    "listener",
    "message_types",
    "node",
    "node_hosts",
    "node_services",
    "ros",
    "tcpros",
    "xml_rpc",
)
