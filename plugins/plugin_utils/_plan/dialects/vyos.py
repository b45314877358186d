# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The dialect of VyOS."""

from __future__ import annotations

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.dialects._vyatta import vyatta

DIALECT = vyatta(
    position=3,
    title="VyOS 1.4 and later",
    nat="nat source rule 5",
    outbound="outbound-interface name",
    last="",
    redirects="firewall global-options send-redirects",
)
