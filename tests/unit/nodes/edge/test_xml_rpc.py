# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""XML-RPC documents with bounds."""

import gzip

import pytest
from rosfleet_multimaster.edge.xml_rpc import unpack


def test_unpacking_is_bounded():
    assert unpack(gzip.compress(b"abc"), 3) == b"abc"
    with pytest.raises(ValueError, match="more than 2 bytes"):
        unpack(gzip.compress(b"abc"), 2)
