# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""A program under the Python of ROS: the md5 sums of message types, and what upstream's master_sync has registered.

Runs as a program of its own under the Python of this computer's ROS, which may be 2.7 (kinetic, melodic); it is handed
over as text, so nothing here may import another part of the collection.
"""

import json
import os
import sys


def md5sums(types):
    """Return {type: md5 sum} of the types whose classes are there."""
    import roslib.message  # noqa: PLC0415 only where it runs as a program

    result = {}
    for name in types:
        try:
            result[name] = roslib.message.get_message_class(name)._md5sum
        except Exception:  # the import of a package may raise anything
            continue
    return result


def sync_nodes(service):
    """Return {URI of a master: {node: URI of the node}} by a get_sync_info, in whichever package its type is."""
    import rospy  # noqa: PLC0415 only where it runs as a program
    import rosservice  # noqa: PLC0415

    result = {}
    try:
        hosts = rosservice.call_service(service, [])[1].hosts
    finally:
        rospy.signal_shutdown("asked")  # the call made a node, and the end of main() would leave it registered
    for host in hosts:
        nodes = result.setdefault(host.masteruri, {})
        for entry in list(host.publisher) + list(host.subscriber) + list(host.services):
            nodes[entry.node] = entry.nodeuri
    return result


def main(questions):
    """Answer the questions, one line each, so that a service that never answers keeps nothing else back."""
    for name, answer in (("types", md5sums), ("service", sync_nodes)):
        if questions[name]:
            sys.stdout.write(json.dumps({name: answer(questions[name])}) + "\n")
            sys.stdout.flush()
    os._exit(0)  # a thread of rospy is not waited for


if __name__ == "__main__":
    main(json.load(sys.stdin))
