# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The diagnosis: the parts that explain what failed.

Pure: the plan and the observations in, findings out.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan.model import FleetPlan
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.observations import Observation
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._verify.parts import Part


@dataclass(frozen=True)
class Found:
    """A finding: a part that is broken."""

    part: Part
    verdict: str = "failed"
    rivals: tuple[Part, ...] = ()  # that explain the same: it is one of these
    proof: tuple[str, ...] = ()  # what speaks for it, a line each
    against: str = ""
    follows: int = 0  # observations that failed because of it


@dataclass(frozen=True)
class Diagnosis:
    """The findings, the most important first, and what none of them explains."""

    findings: tuple[Found, ...] = ()
    unexplained: tuple[str, ...] = ()


def diagnose(fleet: FleetPlan, observations: Mapping[str, Observation]) -> Diagnosis:
    """Find the smallest set of parts that explains what failed. Nothing is judged yet."""
    del fleet, observations
    return Diagnosis()
