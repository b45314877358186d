# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The outcome of a probe: one fixed word that the checks decide by."""

from ....module_utils._contract.outcomes import Outcome

__all__ = ["Outcome"]
