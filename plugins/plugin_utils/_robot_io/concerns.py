# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The concerns of a computer that a run is about: all, or those that --tags and --skip-tags name after their roles."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from .._base.features import FEATURES

#: tag, the name of a role -> its options of the module multimaster_computer, and its bundles in the lists among them
CONCERNS: dict[str, dict[str, str]] = {
    "sysctl": {"sysctl": ""},
    "routes": {"routes": ""},
    "firewall": {"firewall": ""},
    "hosts": {"hosts_entries": ""},
    "environment": {"managed_files": "environment", "shells": ""},
    "nodes": {"multimaster_packages": "", "managed_files": "nodes"},
    **{feature.name: dict(feature.concern) for feature in FEATURES if feature.concern},
    "services": {"managed_services": "multimaster"},
}
#: Ansible's own words in place of a tag
WORDS = {"all", "always", "never", "tagged", "untagged"}


class UnknownTag(ValueError):
    """A tag that no concern and no task has; the text is the sentence about it."""


def choose_concerns(
    options: Mapping[str, Any], run_tags: Iterable[str], skip_tags: Iterable[str], own_tags: Iterable[str]
) -> dict[str, Any]:
    """Return the options of those concerns that the tags of the run name; all, if the tags name no concern.

    `own_tags` are those of the task, which a foreign playbook may have given it. Raises UnknownTag.
    """
    wanted, unwanted = set(run_tags) - WORDS - set(own_tags), set(skip_tags) & set(CONCERNS)
    unknown = sorted(wanted - set(CONCERNS))
    if unknown:
        raise UnknownTag(
            f"{', '.join(unknown)} is no tag of a concern; expected some of {', '.join(CONCERNS)}: correct --tags."
        )
    if not wanted | unwanted:
        return dict(options)
    chosen = (wanted or set(CONCERNS)) - unwanted
    kept = {pair for tag in chosen for pair in CONCERNS[tag].items()}
    return {name: entry for name, value in options.items() if (entry := _keep(name, value, kept))}


def _keep(name: str, value: Any, kept: set[tuple[str, str]]) -> Any:
    """Return an option, or those of its bundles that are kept; nothing if it is of another concern."""
    if (name, "") in kept:
        return value
    return [bundle for bundle in value if (name, bundle["bundle"]) in kept] if isinstance(value, list) else None
