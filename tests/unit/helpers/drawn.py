# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Strategies of hypothesis over what a function draws out of a seed, such as those of lab/nodes/hostile/hostile_inputs.py."""

import random

from hypothesis import strategies as st


def drawn(draw, *given):
    """Return the result of `draw(random, *given)`."""
    return st.integers(0, 2**32).map(lambda seed: draw(random.Random(seed), *given))
