# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The names that a talker uses."""

from ansible_collections.rosfleet.multimaster.plugins.module_utils._verify import talker, topics


def test_nodes_of_the_verification_have_names_of_their_own():
    names = {talker.node_of("run.1", computer) for computer in ("tibi-nav", "tibi-visio.lan")}
    assert names == {"multimaster_verify_talker_tibi_nav_run_1", "multimaster_verify_talker_tibi_visio_lan_run_1"}
    assert topics.listener_of("tibi-nav") == "multimaster_verify_listener_tibi_nav"


def test_topic_has_only_letters_of_a_graph_name():
    assert talker.topic_of("tibi-visio.lan") == "/multimaster_verify/tibi_visio_lan"
