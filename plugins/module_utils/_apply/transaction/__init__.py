# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause
"""Record, transaction, files, units, the dead-man's switch."""

__all__ = (
    "atomic",
    "deadman",
    "file_bundle",
    "files",
    "lock",
    "module",
    "network",
    "record",
    "service_bundle",
    "transaction",
    "writable",
)
