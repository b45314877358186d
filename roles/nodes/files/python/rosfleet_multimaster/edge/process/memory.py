# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""The memory of a program: the C library gives the memory of a large answer back, and Python looks less at objects that stay."""

import contextlib
import ctypes
import gc

_M_MMAP_THRESHOLD, _M_ARENA_MAX = -3, -8  # malloc.h
_THRESHOLD = 1 << 17  # bytes: larger blocks go back to the kernel at once


def give_back() -> None:
    """Have one pool of memory instead of one for each thread. To be called before there are threads; only glibc has it.

    Each of eight workers kept the pool of the largest answer that it ever read: 225 MB, and one needs 90.
    """
    with contextlib.suppress(OSError, AttributeError):
        library = ctypes.CDLL(None)
        library.mallopt(_M_ARENA_MAX, 1)
        library.mallopt(_M_MMAP_THRESHOLD, _THRESHOLD)


def freeze() -> None:
    """Leave the present objects out of the search for cycles. A call that comes meanwhile waits: 14 ms with 20,000 registrations."""
    gc.collect()
    gc.freeze()
