# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The programs that pass multicast on between interfaces of this machine."""

import os
import typing

from ..._base.commands import run
from ..._probe.facts.part import FactPart

# Such programs, by their units in Debian; the kernel takes one at a time.
_MULTICAST_ROUTERS = ("smcroute.service", "mrouted.service", "pimd.service", "igmpproxy.service")


def multicast_routing() -> typing.Dict[str, typing.Any]:
    """Find smcrouted, and the active units of other programs that pass multicast on."""
    places = (os.path.join(folder, "smcrouted") for folder in ("/usr/sbin", "/usr/local/sbin", "/sbin"))
    states = run(["systemctl", "is-active"] + list(_MULTICAST_ROUTERS)).text.split()
    return {
        "smcrouted": next((path for path in places if os.access(path, os.X_OK)), ""),
        "others": [unit for unit, state in zip(_MULTICAST_ROUTERS, states) if state == "active"],
    }


FACT = FactPart("multicast_routing", multicast_routing, 10)
