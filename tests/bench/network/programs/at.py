# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""at.py TIME COMMAND...: runs a command at a time of the kernel's steady clock, which all containers share."""

import os
import sys
import time

time.sleep(max(0.0, float(sys.argv[1]) - time.monotonic()))
os.execvp(sys.argv[2], sys.argv[2:])
