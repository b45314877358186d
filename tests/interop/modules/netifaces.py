# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The part of the package netifaces that multimaster_fkie uses, which the lab's computers do not have.

Without it, multimaster_fkie needs a method that went with Python 3.9.
"""

import fcntl
import socket
import struct

AF_INET = socket.AF_INET
_SIOCGIFADDR = (
    0x8915  # netdevice(7); `ip` gives up its capabilities first, which the sandbox of the services does not let it
)


def interfaces():
    """The names of the interfaces."""
    return [name for _number, name in socket.if_nameindex()]


def ifaddresses(name):
    """The first address of an interface, by family."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asked:
        try:
            found = fcntl.ioctl(asked, _SIOCGIFADDR, struct.pack("256s", name.encode()[:15]))
        except OSError:
            return {}
    return {AF_INET: [{"addr": socket.inet_ntoa(found[20:24])}]}
