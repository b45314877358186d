# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The plan for kernel settings: the writes from the present values to the wanted ones, and the record of them. Pure.

Settings that are no longer listed are taken back first, in the reverse order of the list that set them: the kernel refuses
some values while another key has its present one. Then the listed settings are written, so they have the last word over
keys that the kernel changes with others.
"""

import os
import re
import typing

from ..._base.problem import Problem
from .boot import SYSCTL_FOLDERS, key_of, matches, name_of, normal, variable_of
from .kernel import Values, WantedValue, find_side_effects, followers, keeps_deviations, rules_of
from .record import Data, Entry, SettingsRecord

HEADER = "# Managed by Ansible: rosfleet.multimaster.sysctl writes this whole file, so changes here do not last.\n"


class SysctlPlan(typing.NamedTuple):
    """The writes of one run in their order, and the record before and after them."""

    writes: typing.List[WantedValue]
    goals: typing.Dict[str, str]  # the purpose of the writes: key -> value
    interim: SettingsRecord
    final: SettingsRecord
    after: Values
    removals: typing.List[Data]  # of settings that are no longer listed, as the module returns them
    side_effects: typing.List[Data]  # keys that the kernel changes with listed ones, as the module returns them


# The option


def settings_of(items: typing.Iterable[typing.Mapping[str, typing.Any]]) -> typing.List[WantedValue]:
    """The settings in a list of {name, value}, each key once; keys that change others come first.

    Raises Problem for an item that makes no sense, and for two values of one key.
    """
    settings: typing.Dict[str, typing.Tuple[str, WantedValue]] = {}
    for item in items:
        name, setting = item["name"], _setting(item)
        earlier_name, earlier = settings.setdefault(variable_of(setting.key), (name, setting))
        if earlier.value != setting.value:
            raise Problem(
                f"settings: {earlier_name} = {earlier.value} and {name} = {setting.value} are one key of the kernel, expected "
                "one value for it: remove one of them."
            )
    # The order holds for the drop-in, too: a key that changes others must not have the last word over them.
    return sorted((setting for name, setting in settings.values()), key=lambda setting: not rules_of(setting.key))


def optional_of(items: typing.Iterable[typing.Mapping[str, typing.Any]]) -> typing.FrozenSet[str]:
    """The keys whose absence is no failure."""
    return frozenset(key_of(item["name"].lstrip("-").strip()) for item in items if item.get("ignore_missing"))


def enough_of(items: typing.Iterable[typing.Mapping[str, typing.Any]]) -> typing.Dict[str, typing.Set[str]]:
    """The values that serve as well, by key, for the keys that have such."""
    return {
        key_of(item["name"].lstrip("-").strip()): {normal(_text(item["name"], value)) for value in item["enough"]}
        for item in items
        if item.get("enough")
    }


def _text(name: str, value: typing.Any) -> str:
    """A value as the kernel says it: 1 and 0 for a boolean, also for one that a template has made a text."""
    if isinstance(value, bool) or value in ("True", "False"):
        return "1" if value in (True, "True") else "0"
    if isinstance(value, (int, str)):
        return str(value)
    raise Problem(f"settings: {name} has the value {value!r}, expected a text, a whole number or a boolean.")


def _setting(item: typing.Mapping[str, typing.Any]) -> WantedValue:
    name, key = item["name"], key_of(item["name"].lstrip("-").strip())
    value = normal(_text(name, item["value"]))
    plain = re.match(r"[^\s=#;*?\[\]/]+(/[^\s=*?\[\]/]+)+$", key) and key.isprintable()
    if not plain or key_of(name_of(key)) != key or ".." in key:
        raise Problem(
            f"settings: found the name {name!r}, expected one key such as net.ipv4.ip_forward, without patterns."
        )
    if not value.isprintable():
        raise Problem(f"settings: {name} has the value {value!r}, expected printable text on one line.")
    return WantedValue(key, value)


def drop_in_text(settings: typing.Iterable[WantedValue], optional: typing.Container[str] = ()) -> typing.Optional[str]:
    """The text of the drop-in for these settings, None for no drop-in. `optional`: keys that may be missing at boot."""
    lines = [
        f"{'-' if setting.key in optional else ''}{name_of(setting.key)} = {setting.value}\n" for setting in settings
    ]
    return HEADER + "".join(lines) if lines else None


# Keys that come with a module of the kernel. It may be loaded after the settings are made at boot (sysctl.d(5)).
_MODULES = (
    ("net/netfilter/*", "nf_conntrack"),
    ("net/nf_conntrack_max", "nf_conntrack"),
    ("net/bridge/*", "br_netfilter"),
    ("net/ipv4/vs/*", "ip_vs"),
    ("net/sctp/*", "sctp"),
)


def rules_text(settings: typing.Iterable[WantedValue]) -> typing.Optional[str]:
    """The text of the rules of udev that set keys when their module is loaded, None where there is no such key."""
    keys: typing.Dict[str, typing.List[str]] = {}
    for setting in settings:
        for pattern, module in _MODULES:
            if matches(pattern, setting.key):
                keys.setdefault(module, []).append(setting.key)
    lines = [
        f'ACTION=="add", SUBSYSTEM=="module", KERNEL=="{module}", RUN+="/lib/systemd/systemd-sysctl'
        + "".join(f" --prefix=/{key}" for key in found)
        + '"\n'
        for module, found in sorted(keys.items())
    ]
    return HEADER + "".join(lines) if lines else None


def check_drop_in(path: str) -> None:
    """Raises Problem if a drop-in at this path would not be read at boot, or would not survive the boot."""
    lasting = [folder for folder in SYSCTL_FOLDERS if not folder.startswith("/run/")]
    name = os.path.basename(path)
    usable = name.endswith(".conf") and not name.startswith(".") and name.isprintable()
    if os.path.dirname(path) not in lasting or not usable:
        raise Problem(f"drop_in: found {path}, expected a file NAME.conf in one of {', '.join(lasting)}.")


# The plan


def plan(settings: typing.List[WantedValue], current: Values, record: SettingsRecord, drop_in: str) -> SysctlPlan:
    """The plan from the kernel's current values and the record to the settings.

    `current` holds the value of every key of settings and record, and of every key that the kernel changes with them;
    None if there is no such key. `record` has the folders that will be made for the drop-in, too.
    """
    start = {key: value for key, value in current.items() if value is not None}
    kernel = _Simulation(start)
    kept = {variable_of(setting.key) for setting in settings}
    removals = [_take_back(entry, kept, kernel) for entry in _find_removals(record, kept)]
    base = dict(kernel.values)
    for setting in settings:
        if setting.key in kernel.values:
            kernel.write(setting.key, setting.value)

    entries = {
        variable_of(setting.key): _plan_entry(setting, start, record.settings)
        for setting in settings
        if setting.key in start or variable_of(setting.key) in record.settings
    }
    others = {variable: entry for variable, entry in record.settings.items() if variable not in entries}
    final = {variable: entry._replace(set=entry.set[-1:]) for variable, entry in entries.items()}
    drop_ins = sorted(set(record.drop_ins) | {drop_in})
    return SysctlPlan(
        writes=kernel.writes,
        goals=kernel.goals,
        interim=SettingsRecord(drop_ins, record.folders, {**entries, **others}),
        final=SettingsRecord([drop_in], record.folders, final) if settings else SettingsRecord(),
        after={key: kernel.values.get(key) for key in current},
        removals=removals,
        side_effects=_find_side_effects(settings, kernel, base),
    )


class _Simulation:
    """The kernel's values as the planned writes will leave them."""

    def __init__(self, values: typing.Mapping[str, str]) -> None:
        self.values = dict(values)
        self.writes: typing.List[WantedValue] = []
        self.goals: typing.Dict[str, str] = {}

    def write(self, key: str, value: str) -> None:
        """Plan a write, unless the key has the value already."""
        if self.values[key] != value:
            changed = find_side_effects(key, value, self.values)
            self.writes.append(WantedValue(key, value))
            self.values.update(changed)
            self.values[key] = value
            for other in changed:  # a later write has the last word
                self.goals.pop(other, None)
        self.goals[key] = value

    def hold(self, key: str, value: str) -> None:
        """Note a value that the kernel spares."""
        self.values[key] = self.goals[key] = value


# One setting taken back


def _find_removals(record: SettingsRecord, kept: typing.Set[str]) -> typing.List[Entry]:
    """The entries of the record without a listed setting, the last one first; keys that change others before all."""
    entries = [record.settings[variable] for variable in reversed(list(record.settings)) if variable not in kept]
    return sorted(entries, key=lambda entry: not rules_of(entry.key))


def _take_back(entry: Entry, kept: typing.Set[str], kernel: _Simulation) -> Data:
    """The result for a setting that is no longer listed; its writes go to the simulated kernel."""
    value = kernel.values.get(entry.key)
    if value is None:
        state = "missing"
    elif value != entry.before and value not in entry.set:
        state = "left"
    else:
        state = "restored"
        _restore(entry, kept, kernel)
    after = kernel.values.get(entry.key)
    expected = entry.set[-1]  # the value that we had set
    return dict(name=name_of(entry.key), runtime_before=value, runtime_after=after, expected=expected, state=state)


def _restore(entry: Entry, kept: typing.Set[str], kernel: _Simulation) -> None:
    """Plan the value from before. The keys that follow it get theirs from before too, or keep a later change of another program."""
    if entry.before is None:
        raise AssertionError("a setting without a key is refused, so it has no record")
    followed, others = followers(entry.key, kernel.values[entry.key], kernel.values), dict(kernel.values)
    kernel.write(entry.key, entry.before)
    for other, value in followers(entry.key, entry.before, kernel.values).items():
        untouched = others[other] == followed[other]
        if variable_of(other) in kept | {variable_of(entry.key)}:
            continue
        if not keeps_deviations(entry.key):
            kernel.write(other, entry.beside.get(other, value) if untouched else others[other])
        elif other in entry.beside:
            kernel.hold(other, others[other])


# One listed setting


def _plan_entry(setting: WantedValue, start: typing.Mapping[str, str], owned: typing.Mapping[str, Entry]) -> Entry:
    """The record of a listed setting on the way, when an earlier value of ours or the last one may be there."""
    entry = owned.get(variable_of(setting.key)) or _new_entry(setting.key, start, owned)
    earlier = [value for value in entry.set if value != setting.value]
    return entry._replace(key=setting.key, set=[*earlier, setting.value])


def _new_entry(key: str, start: typing.Mapping[str, str], owned: typing.Mapping[str, Entry]) -> Entry:
    """The record of a key that becomes ours: its value from before, and those of the keys that change with it."""
    value = _original_value(key, start, owned)
    others = {} if value is None else followers(key, value, start)
    before = {other: _original_value(other, start, owned) for other in others}
    apart = {
        other: original for other, original in before.items() if original is not None and original != others[other]
    }
    return Entry(key, value, (), apart)


def _original_value(
    key: str, start: typing.Mapping[str, str], owned: typing.Mapping[str, Entry]
) -> typing.Optional[str]:
    """The value of a key before any run of ours."""
    if variable_of(key) in owned:
        return owned[variable_of(key)].before
    for entry in owned.values():
        ours = followers(entry.key, entry.set[-1], [key])
        if key in ours and ours[key] == start.get(key) and entry.before is not None:
            # The key has this value because of another setting of ours.
            return entry.beside.get(key, followers(entry.key, entry.before, [key])[key])
    return start.get(key)


def _find_side_effects(
    settings: typing.List[WantedValue], kernel: _Simulation, base: typing.Mapping[str, str]
) -> typing.List[Data]:
    """The keys with a value of their own that change with a listed key. `base`: the values before the settings."""
    keys = {setting.key for setting in settings}
    return [
        dict(name=name_of(other), before=base[other], after=kernel.values[other])
        for setting in settings
        if setting in kernel.writes
        for other in followers(setting.key, setting.value, kernel.values)
        if other not in keys and base[other] != kernel.values[other] and _was_apart(setting.key, other, base)
    ]


def _was_apart(key: str, other: str, base: typing.Mapping[str, str]) -> bool:
    """True if the other key had a value of its own. A key that was never set follows this key."""
    return base[other] != followers(key, base[key], [other])[other]
