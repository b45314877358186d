# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""What multimaster_fkie uses of the package netifaces, which the lab's computers do not have.

Without it, multimaster_fkie needs a method that went with Python 3.9.
"""

import json
import socket
import subprocess

AF_INET = socket.AF_INET


def _links():
    listed = subprocess.run(["ip", "-json", "-4", "address"], stdout=subprocess.PIPE, check=True).stdout
    return {link["ifname"]: link["addr_info"] for link in json.loads(listed) if link}


def interfaces():
    """The names of the interfaces."""
    return list(_links())


def ifaddresses(name):
    """The addresses of an interface, by family."""
    addresses = [{"addr": entry["local"]} for entry in _links().get(name, [])]
    return {AF_INET: addresses} if addresses else {}
