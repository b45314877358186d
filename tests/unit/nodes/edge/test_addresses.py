# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The addresses of this computer."""

import socket

from rosfleet_multimaster.edge.addresses import addresses


def test_the_kernel_lists_the_addresses():
    found = addresses()
    assert ("127.0.0.1", socket.if_nametoindex("lo")) in found
