# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The tunnel as WireGuard tells it, whatever is told."""

import itertools

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._base.commands import Answer
from ansible_collections.rosfleet.multimaster.plugins.module_utils._features.tunnel import wireguard

OWN, ONE, TWO = (letter * 43 + "=" for letter in "ABC")
GOOD = {
    "public-key": OWN,
    "listen-port": "51820",
    "endpoints": f"{ONE}\t192.168.28.24:51820\n{TWO}\t(none)",
    "allowed-ips": f"{ONE}\t10.77.0.24/32 192.168.29.0/24\n{TWO}\t(none)",
    "latest-handshakes": f"{ONE}\t990\n{TWO}\t0",
}


@pytest.fixture(name="told")
def fixture_told(monkeypatch):
    """A wg that answers with these texts, by the word; ONE sends something between two questions."""
    texts, count = dict(GOOD), itertools.count(1)
    asked = []

    def run(argv):
        asked.append(argv[-1])
        text = f"{ONE}\t{next(count)}\t5\n{TWO}\t7\t9" if argv[-1] == "transfer" else texts.get(argv[-1])
        return Answer(1, b"", "no such device") if text is None else Answer(0, f"{text}\n".encode(), "")

    monkeypatch.setattr(wireguard, "run", run)
    sizes = {"/sys/class/net/multimaster0/mtu": "1420\n", "/sys/class/net/eth0/mtu": "1300\n"}
    monkeypatch.setattr(wireguard, "text", lambda path: sizes.get(path, ""))
    by_eth0 = {"10.77.0.24", "192.168.28.24"}
    monkeypatch.setattr(
        wireguard.network,
        "route_to",
        lambda to: wireguard.network.RouteTo(to, device="eth0" if to in by_eth0 else None),
    )
    monkeypatch.setattr(wireguard.time, "sleep", lambda seconds: None)
    monkeypatch.setattr(wireguard.time, "time", lambda: 1000.0)
    return texts, asked


def test_the_peers_are_told_with_what_was_heard(told):
    found = wireguard.look()
    one, two = found.pop("peers")
    assert found == {"up": True, "public_key": OWN, "port": 51820, "time_s": 1000.0, "mtu": 1420}
    assert one == {
        "public_key": ONE,
        "endpoint": "192.168.28.24:51820",
        "networks": ["10.77.0.24/32", "192.168.29.0/24"],
        "handshake_age_s": 10.0,
        "heard": True,
        "beside": ["10.77.0.24"],
        "carrier_mtu": 1300,
    }
    assert two == {
        "public_key": TWO,
        "endpoint": "",
        "networks": [],
        "handshake_age_s": None,
        "heard": False,
        "beside": [],
        "carrier_mtu": 0,
    }


@pytest.mark.parametrize(("later", "looks"), [(["1", "8"], 3), (["1"] * 11 + ["8"], 13), (["1"] * 30, 19), ([], 1)])
def test_it_listens_until_each_was_heard(told, monkeypatch, later, looks):
    """A handshake that was lost is tried again after 5 s."""
    answers = iter([{ONE: "1\t5"}] + [{ONE: f"{count}\t5"} for count in later] if later else [{}])
    asked = []
    monkeypatch.setattr(wireguard, "_read", lambda word: asked.append(word) or next(answers))
    before = wireguard.count_received()
    heard = wireguard._listen(before, before.keys(), wireguard.LISTENS)
    assert heard == ({ONE} if later[-1:] == ["8"] else set()) and len(asked) == looks


@pytest.mark.parametrize(
    ("ages", "counts", "looks"),
    [
        (("5", "5"), ["1", "8", "9"], 2),
        (("5", "0"), ["1"] * 40, 34),  # as long as the loss of a session may go unnoticed
        (("5", "5"), ["1"] * 20 + ["8"], 21),
        (("500", "0"), ["1"], 0),  # switched off since, or never there
        (("0", "0"), [], 0),
    ],
)
def test_it_waits_for_who_had_a_handshake_lately(told, monkeypatch, ages, counts, looks):
    times = [f"{key}\t{1000 - int(age) if age != '0' else 0}" for key, age in zip((ONE, TWO), ages, strict=True)]
    told[0]["latest-handshakes"] = "\n".join(times)
    answers, asked = iter(counts), []
    monkeypatch.setattr(
        wireguard, "count_received", lambda: asked.append(1) or dict.fromkeys((ONE, TWO), int(next(answers)))
    )
    wireguard.wait_for_sessions({ONE: 1, TWO: 1})
    assert len(asked) == looks


def test_the_private_key_is_not_asked_for(told):
    wireguard.look()
    assert not {"dump", "private-key", "preshared-keys"} & set(told[1])


def test_without_a_tunnel_there_is_nothing(told):
    told[0].clear()
    assert wireguard.look() == {
        "up": False,
        "public_key": "",
        "port": 0,
        "time_s": 1000.0,
        "mtu": 1420,
        "peers": [],
    }


@pytest.mark.parametrize(
    "text", ["", "\t", f"{ONE}", f"{ONE}\t\x1b[2J", "a" * 10**5, f"{ONE}\t" + "9" * 400, "\n" * 99]
)
@pytest.mark.parametrize("word", GOOD)
def test_any_words_give_plain_values(told, word, text):
    told[0][word] = text
    for peer in wireguard.look()["peers"]:
        assert len(peer["public_key"]) == 44 and len(peer["endpoint"]) <= 21
        assert all(len(network) <= 18 for network in peer["networks"])


def test_a_clock_that_went_back_makes_no_age_below_zero(told):
    told[0]["latest-handshakes"] = f"{ONE}\t5000"
    assert wireguard.look()["peers"][0]["handshake_age_s"] == 0.0
