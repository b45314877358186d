# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause
"""The packet filter, by a back end."""

__all__ = ("run",)
