# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The optional features of a fleet, one row each. A feature is the folder `_features/<name>`, or a room of its own, and the core names it
only here.

A room of the core asks with `load_hooks` for the additions of the features. Each feature that has a file of that name gives the object
HOOKS of it. Such a file imports the rooms that the table in plugin_utils/README.md allows it, so no import runs in a circle.
"""

from __future__ import annotations

import functools
import importlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Protocol, TypeVar

H = TypeVar("H")
P = TypeVar("P", bound="FeaturePart")


@dataclass(frozen=True)
class Feature:
    """An optional feature: its files with HOOKS, and the words that Ansible's side needs of it."""

    name: str  # of its folders and of its role
    hooks: tuple[str, ...]
    # The rooms that are its own, below plugins, if it is large enough for one.
    rooms: tuple[str, ...] = ()
    # The files of Ansible's plugins that are its own, below plugins.
    plugins: tuple[str, ...] = ()
    # The options of the module multimaster_computer that its role hands over, and its bundles in the lists among them.
    concern: Mapping[str, str] = field(default_factory=dict)
    # The one of them that may cut the controller off, so its change is confirmed.
    guarded: str = ""


FEATURES = (
    Feature(
        "clock",
        hooks=("variables", "inventory", "model", "plan", "predict", "components", "checks", "adopt"),
        plugins=("filter/clock_files.py",),
        concern={"managed_files": "clock"},
    ),
    Feature(
        "tunnel",
        hooks=("variables", "inventory", "model", "plan", "units", "components", "context", "checks"),
        plugins=(
            *("action/fleet_keys.py", "action/tunnel.py", "action/tunnel_key.py", "filter/tunnel_files.py"),
            *("modules/fleet_keys.py", "modules/tunnel.py", "modules/tunnel_key.py"),
        ),
        concern={"tunnel": ""},
        guarded="tunnel",
    ),
    Feature(
        "multicast_routing",
        hooks=("variables", "inventory", "model", "plan"),
        plugins=("filter/multicast_router.py",),
        concern={"managed_files": "multicast_routing", "managed_services": "multicast_routing"},
    ),
    Feature(
        "adopt",
        hooks=(),
        rooms=("plugin_utils/_adopt",),
        plugins=("action/fleet_adopt.py", "modules/fleet_adopt.py"),
    ),
    Feature(
        "watch",
        hooks=(),
        rooms=("plugin_utils/_verify/watch", "module_utils/_probe/watch"),
        plugins=(
            *("action/fleet_watch.py", "action/multimaster_watch.py", "filter/watch_rounds.py"),
            *("modules/fleet_watch.py", "modules/multimaster_watch.py"),
        ),
    ),
)


class _Whole(Protocol):
    """A class of the core to which features add something."""

    @property
    def features(self) -> Mapping[str, Any]:
        """Name of a feature -> its addition."""


class FeaturePart:
    """The part that a feature adds to a class of the core, such as to the plan of a computer: `Clock.find(plan)`."""

    feature: ClassVar[str] = ""

    @classmethod
    def find(cls: type[P], whole: _Whole) -> P | None:
        """Return the part of this feature; None if the whole has no part of this feature."""
        found = whole.features.get(cls.feature)
        return found if isinstance(found, cls) else None

    @classmethod
    def read(cls: type[P], whole: _Whole) -> P:
        """Return the part of this feature in a whole that has it always, as variables do. Raises LookupError."""
        found = cls.find(whole)
        if found is None:
            raise LookupError(f"{type(whole).__name__} has nothing of the feature {cls.feature}")
        return found


@functools.cache
def load_hooks(file: str, kind: type[H]) -> Mapping[str, H]:
    """Return the additions of the features in their files of this name, by the name of the feature, in the order of FEATURES.

    Raises TypeError if the HOOKS of a file are of another kind.
    """
    root = __name__.rpartition("._base.")[0]
    found: dict[str, H] = {}
    for feature in FEATURES:
        if file in feature.hooks:
            hooks = importlib.import_module(f"{root}._features.{feature.name}.{file}").HOOKS
            if not isinstance(hooks, kind):
                raise TypeError(f"HOOKS of {feature.name}/{file}.py is no {kind.__name__}")
            found[feature.name] = hooks
    return found
