# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Questions to other masters for their time. The answers give the round trip, and the offset of the clock there."""

from typing import Any

from ..edge.clock import monotonic, wall_clock
from ..edge.loop import Workers
from ..edge.rpc_client import Rpc
from ..protocol.messages import Master
from .core.health import LIMIT, Answer, Health, read_answer


def ask(master: Master, workers: Workers, health: Health) -> None:
    """Ask a master in a worker, and hand the answer to `health`."""
    workers.submit(lambda: _ask(master.monitor_uri), lambda answer, _problem: health.take_answer(master.uri, answer))


def _ask(monitor_uri: str) -> Answer:
    rpc = Rpc(monitor_uri, LIMIT)
    began, wall = monotonic(), wall_clock()

    def read(value: Any) -> Answer:
        return read_answer(value, wall, monotonic() - began)

    try:
        answer: Answer = rpc.call("getCurrentTime", read=read)
        return answer
    finally:
        rpc.close()
