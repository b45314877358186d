# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The outcome of a probe: one fixed word that the checks decide by."""

from ....module_utils._contract.answers import ANSWERS
from ....module_utils._contract.fields import find_struct, strip_optional
from ....module_utils._contract.outcomes import Outcome

__all__ = ["Outcome", "list_outcome_keys"]


def list_outcome_keys() -> set[str]:
    """List the keys of all answers that have an outcome."""
    found, waiting = {"data"}, [struct for parts in ANSWERS.values() for struct in parts]
    while waiting:
        for name, entry in waiting.pop().FIELDS.items():
            if strip_optional(entry.kind) is Outcome:
                found.add(name)
            elif (struct := find_struct(entry.kind)) is not None:
                waiting.append(struct)
    return found
