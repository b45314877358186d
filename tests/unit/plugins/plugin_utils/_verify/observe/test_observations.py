# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Observations as types: the samples of the contract are read without a loss, but for what no check reads."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._contract import trace, verify
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain import Mismatch, from_plain, to_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import (
    ForwardingInterface,
    Multicast,
    Probe,
    ServiceState,
    Talker,
    TargetRoute,
)


@pytest.mark.parametrize("kind", [Multicast, Probe, verify.Streams, trace.SentProbes, trace.SeenPackets])
def test_every_key_of_the_sample_is_read(kind):
    samples = kind.make_sample()
    read = to_plain(from_plain(kind, samples))
    assert set(read) == {name for name, entry in kind.FIELDS.items() if entry.kept}
    for key, value in read.items():
        assert_same(value, samples[key], key)


def assert_same(read, sample, where):
    """The observation read is the sample; a text that is missing is empty."""
    if isinstance(sample, dict):
        for key in set(read) & set(sample):
            assert_same(read[key], sample[key], f"{where}.{key}")
    elif isinstance(sample, list):
        assert len(read) == len(sample), where
        for one, other in zip(read, sample, strict=True):
            assert_same(one, other, where)
    else:
        assert read == sample or (read in ("", {}) and sample is None), where


def test_what_is_missing_has_a_default():
    assert from_plain(Probe, {"members": []}) == Probe()
    assert from_plain(TargetRoute, {"device": None, "source": None, "gateway": None, "error": "x"}) == TargetRoute(
        error="x"
    )
    interface = {"interface": "eth0", "addresses": [], "forwarding": None, "rp_filter": 0, "send_redirects": None}
    assert from_plain(ForwardingInterface, interface) == ForwardingInterface("eth0", rp_filter=0)
    assert from_plain(ServiceState, {"name": "sync", "unit": "u", "differing": None}).differing is None
    assert from_plain(Probe, {"talker": {"running": False, "error": "e"}}).talker == Talker(False, "e")


def test_what_is_no_result_is_named():
    with pytest.raises(Mismatch, match=r"members\[0\].addresses is 'x'; expected a list"):
        from_plain(Probe, {"members": [{"name": "a", "addresses": "x"}]})
