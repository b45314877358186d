# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Whether a user without rights can import modules of Python: the services of the nodes run as such a user."""

import re
import typing

from ansible_collections.rosfleet.multimaster.plugins.module_utils._module.plain_text import plain
from ansible_collections.rosfleet.multimaster.plugins.module_utils._process.foreign import foreign, last_line

_IMPORTING = 60.0  # seconds; 0.4 on a PC, cold on a small robot ten
_VERSION = re.compile(r"[23]\.[0-9]{1,3}\.[0-9]{1,3}")

_ASK = """
import importlib, json, sys
missing = []
for name in sys.argv[1:]:
    try:
        importlib.import_module(name)
    except Exception:
        missing.append(name)
print()
print(json.dumps({"version": "%d.%d.%d" % sys.version_info[:3], "missing": missing}))
"""


class Imported(typing.NamedTuple):
    """An import that was tried: the version of Python ("" for no answer), the modules that are missing, and what was said."""

    version: str
    missing: typing.List[str]
    said: str = ""


def tried(python: str, modules: typing.Sequence[str], environment: typing.Dict[str, str]) -> Imported:
    """Let a user without rights import modules with this Python."""
    answer = foreign([python, "-c", _ASK, *modules], environment, _IMPORTING)
    told = last_line(answer.output)
    told = told if isinstance(told, dict) else {}
    version, missing = told.get("version"), told.get("missing")
    if not isinstance(version, str) or not _VERSION.fullmatch(version) or not isinstance(missing, list):
        return Imported("", [], plain((answer.error.splitlines() or ["no answer"])[-1]))
    return Imported(version, [name for name in modules if name in missing])
