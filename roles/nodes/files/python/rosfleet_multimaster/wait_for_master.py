# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Wait until the roscore of ROS_MASTER_URI answers: `python3 -m rosfleet_multimaster.wait_for_master --timeout 60`."""

import argparse
import os

from . import program


def main() -> int:
    """Wait; raises program.Fatal."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--timeout", type=float, default=60.0, metavar="SECONDS")
    timeout = parser.parse_args().timeout
    program.wait_for_roscore(os.environ.get("ROS_MASTER_URI", "http://localhost:11311"), timeout)
    return 0


if __name__ == "__main__":
    program.run(main)
