# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Foreign text, made plain, by the file of the nodes: the controller has it on its disk, since it brings it to the robots."""

from __future__ import annotations

from ....roles.nodes.files.python.rosfleet_multimaster.protocol.plain_text import (
    LINE,
    LONGEST,
    VALUE,
    is_plain,
    plain,
    plain_data,
    plain_lines,
    quote,
)

__all__ = ("LINE", "LONGEST", "VALUE", "is_plain", "plain", "plain_data", "plain_lines", "quote")
