# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""XML-RPC documents with bounds: what the standard library writes is read as it reads it, and what is hostile is refused."""

import ast
import contextlib
import gzip
import pathlib
import random
import tracemalloc
import xmlrpc.client

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosfleet_multimaster.protocol import xml_rpc
from rosfleet_multimaster.protocol.xml_rpc import ANSWER, STATE, DocumentTooLarge, loads, unpack

TEXT = st.text(st.characters(blacklist_categories=("Cs",), min_codepoint=32, blacklist_characters="\ufffe\uffff"))
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**31), 2**31 - 1) | st.floats(allow_nan=False) | TEXT | st.binary(),
    lambda inner: st.lists(inner) | st.dictionaries(TEXT, inner),
    max_leaves=30,
)


def document(value):
    return f"<methodResponse><params><param>{value}</param></params></methodResponse>".encode()


@pytest.mark.slow
@given(st.lists(VALUES, max_size=5), st.booleans())
def test_what_the_standard_library_writes_is_read(values, packed):
    body = xmlrpc.client.dumps(tuple(values), "method", allow_none=True).encode()
    body = gzip.compress(body, mtime=0) if packed else body
    assert loads(body, ANSWER * 16, packed) == (tuple(values), "method")


@pytest.mark.parametrize(
    "values",
    [[1] * 9000, [""] * 9000, ["/a"] * 9000, [[]] * 9000, [{"a": 1}] * 3000, [True] * 9000, [[["/a", ["/b"]]] * 300]],
)
def test_what_libraries_write_is_never_too_dear(values):
    body = xmlrpc.client.dumps((values,), methodresponse=True).encode()
    assert loads(body, len(body))[0] == (values,)


def test_unpacking_is_bounded():
    assert b"".join(unpack([gzip.compress(b"abc")], 3)) == b"abc"
    with pytest.raises(ValueError, match="more than 2 bytes"):
        list(unpack([gzip.compress(b"abc")], 2))


HOSTILE = {
    "nesting": ("<value><array><data>" * 100 + "</data></array></value>" * 100, "within each other"),
    "a number": ("<value><int>" + "1" * 401 + "</int></value>", "400 digits"),
    "wide texts": (("<value>" + "a" * 9000 + "\U0001f916</value>") * 1000, "memory"),
    "texts of two bytes": (("<value>" + "a" * 9000 + "я</value>") * 1750, "memory"),
    "a text that becomes wide": ("<value>" + "a" * (3 << 20) + "я</value>", "text of more"),
    "a long text": ("<value>" + "a" * (5 << 20) + "</value>", "text of more"),
    "a long comment": ("<!--" + "a" * (1 << 20) + "-->", "token"),
    "a long attribute": ('<value a="' + "a" * (1 << 20) + '"/>', "token"),
    "short elements": ("<value/>" * (2 << 20), "memory"),
    "empty mappings": ("<value><struct/></value>" * 699_000, "memory"),
    "too long": ("<value>" + " " * STATE + "</value>", "bytes"),
}


DEAR = ("short elements", "empty mappings")  # seconds of tracemalloc; packed, they are parsed as the others are


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "packed"),
    [(kind, packed) for packed in (False, True) for kind in HOSTILE if not (packed and kind in DEAR)],
)
def test_a_hostile_document_is_refused_before_it_costs_much(kind, packed):
    text, why = HOSTILE[kind]
    body = document(text)
    body = gzip.compress(body, 1) if packed else body
    tracemalloc.start()
    try:
        with pytest.raises(DocumentTooLarge if why == "memory" else ValueError, match=why):
            loads(body, STATE, packed)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 75 << 20


TAGS = ("value", "string", "i8", "bigdecimal", "nil", "base64", "array", "data", "struct", "member", "name", "param")
TEXTS = (
    "",
    "1",
    "aa",
    "\n ",
    "YWFh",
    "éé",
    "漢",
    "漢漢漢",
    "a\U0001f916",
    "<![CDATA[é]]>",
    "a<!-- -->b<?c?>d",
    "1" * 300,
)
DENSE = [
    *(f"<value>{text}</value>" for text in TEXTS),
    *(f"<{tag}>{text}</{tag}>" for tag, text in (("string", "漢"), ("array", ""), ("struct", ""), ("bigdecimal", "1"))),
    "<value><struct><member><name>漢%d</name><value>漢</value></member></struct></value>",
]


def draw_element(chance, depth):
    """Any element, of any elements and texts: it need not mean anything."""
    tag = chance.choice(TAGS)
    parts = [draw_element(chance, depth - 1) for _number in range(chance.choice([0, 1, 1, 2]) if depth else 0)]
    return f"<{tag}>{''.join([chance.choice(TEXTS), *parts])}</{tag}>"


MORE = [pytest.param(draw_element(random.Random(seed), 4), marks=pytest.mark.costly) for seed in range(8, 20)]


@pytest.mark.slow
@pytest.mark.parametrize("unit", [*DENSE, *(draw_element(random.Random(seed), 4) for seed in range(8)), *MORE])
def test_a_document_costs_the_memory_that_is_counted(unit):
    most = 1 << 20
    body = "".join(unit.replace("%d", str(number)) for number in range(most // len(unit.encode())))
    text = document(f"<value><array><data>{body}</data></array></value>")[:most]
    tracemalloc.start()
    try:
        with contextlib.suppress(Exception):  # what makes no sense, and what is too dear
            loads(text, most)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 1.25 * (
        2 * most + (1 << 20)
    )  # a list that grows has up to an eighth more, and the parser its buffers


@pytest.mark.parametrize("tag", ["string", "base64"])
def test_a_text_within_many_elements_is_one_text(tag):
    around = 90
    body = document(f"<value>{f'<{tag}>' * around}{'YWFh' * (1 << 18)}{f'</{tag}>' * around}</value>")
    tracemalloc.start()
    try:
        values = loads(body)[0]
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert sum(map(bool, values)) == 1 and peak < 10 << 20


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "utf-16-be"])
def test_document_types_are_refused_in_every_encoding(encoding):
    text = '<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a "ha">]>' + document("<value>&a;</value>").decode()
    with pytest.raises(Exception):  # noqa: B017, PT011 ours or expat's
        loads(text.encode(encoding))


def test_it_is_for_the_python_of_the_modules():
    ast.parse(pathlib.Path(xml_rpc.__file__).read_text(encoding="utf-8"), feature_version=(3, 6))
