# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""A program under the Python of ROS: the md5 sums of message types.

Runs as a program of its own under the Python of this computer's ROS, which may be 2.7 (kinetic, melodic); it is handed
over as text, so nothing here may import another part of the collection.
"""

import json
import os
import sys


def md5sums(types):
    """Return {type: md5 sum} of the types whose classes are there."""
    import roslib.message  # noqa: PLC0415 only if it runs as a program

    result = {}
    for name in types:
        try:
            result[name] = roslib.message.get_message_class(name)._md5sum
        except Exception:  # the import of a package may raise anything
            continue
    return result


def main():
    """Answer with the last line, whatever the packages print or leave running."""
    sys.stdout.write("\n" + json.dumps(md5sums(json.load(sys.stdin))) + "\n")
    sys.stdout.flush()
    os._exit(0)


if __name__ == "__main__":
    main()
