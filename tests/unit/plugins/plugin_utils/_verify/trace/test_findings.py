# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""From failures that no value shows to probes, and from what computers captured of them to one finding."""

import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.engine import Verification
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.checks.table import CHECKS
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.diagnose.diagnosis import (
    INFERRED,
    LOCATED,
    list_unshown,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.observations import FilterChains
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.outcomes import Outcome
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observe.packet_trace import (
    CapturedPacket,
    SeenPackets,
    SentProbe,
    TraceObservation,
)
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.trace.findings import has_all, name_addresses
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.trace.probes import (
    choose_probes,
    list_listeners,
)
from fleets import components, diagnose, fig12, mac, observed, update, wall

GATE = "tibi-visio"


def lose_behind_wall(filters):
    """A fleet, and what it sees of a wall at a gateway; `filters`: the rules that were read, None for none."""
    fleet = fig12()
    seen = observed(fleet)
    wall(seen)
    for observation in seen.values():
        update(observation, filters=filters)
    return fleet, seen


def follow(fleet, seen, missed=()):
    """The packet trace of a fleet in which the packets of each probe come in at a gateway, and end there.

    `missed`: computers that have missed packets. At all of them a stranger has sent more than is kept.
    """
    verification = Verification(CHECKS, fleet, seen)
    probes = choose_probes(verification, list_unshown(verification))
    captures = {name: [] for name in seen}
    for probe in probes:
        route = list(
            dict.fromkeys(place for place, _network in verification.ways.list_links(probe.sender, probe.target))
        )
        for before, after in zip(route, route[1:], strict=False):
            values = {
                "source_port": 4000,
                "port": probe.port,
                "number": probe.number,
                "sequence": probe.number,
                "ttl": 64,
            }
            ends = ("request", probe.protocol, "192.0.2.1", probe.address)
            for place, outgoing in ((before, True), (after, False)):
                captures[place].append(CapturedPacket("eth0", outgoing, *ends, **values, target_mac=mac(after)))
            if after == GATE:
                break
    for name in list_listeners(verification, probes):
        own = tuple(probe for probe in probes if probe.sender == name)
        sent = tuple(SentProbe(probe.number, Outcome.NO_ANSWER, source_port=4000) for probe in own)
        packets = SeenPackets(tuple(captures[name]), missed=int(name in missed), full=("203.0.113.9",))
        update(seen[name], packet_trace=TraceObservation(own, sent, packets))
    return probes


def test_a_healthy_fleet_has_nothing_to_follow():
    fleet = fig12()
    verification = Verification(CHECKS, fleet, observed(fleet))
    assert choose_probes(verification, list_unshown(verification)) == []
    assert list_listeners(verification, []) == []


def test_each_way_that_fails_is_followed_once_and_twelve_at_most():
    fleet = fig12()
    seen = observed(fleet)
    wall(seen)
    verification = Verification(CHECKS, fleet, seen)
    probes = choose_probes(verification, list_unshown(verification))
    assert 0 < len(probes) <= 12
    robots = {name: plan.robot for name, plan in fleet.computers.items()}
    assert len({(one.traffic, robots[one.sender], robots[one.target]) for one in probes}) == len(probes)
    assert "tibi" in {robots[name] for one in probes for name in (one.sender, one.target)}
    assert GATE in list_listeners(verification, probes)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("filters", "component"),
    [
        (None, ("filter", GATE, "forward")),  # its rules could not be read
        (FilterChains(True, ()), ("way", GATE, "ends")),  # they were read, and drop nothing; forwarding is on
    ],
    ids=["unread", "read"],
)
def test_where_packets_end_is_the_finding_or_what_it_leaves(filters, component):
    fleet, seen = lose_behind_wall(filters)
    before = diagnose(fleet, seen).findings[0]
    assert before.sure == INFERRED
    assert not before.do and before.look
    follow(fleet, seen)
    found = diagnose(fleet, seen)
    assert components(found)[0] == component
    first = found.findings[0]
    assert first.sure == LOCATED
    assert f"came in at {GATE} on eth0, and did not leave it" in first.followed[0].words
    way = first.followed[0].way
    assert way.at == GATE == way.hops[-1].receiver and way.words == first.followed[0].words
    assert [hop.network for hop in way.hops if hop.receiver == GATE][0] in ("the common network", "the network of tibi")
    assert (first.followed[0].words in first.sentence()) == (component[0] == "way")


def test_a_computer_that_missed_packets_is_not_blamed():
    """A flood hides what it saw, so nothing is located there, and what is inferred stays as it was."""
    fleet, seen = lose_behind_wall(None)
    before = diagnose(fleet, seen).findings[0]
    follow(fleet, seen, missed=tuple(seen))
    after = diagnose(fleet, seen)
    assert after.findings[0].component == before.component and {one.sure for one in after.findings} == {INFERRED}


def test_only_a_flood_in_the_name_of_a_member_hides_something():
    names = {"10.0.0.1": "one"}
    for full, whole in (((), True), (("203.0.113.9",), True), (("203.0.113.9", "10.0.0.1"), False)):
        assert has_all(SeenPackets(full=full), lambda address: names.get(address, "")) == whole


def test_an_address_beside_the_planned_ones_names_its_computer():
    fleet = fig12()
    seen = observed(fleet)
    (one, other, *_rest) = seen
    for name, more in ((one, ("10.9.9.1", "172.17.0.1")), (other, ("172.17.0.1",))):
        first = seen[name].probe.forwarding.interfaces[0]
        update(first, addresses=(*first.addresses, *more))
    name_at = name_addresses(Verification(CHECKS, fleet, seen))
    assert (name_at("10.9.9.1"), name_at("172.17.0.1")) == (one, "")  # each container host may have the second one
