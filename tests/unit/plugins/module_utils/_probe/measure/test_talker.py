# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The names that a talker uses."""

from ansible_collections.rosfleet.multimaster.plugins.module_utils._probe.measure import talker, topics
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import units

# systemd 237 (Ubuntu 18.04) does not know these: systemd.exec(5), "History".
LATER = {"PrivateMounts", "ProtectProc", "ProtectKernelLogs", "ProtectClock", "ProtectHostname", "RestrictSUIDSGID"}


def test_nodes_of_the_verification_have_names_of_their_own():
    names = {talker.node_of("run.1", computer) for computer in ("tibi-nav", "tibi-visio.lan")}
    assert names == {"/multimaster_verify_talker_tibi_nav_run_1", "/multimaster_verify_talker_tibi_visio_lan_run_1"}
    assert topics.listener_of("tibi-nav") == "multimaster_verify_listener_tibi_nav"


def test_topic_has_only_letters_of_a_graph_name():
    assert talker.topic_of("tibi-visio.lan") == "/multimaster_verify/tibi_visio_lan"


def test_the_talker_has_the_sandbox_of_the_services():
    service = units._SERVICE.format(inputs="", configuration="", sandbox=units._SANDBOX)
    lines = {line for line in service.splitlines() if "=" in line and not line.startswith(("#", "Environment"))}
    sandbox = {
        line
        for line in lines
        if line in units._SANDBOX or line.startswith(("Dynamic", "Cap", "ProtectHome", "RestrictA"))
    }
    assert {line for line in sandbox if line.partition("=")[0] not in LATER} == set(talker.SANDBOX)
