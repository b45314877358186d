# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The dialect of Ubiquiti EdgeOS."""

from __future__ import annotations

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.dialects._vyatta import vyatta

DIALECT = vyatta(
    position=4,
    title="Ubiquiti EdgeOS",
    nat="service nat rule 5001",
    outbound="outbound-interface",
    last="type masquerade",
    redirects="firewall send-redirects",
)
