# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause
"""The key of this computer in the tunnel, its files under the dead-man's switch, and the tunnel as WireGuard shows it."""
