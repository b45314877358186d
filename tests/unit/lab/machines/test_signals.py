# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Signals that wait until something has ended."""

import os
import random
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from machines.signals import ENDING, defer_signals
from processes import with_paths

LAB = Path(__file__).resolve().parents[4] / "lab"

# Says when it is within the block, and what was done there in spite of the signals.
PROGRAM = """
import signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell starts what runs in the background without it
signal.signal(signal.SIGHUP, signal.SIG_DFL)
from machines.signals import defer_signals, exit_on_signals
with exit_on_signals():
    try:
        with defer_signals():
            print("within", flush=True)
            time.sleep(0.3)
            with defer_signals():
                time.sleep(0.2)
            print("done", flush=True)
        time.sleep(30)
    finally:
        print("in order", flush=True)
"""


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_what_must_not_be_broken_off_ends_first(seed):
    draw = random.Random(seed)
    process = subprocess.Popen([sys.executable, "-c", PROGRAM], stdout=subprocess.PIPE, text=True, env=with_paths())
    assert process.stdout.readline() == "within\n"
    sent = [draw.choice(ENDING) for _number in range(draw.randint(1, 3))]
    for number in sent:
        process.send_signal(number)
    said, _errors = process.communicate(timeout=30)
    assert said == "done\nin order\n"
    assert process.returncode in {128 + number for number in sent} | {-signal.SIGINT}


def test_handlers_are_as_before_and_another_thread_has_none():
    before = [signal.getsignal(number) for number in ENDING]
    with defer_signals():
        assert [signal.getsignal(number) for number in ENDING] != before
    assert [signal.getsignal(number) for number in ENDING] == before
    seen = []

    def elsewhere():
        with defer_signals():
            seen.append([signal.getsignal(number) for number in ENDING])

    thread = threading.Thread(target=elsewhere)
    thread.start()
    thread.join()
    assert seen == [before]


def test_a_signal_within_the_block_counts_after_it():
    came = []
    before = signal.signal(signal.SIGHUP, lambda number, _frame: came.append(number))
    try:
        with defer_signals():
            os.kill(os.getpid(), signal.SIGHUP)
            assert came == []
        assert came == [signal.SIGHUP]
    finally:
        signal.signal(signal.SIGHUP, before)
