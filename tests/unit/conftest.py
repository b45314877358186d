# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""What all unit tests share."""

from hypothesis import HealthCheck, settings

# Generated input counts, not the time that a loaded machine takes for it.
settings.register_profile("rosfleet", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("rosfleet")
