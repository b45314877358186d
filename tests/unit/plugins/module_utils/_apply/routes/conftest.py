# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Fixtures for the tests of the boot part of routes."""

import pytest


@pytest.fixture
def tree(tmp_path):
    """A root folder, with eth0 managed by ifupdown and eth1.5 by networkd."""

    def put(path, text=""):
        target = tmp_path / path.lstrip("/")
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(text)
        return target

    put("run/network/ifstate", "lo=lo\neth0=home\nppp0=ppp0\n")
    put("run/network/.ifstate.lock")
    (tmp_path / "etc/network").mkdir(parents=True)
    put("run/systemd/netif/links/2", "ADMIN_STATE=unmanaged\nOPER_STATE=routable\n")
    put("run/systemd/netif/links/3", "ADMIN_STATE=configured\nNETWORK_FILE=/usr/lib/systemd/network/50-robot.network\n")
    return tmp_path
