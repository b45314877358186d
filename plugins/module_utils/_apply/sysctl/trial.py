# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""A trial of values by the kernel itself: they are written in an empty network namespace, which goes at once.

So check mode knows the refusals of the run, and nothing of the machine changes. The namespace has a user namespace of its own
(user_namespaces(7)), so that no value has the kernel load a module. If the namespace cannot be made, as in most containers, and for
keys outside of net, nothing is known.
"""

import contextlib
import ctypes
import errno
import json
import os
import re
import signal
import typing

from .kernel import Kernel, KeyState

_NEW = 0x10000000 | 0x40000000  # CLONE_NEWUSER | CLONE_NEWNET (unshare(2))
_INTERFACE = re.compile(r"(net/ipv[46]/(?:conf|neigh))/(?!all/|default/)[^/]+/")
# No answer on the value: the key is not in the namespace, or may not be changed there.
_UNKNOWN = (errno.ENOENT, errno.ENOTDIR, errno.EPERM, errno.EACCES, errno.EROFS, errno.ENODEV)
_LIMIT = 10  # seconds; it takes some hundredths

Values = typing.Mapping[str, str]


def try_values(kernel: Kernel, wanted: Values) -> typing.Dict[str, KeyState]:
    """Try values in a new network namespace that has this machine's other values. Keys without a known outcome are left out."""
    wanted = {key: value for key, value in wanted.items() if key.startswith("net/")}
    if not wanted:
        return {}
    neighbours = _read_neighbours(kernel, wanted)
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            signal.alarm(_LIMIT)
            if ctypes.CDLL(None).unshare(_NEW) == 0:
                os.write(writer, json.dumps(_try_in_namespace(kernel, wanted, neighbours)).encode("utf-8"))
        finally:
            os._exit(0)
    os.close(writer)
    with os.fdopen(reader, "rb") as stream:
        answer = stream.read()
    os.waitpid(child, 0)
    return {key: KeyState(*outcome) for key, outcome in json.loads(answer.decode("utf-8")).items()} if answer else {}


def _namespace_key(key: str) -> str:
    """The key in the namespace, whose only interface is lo."""
    return _INTERFACE.sub(r"\1/lo/", key)


def _read_neighbours(kernel: Kernel, wanted: Values) -> typing.Dict[str, str]:
    """The values of all keys in the folders of these: some values depend on others, such as a range of ports."""
    values = {}
    for folder in sorted({os.path.dirname(key) for key in wanted}):
        for name in sorted(os.listdir(kernel.path(folder))) if os.path.isdir(kernel.path(folder)) else ():
            key = f"{folder}/{name}"
            with contextlib.suppress(OSError):
                if os.path.isfile(kernel.path(key)):
                    values[key] = kernel.read(key)
    return values


def _try_in_namespace(kernel: Kernel, wanted: Values, neighbours: Values) -> typing.Dict[str, KeyState]:
    """Write the values, in the namespace."""
    for key, value in neighbours.items():
        _try_value(kernel, key, value)
    outcomes: typing.Dict[str, KeyState] = {}
    for _pass in range(2):  # the kernel refuses some values while another key has its present one
        for key, value in wanted.items():
            outcome = _try_value(kernel, key, value)
            if outcome is not None and not (key in outcomes and outcomes[key] == KeyState(value, 0)):
                outcomes[key] = outcome
    return outcomes


def _try_value(kernel: Kernel, key: str, value: str) -> typing.Optional[KeyState]:
    """Write one value and read it again; None if that says nothing about it."""
    number = 0
    try:
        kernel.write(_namespace_key(key), value)
    except OSError as problem:
        number = problem.errno or errno.EIO
    try:
        return None if number in _UNKNOWN else KeyState(kernel.read(_namespace_key(key)), number)
    except OSError:
        return None
