# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosfleet_multimaster.protocol.heartbeat import SIZE, Heartbeat, InvalidHeartbeat, Kind, Stamp, decode, encode

STATE = "52020000 11111111 22222222 33330000 44444444 55555555"
REQUEST = "52030000 00000000 00000000 5b2d0000 00000000 00000000"
LEAVE = "52020000 ffffffff ffffffff 5b2d0000 ffffffff ffffffff"

stamps = st.builds(Stamp, st.integers(1, 2**31 - 1), st.integers(0, 10**9 - 1))


@pytest.mark.parametrize(
    ("text", "record"),
    [
        (STATE, Heartbeat(Kind.STATE, 0x3333, 0.0, Stamp(0x11111111, 0x22222222), Stamp(0x44444444, 0x55555555))),
        (REQUEST, Heartbeat(Kind.REQUEST, 11611)),
        (LEAVE, Heartbeat(Kind.LEAVE, 11611, 0.0, Stamp(-1, -1), Stamp(-1, -1))),
    ],
)
def test_the_vectors_of_the_protocol(text, record):
    assert decode(bytes.fromhex(text)) == record
    assert encode(record) == bytes.fromhex(text)


@given(
    st.builds(
        Heartbeat,
        st.just(Kind.STATE),
        st.integers(1, 65535),
        st.integers(0, 255).map(lambda rate: rate / 10),
        stamps,
        stamps,
    )
)
def test_a_state_comes_back_as_it_was_sent(record):
    back = decode(encode(record))
    assert back._replace(rate=0) == record._replace(rate=0)
    assert abs(back.rate - record.rate) <= 0.1


@given(
    st.one_of(
        st.binary(max_size=64),
        st.binary(min_size=22, max_size=22).map(lambda tail: b"R\x02" + tail),
        st.binary(min_size=22, max_size=22).map(lambda tail: b"R\x03" + tail),
    )
)
def test_any_datagram_is_a_record_or_malformed(data):
    try:
        record = decode(data)
    except InvalidHeartbeat as problem:
        assert str(problem)
    else:
        assert len(data) == SIZE
        assert encode(record)


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"R", "1 bytes"),
        (b"R\x01" + bytes(12), "version 1"),
        (b"R\x01" + bytes(22), "version 1"),
        (b"R\x04" + bytes(22), "version 4"),
        (b"X\x02" + bytes(22), "letter R"),
        (b"R\x02" + bytes(19), "21 bytes"),
        (b"R\x02" + bytes(22), "no port"),
        (b"R\x02" + bytes(23), "25 bytes"),
        (encode(Heartbeat(Kind.STATE, 11611, 0.0, Stamp(-2, 0), Stamp(1, 0))), "before 1970"),
        (encode(Heartbeat(Kind.STATE, 11611, 0.0, Stamp(1, 0), Stamp(0, -5))), "before 1970"),
    ],
)
def test_what_is_no_record_is_named(data, why):
    with pytest.raises(InvalidHeartbeat, match=why):
        decode(data)


def test_a_stamp_tells_a_heartbeat_from_a_request():
    assert decode(bytes.fromhex(STATE.replace("5202", "5203"))).kind is Kind.STATE
    assert decode(bytes.fromhex(REQUEST.replace("5203", "5202"))).kind is Kind.STATE


@given(st.floats(1.0e9, 2.0e9, allow_nan=False))
def test_a_stamp_is_the_same_double_in_beat_message_and_document(seconds):
    stamp = Stamp.from_seconds(seconds)
    assert stamp.seconds == float(f"{seconds:.9f}") == seconds
    assert decode(encode(Heartbeat(Kind.STATE, 1, 0.0, stamp, stamp))).stamp.seconds == seconds


def test_rates_are_bounded():
    assert decode(encode(Heartbeat(Kind.STATE, 1, 100.0))).rate == 25.5
    assert decode(encode(Heartbeat(Kind.STATE, 1, 0.02))).rate == 0.0
