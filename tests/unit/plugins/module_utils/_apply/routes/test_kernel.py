# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The reader of `ip route show`: a route can be made again."""

from pathlib import Path

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes import kernel
from ansible_collections.rosfleet.multimaster.plugins.module_utils._apply.routes.kernel import RouteSpec
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.commands import Answer
from hypothesis import given
from hypothesis import strategies as st
from planned_routes import held, route

FIXTURES = Path(__file__).parents[4] / "fixtures" / "routes"


@pytest.mark.parametrize("version", [4, 6])
def test_the_words_of_a_route_bring_it_back_whole(version):
    lines = (FIXTURES / f"show{version}.txt").read_text().splitlines()
    texts = [held(line, version, 100).text for line in lines]
    assert texts == (FIXTURES / f"words{version}.txt").read_text().splitlines()


def test_what_the_words_do_not_say_is_named():
    found = held("unicast default via 192.168.11.1 dev eth0 proto boot scope global encap mpls 100")
    assert "encap" in found.inexpressible
    found = held("unicast default via 192.168.11.1 dev eth0 proto boot scope global mtu lock 1400 quickack 1")
    assert "quickack" in found.inexpressible
    assert found.text.endswith("mtu lock 1400") and "mtu" not in found.inexpressible


@pytest.mark.parametrize("kind", kernel.NO_WAY)
def test_without_a_way_a_scope_says_nothing(kind):
    """NetworkManager makes a blackhole with scope link."""
    assert held(f"{kind} 10.66.0.0/16 proto static scope link").route == RouteSpec("10.66.0.0/16", type=kind)


def test_a_next_hop_with_a_number_takes_no_line(monkeypatch):
    output = (
        b"unicast 10.13.0.0/16 nhid 7 proto boot scope global mtu lock 1300 \n\tnh_info id 7 group 5/6 scope global proto unspec \\\t"
        b"nexthop via 192.168.11.7 dev eth0 weight 1 \\\tnexthop via 192.168.11.8 dev eth0 weight 1 \n"
        b"unicast 10.14.0.0/16 tos 0x10 via 192.168.11.1 dev eth0 proto boot scope global \n"
        b"unicast 10.15.0.0/16 nhid 5 via 192.168.11.7 dev eth0 proto boot scope global \n\tnh_info id 5 via 192.168.11.7 dev eth0 \n"
    )
    monkeypatch.setattr(kernel, "run", lambda argv, limit: Answer(0, output, ""))
    several, one = kernel.read_routes(4, 254)
    assert several.text == (
        "10.13.0.0/16 proto boot mtu lock 1300 nexthop via 192.168.11.7 dev eth0 weight 1 nexthop via 192.168.11.8 dev eth0 weight 1"
    )
    assert several.inexpressible == one.inexpressible == ("nhid",)
    assert one.route == RouteSpec("10.15.0.0/16", "192.168.11.7", "eth0")


GATEWAYS = st.sampled_from(["", "192.168.11.1", "192.168.11.2"])


@given(
    st.builds(
        route,
        st.sampled_from(["0.0.0.0/0", "10.1.0.0/16", "10.2.3.4/32"]),
        GATEWAYS,
        metric=st.integers(0, 2**32 - 1),
        table=st.integers(1, 2**32 - 1),
        source=st.sampled_from(["", "192.168.11.100"]),
        mtu=st.sampled_from([0, 1400]),
        advmss=st.sampled_from([0, 1360]),
        initcwnd=st.sampled_from([0, 20]),
    )
)
def test_a_route_of_ours_is_read_as_it_was_made(wanted):
    words = kernel.to_words(wanted)
    if "table" in words:  # a listing of one table does not name it
        at = words.index("table")
        del words[at : at + 2]
    shown = " ".join(["unicast", *words])
    assert held(shown.replace("/32", ""), table=wanted.table).route == wanted
