# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The reader of `ip route show`: JSON and text say the same, and a route can be made again."""

import json
from pathlib import Path

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._process.commands import Answer
from ansible_collections.rosfleet.multimaster.plugins.module_utils._routes import kernel
from ansible_collections.rosfleet.multimaster.plugins.module_utils._routes.kernel import Route
from hypothesis import given
from hypothesis import strategies as st

FIXTURES = Path(__file__).parents[3] / "fixtures" / "routes"


def route(destination, gateway="", device="eth0", metric=None, **more):
    if metric is None:
        metric = 1024 if ":" in destination else 0
    return Route(destination, gateway, device, metric, **more)


def held(text, version=4, table=254):
    raw = kernel.from_text(text)[0]
    return kernel.parse_route(raw, version, table)


@pytest.mark.parametrize("version", [4, 6])
def test_the_text_of_an_old_iproute2_says_the_same_as_json(version):
    raws = json.loads((FIXTURES / f"show{version}.json").read_text())
    lines = kernel.from_text((FIXTURES / f"show{version}.txt").read_text())
    assert [kernel.parse_route(raw, version, 254) for raw in lines] == [
        kernel.parse_route(raw, version, 254) for raw in raws
    ]


def test_the_words_of_a_route_bring_it_back_whole():
    texts = [kernel.parse_route(raw, 4, 100).text for raw in json.loads((FIXTURES / "show4.json").read_text())]
    assert texts == (FIXTURES / "words4.txt").read_text().splitlines()


def test_what_the_words_do_not_say_is_named():
    found = held("unicast default via 192.168.11.1 dev eth0 proto boot scope global encap mpls 100")
    assert "encap" in found.inexpressible
    found = held("unicast default via 192.168.11.1 dev eth0 proto boot scope global mtu lock 1400 quickack 1")
    assert "quickack" in found.inexpressible
    assert found.text.endswith("mtu lock 1400") and "mtu" not in found.inexpressible


@pytest.mark.parametrize("kind", kernel.NO_WAY)
def test_without_a_way_a_scope_says_nothing(kind):
    """NetworkManager makes a blackhole with scope link."""
    assert held(f"{kind} 10.66.0.0/16 proto static scope link").route == Route("10.66.0.0/16", type=kind)


def test_what_is_locked_is_known_from_the_text_alone():
    raws = [
        {"dst": "default", "gateway": "10.0.0.1", "dev": "eth0", "metrics": [{"mtu": 1400}]},
        {"dst": "10.1.0.0/16"},
    ]
    text = (
        b"unicast default via 10.0.0.1 dev eth0 proto boot scope global mtu lock 1400\nunicast 10.1.0.0/16 dev eth0\n"
    )
    kernel._add_locks(raws, Answer(0, text, ""))
    assert kernel.parse_route(raws[0], 4, 254).text == "default via 10.0.0.1 dev eth0 proto boot mtu lock 1400"
    raws[0]["metrics"] = [{"mtu": 1400}]
    kernel._add_locks(raws, Answer(0, b"", ""))  # the routes have changed meanwhile
    assert kernel.parse_route(raws[0], 4, 254).inexpressible


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
