# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Makes the Python classes of a ROS package's messages and services, as its build does: PACKAGE-FOLDER TARGET."""

import os
import sys

from genpy import generate_initpy, generator

folder, target = sys.argv[1:]
name = os.path.basename(folder)
LEFT_OUT = {"GetParticipants.srv"}  # ROS 1 and 2 share a folder of fkie_mas, and this is for ROS 2 alone
for kind, make in (("msg", generator.MsgGenerator()), ("srv", generator.SrvGenerator())):
    out = os.path.join(target, name, kind)
    os.makedirs(out)
    files = sorted(file for file in os.listdir(os.path.join(folder, kind)) if file.endswith("." + kind))
    paths = [os.path.join(folder, kind, file) for file in files if file not in LEFT_OUT]
    places = {name: [os.path.join(folder, "msg")], "std_msgs": ["/usr/share/std_msgs/msg"]}
    if make.generate_messages(name, paths, out, places):
        sys.exit(f"the {kind} files of {name} cannot be made classes")
    generate_initpy.write_modules(out)
open(os.path.join(target, name, "__init__.py"), "w").close()
