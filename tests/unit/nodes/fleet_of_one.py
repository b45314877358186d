# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The members of a small fleet, as the plan has them."""

TIBI = {
    "robot": "tibi",
    "name": "tibi-visio",
    "uris": ["http://tibi-visio:11311/", "http://192.168.1.201:11311/"],
    "rpc_port": 11611,
    "addresses": ["192.168.1.201", "192.168.11.101"],
    "hosts": ["tibi-visio", "192.168.1.201", "192.168.11.101", "tibi-laser", "192.168.11.102"],
}
ROUTER = {"robot": "router", "name": "", "uris": [], "rpc_port": 0, "addresses": [], "hosts": ["router", "192.168.1.1"]}
URI = "http://tibi-visio:11311/"
