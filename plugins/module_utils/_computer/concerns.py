# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The concerns of a computer, each by the name of its module, in the order in which a play brings them."""

import typing

from .._changes import file_bundle, service_bundle
from .._changes.module import Make
from .._firewall import run as firewall
from .._hosts import run as hosts
from .._packages import run as packages
from .._routes import run as routes
from .._sysctl import run as sysctl
from .._tunnel import run as tunnel

Options = typing.Mapping[str, typing.Any]


class Concern(typing.NamedTuple):
    """A module by its name, which is that of its dead-man's switch, too."""

    name: str
    options: Options  # the argument_spec of its module, without that of a confirmation
    make: Make  # its ModuleRun
    guarded: str = ""  # what its switch guards, as in a sentence; empty where it has none
    fixed: Options = {}  # options that its place in the order decides


_PACKAGES = Concern("multimaster_packages", packages.OPTIONS, lambda module, memory: packages.Packages(module.params))

CONCERNS = (
    Concern("sysctl", sysctl.OPTIONS, lambda module, memory: sysctl.Run(module.params, memory), "kernel settings"),
    Concern("routes", routes.OPTIONS, lambda module, memory: routes.Run(module.params, memory), "routes"),
    Concern(
        "firewall", firewall.OPTIONS, lambda module, memory: firewall.Run(module.params, memory), "packet filter rules"
    ),
    Concern("tunnel", tunnel.OPTIONS, tunnel.make_run, "peers of the tunnel"),
    Concern("hosts_entries", hosts.OPTIONS, lambda module, memory: hosts.Run(module.params, module.backup_local)),
    _PACKAGES._replace(fixed={"keep": True}),
    Concern("managed_files", file_bundle.OPTIONS, lambda module, memory: file_bundle.ManagedFiles(module.params)),
    Concern(
        "managed_services", service_bundle.OPTIONS, lambda module, memory: service_bundle.ManagedServices(module.params)
    ),
    _PACKAGES._replace(fixed={"keep": False}),  # no service needs them any more
)


def select_concerns(parameters: Options) -> typing.List[typing.Tuple[Concern, Options]]:
    """Return each concern that a module was asked for, with its options: one or more times, or not at all."""
    result: typing.List[typing.Tuple[Concern, Options]] = []
    for concern in CONCERNS:
        value = parameters[concern.name]
        runs = value if isinstance(value, list) else [] if value is None else [value]
        result += [(concern, {**options, **concern.fixed}) for options in runs]
    return result
