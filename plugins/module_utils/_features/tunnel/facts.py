# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The needs of a tunnel of WireGuard on this machine."""

import os
import typing

from ..._base.commands import text
from ..._probe.facts.part import FactPart


def tunnel(root: str = "/") -> typing.Dict[str, bool]:
    """Return if the kernel has WireGuard, and if there is a device for tunnels of programs (modules.dep(5))."""
    modules = os.path.join(root, "lib/modules", os.uname().release)
    known = (text(os.path.join(modules, name), 1 << 24) for name in ("modules.dep", "modules.builtin"))
    loaded = os.path.isdir(os.path.join(root, "sys/module/wireguard"))
    return {
        "kernel": loaded or any("/wireguard.ko" in content for content in known),
        "device": os.path.exists(os.path.join(root, "dev/net/tun")),
    }


FACT = FactPart("tunnel", tunnel, 5)
