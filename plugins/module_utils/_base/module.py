# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The AnsibleModule of our modules. Wrong options give a sentence. The log gets the names of options without their values.

Ansible would log all values: the nodes' files of half a megabyte, and the label that seals the messages of listeners.
"""

import typing

from ansible.module_utils.basic import AnsibleModule
from ansible.module_utils.common.arg_spec import ArgumentSpecValidator

from . import ends
from .problem import Problem

#: ansible-core up to 2.19 reads an item as an object before it checks the type, and raises TypeError.
NO_OBJECT = "A list among the options has an item that is no object, expected items of names and values, as the documentation has them."

#: No version of ansible-core catches this one.
NO_NUMBER = "An option that takes an integer has infinity, expected a number as the documentation has it."


class Module(AnsibleModule):
    """An AnsibleModule with a short line in the log."""

    def __init__(self, **arguments: typing.Any) -> None:
        try:
            super().__init__(**arguments)
            _check_texts(self.params, "")
        except TypeError:
            ends.fail(self, NO_OBJECT)
        except OverflowError:
            ends.fail(self, NO_NUMBER)
        except Problem as problem:
            ends.fail(self, str(problem))

    def _log_invocation(self) -> None:
        names = sorted(name for name, value in self.params.items() if value not in (None, "", [], {}))
        self.log(f"Invoked with {', '.join(names)}" if names else "Invoked")


def validate_options(
    name: str,
    options: typing.Mapping[str, typing.Any],
    specification: typing.Mapping[str, typing.Any],
    required_if: typing.Sequence[typing.Any] = (),
) -> typing.Dict[str, typing.Any]:
    """Return the options of another module, given as the option `name` of this one, as that module would have them. Raises Problem."""
    try:
        validation = ArgumentSpecValidator(specification, required_if=required_if).validate(options)
    except TypeError as problem:
        raise Problem(f"{name}: {NO_OBJECT}") from problem
    except OverflowError as problem:
        raise Problem(f"{name}: {NO_NUMBER}") from problem
    if validation.error_messages:
        raise Problem(f"{name}: {'; '.join(validation.error_messages)}.")
    return dict(validation.validated_parameters)


def _check_texts(value: typing.Any, place: str) -> None:
    """Raise Problem for a text with half of a character, as JSON may have it: it is no text of any file."""
    if isinstance(value, dict):
        for name, part in value.items():
            _check_texts(name, place)
            _check_texts(part, f"{place}.{name}".lstrip("."))
    elif isinstance(value, (list, tuple)):
        for number, part in enumerate(value, 1):
            _check_texts(part, f"{place} item {number}")
    elif isinstance(value, str):
        try:
            value.encode("utf-8", "surrogateescape")
        except UnicodeEncodeError:
            raise Problem(
                f"{place or 'An option'} has a text with half of a character (such as \\ud800), expected whole characters: correct it."
            ) from None
