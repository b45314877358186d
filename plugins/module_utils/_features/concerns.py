# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The concerns of the optional features on a computer, a row for each. The module multimaster_computer has all of them."""

import typing

from .._apply.transaction.module import Concern
from .tunnel.run import CONCERN as TUNNEL

CONCERNS: typing.List[Concern] = [
    TUNNEL,
]
