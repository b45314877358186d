# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The concerns of a computer, each by the name of its module, in the order in which a play brings them.

Most of the time goes into compiling code. So the code of a concern is imported only where the concern is asked for.
"""

import typing

from ansible.module_utils.common.arg_spec import ArgumentSpecValidator

from .._module.module import NO_OBJECT
from .._module.problem import Problem

Options = typing.Mapping[str, typing.Any]


class Code(typing.NamedTuple):
    """The code of a concern."""

    options: Options  # the argument_spec of its module, without that of a confirmation
    make: typing.Callable[[typing.Any, typing.Any], typing.Any]  # module, memory (see deadman.Guard) -> ModuleRun


class Concern(typing.NamedTuple):
    """A module by its name, which is that of its dead-man's switch, too."""

    name: str
    load: typing.Callable[[], Code]
    guarded: str = ""  # what its switch guards, as in a sentence; empty where it has none
    fixed: Options = {}  # options that its place in the order decides


def _sysctl() -> Code:
    from .._sysctl import run

    return Code(run.OPTIONS, lambda module, memory: run.Run(module.params, memory))


def _routes() -> Code:
    from .._routes import run

    return Code(run.OPTIONS, lambda module, memory: run.Run(module.params, memory))


def _hosts() -> Code:
    from .._hosts import run

    return Code(run.OPTIONS, lambda module, memory: run.Run(module.params, module.backup_local))


def _files() -> Code:
    from .._changes import file_bundle as run

    return Code(run.OPTIONS, lambda module, memory: run.ManagedFiles(module.params))


def _services() -> Code:
    from .._changes import service_bundle as run

    return Code(run.OPTIONS, lambda module, memory: run.ManagedServices(module.params))


def _firewall() -> Code:
    from .._firewall import run

    return Code(run.OPTIONS, lambda module, memory: run.Run(module.params, memory))


def _packages() -> Code:
    from .._packages import run

    return Code(run.OPTIONS, lambda module, memory: run.Packages(module.params))


CONCERNS = (
    Concern("sysctl", _sysctl, "kernel settings"),
    Concern("routes", _routes, "routes"),
    Concern("firewall", _firewall, "packet filter rules"),
    Concern("hosts_entries", _hosts),
    Concern("multimaster_packages", _packages, fixed={"keep": True}),
    Concern("managed_files", _files),
    Concern("managed_services", _services),
    Concern("multimaster_packages", _packages, fixed={"keep": False}),  # no service needs them any more
)


def select_concerns(
    parameters: Options, concerns: typing.Iterable[Concern] = CONCERNS
) -> typing.List[typing.Tuple[Concern, Options]]:
    """Return each concern that a module was asked for, with its options: one or more times, or not at all."""
    result: typing.List[typing.Tuple[Concern, Options]] = []
    for concern in concerns:
        value = parameters[concern.name]
        runs = value if isinstance(value, list) else [] if value is None else [value]
        result += [(concern, {**options, **concern.fixed}) for options in runs]
    return result


def validate(concern: Concern, specification: Options, options: Options) -> typing.Dict[str, typing.Any]:
    """Return the options of a concern as its module would have them. Raises Problem."""
    try:
        validation = ArgumentSpecValidator(specification).validate(options)
    except TypeError as problem:
        raise Problem(f"{concern.name}: {NO_OBJECT}") from problem
    if validation.error_messages:
        raise Problem(f"{concern.name}: {'; '.join(validation.error_messages)}.")
    result: typing.Dict[str, typing.Any] = validation.validated_parameters
    return result
