# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The contract: the answers of the modules that measure. Their RETURN and the controller's door for answers are made of it."""

import typing

from . import machine, multicast, trace, verify, watch
from .fields import Struct

#: module -> the parts of its answer; each key is a field of one of them
ANSWERS: typing.Mapping[str, typing.Tuple[typing.Type[Struct], ...]] = {
    "multimaster_verify": (verify.Probe, verify.Streams, verify.VerifyAnswer),
    "multicast_verify": (multicast.Multicast,),
    "multimaster_info": (machine.MachineFacts,),
    "multimaster_watch": (watch.WatchedEvents,),
    "multimaster_packet_trace": (trace.SentProbes, trace.SeenPackets, trace.TraceAnswer),
}
