# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Signals that end a program wait until something has ended that must not be broken off: the removal of a lab, a command of podman."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Iterator
from types import FrameType

ENDING = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)


@contextlib.contextmanager
def defer_signals() -> Iterator[None]:
    """Signals that come within the block count after it. Work there must end within a time by itself.

    Python takes signals only in the main thread, so in another thread there is nothing to do.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    before = {number: signal.getsignal(number) for number in ENDING}
    for number in ENDING:
        signal.signal(number, lambda number, _frame: came.append(number))
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for number in dict.fromkeys(came):
            os.kill(os.getpid(), number)


def _ignore(_number: int, _frame: FrameType | None) -> None:
    """The program is about to end. (The commands that it starts would inherit an ignored signal.)"""


@contextlib.contextmanager
def exit_on_signals() -> Iterator[None]:
    """SIGTERM and SIGHUP end the program as an exception does, unless they are handled already. Further ones change nothing."""

    def end(number: int, _frame: FrameType | None) -> None:
        for other in mine:
            signal.signal(other, _ignore)
        sys.exit(128 + number)

    main = threading.current_thread() is threading.main_thread()
    mine = [number for number in (signal.SIGTERM, signal.SIGHUP) if main and signal.getsignal(number) == signal.SIG_DFL]
    for number in mine:
        signal.signal(number, end)
    try:
        yield
    finally:
        for number in mine:
            signal.signal(number, signal.SIG_DFL)
