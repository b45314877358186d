# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The concerns of a computer, each by the name of its module, in the order in which a play brings them."""

import typing

from ..._features.concerns import CONCERNS as FEATURES
from ..firewall import run as firewall
from ..hosts import run as hosts
from ..packages import run as packages
from ..routes import run as routes
from ..sysctl import run as sysctl
from ..transaction import file_bundle, service_bundle
from ..transaction.module import Concern

Options = typing.Mapping[str, typing.Any]

CONCERNS = (
    sysctl.CONCERN,
    routes.CONCERN,
    firewall.CONCERN,
    *FEATURES,
    hosts.CONCERN,
    packages.CONCERN._replace(fixed={"keep": True}),
    file_bundle.CONCERN,
    service_bundle.CONCERN,
    packages.CONCERN._replace(fixed={"keep": False}),  # no service needs them any more
)
OPTIONS: typing.Dict[str, typing.Any] = {
    concern.name: {"type": "list", "elements": "dict", "default": []} if concern.many else {"type": "dict"}
    for concern in CONCERNS
}


def select_concerns(parameters: Options) -> typing.List[typing.Tuple[Concern, Options]]:
    """Return each concern that a module was asked for, with its options: one or more times, or not at all."""
    result: typing.List[typing.Tuple[Concern, Options]] = []
    for concern in CONCERNS:
        value = parameters[concern.name]
        runs = value if isinstance(value, list) else [] if value is None else [value]
        result += [(concern, {**options, **concern.fixed}) for options in runs]
    return result
