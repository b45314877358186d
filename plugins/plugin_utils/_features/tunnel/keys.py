# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The public keys of the tunnel's computers, as they are kept next to the inventory. Pure: texts in, keys and sentences out."""

from __future__ import annotations

import re
from collections.abc import Mapping

from ..._base.plain_text import LINE, quote
from ..._plan.model import ComputerPlan
from .model import Tunnel

# 43 letters have two bits more than 32 bytes. These are 0 in the one spelling of a key.
_KEY = re.compile("[A-Za-z0-9+/]{42}[AEIMQUYcgkosw048]=")


def is_key(text: object) -> bool:
    """Return True if a text is a public key: 32 bytes in base64, in the one spelling that wg(8) takes."""
    return isinstance(text, str) and _KEY.fullmatch(text) is not None


class WrongKeys(ValueError):
    """Keys that are not to be believed; the text is the sentence about them."""


def read_keys(text: str) -> dict[str, str]:
    """Read the kept keys: a computer and its key on each line. Raises WrongKeys."""
    keys: dict[str, str] = {}
    for number, line in enumerate(text.splitlines(), 1):
        words = line.partition("#")[0].split()
        if not words:
            continue
        if len(words) != 2 or not is_key(words[1]) or words[0] in keys or words[1] in keys.values():
            raise WrongKeys(
                f"line {number} is {quote(line, LINE)}; expected the name of a computer and its public key, each computer and each key once"
            )
        keys[words[0]] = words[1]
    return keys


def write_keys(keys: Mapping[str, str]) -> str:
    """Write the keys, in the order of the computers."""
    head = "# The public keys of the tunnel, by computer: written by rosfleet.multimaster, and nothing secret.\n"
    return head + "".join(f"{computer} {keys[computer]}\n" for computer in sorted(keys))


def join_keys(
    kept: Mapping[str, str], reported: Mapping[str, object], computers: Mapping[str, ComputerPlan], rotate: bool
) -> tuple[dict[str, str], dict[str, str]]:
    """Join the kept keys with those that computers have reported. Return them, and a sentence for each computer that is refused.

    A wrong report costs only its computer: it has the kept key then, or no key. A computer that is no longer in the plan loses its place. A
    key that has changed is believed only if that was asked for, and never if it is the kept one of another computer.
    """
    inside = {name for name, plan in computers.items() if Tunnel.find(plan)}
    keys = {computer: key for computer, key in kept.items() if computer in inside}
    new = {
        computer: key
        for computer, key in reported.items()
        if computer in inside and key not in ("", keys.get(computer))
    }
    reasons = {computer: _find_refusal(computer, key, keys, new, rotate) for computer, key in new.items()}
    refused = {computer: reason for computer, reason in reasons.items() if reason}
    keys.update({computer: str(key) for computer, key in new.items() if computer not in refused})
    return keys, {computer: f"{computer}: {reason}" for computer, reason in refused.items()}


def _find_refusal(computer: str, key: object, kept: Mapping[str, str], new: Mapping[str, object], rotate: bool) -> str:
    """Return the reason why a reported key is not believed; empty if it is."""
    if not is_key(key):
        return f"its public key is {quote(key, LINE)}; expected 32 bytes in base64: find out who answers there"
    owners = [other for other, one in (*kept.items(), *new.items()) if one == key and other != computer]
    if owners:
        return (
            f"its public key is that of {owners[0]}, too; expected a key of its own: one of them is a copy of the other, so run site.yml with "
            "-e tunnel_rotate=true"
        )
    if computer in kept and not rotate:
        return (
            f"its public key is {key}, and was {kept[computer]} before; expected the same: if you have set it up anew, run site.yml with "
            "-e tunnel_rotate=true, and else find out who answers there"
        )
    return ""
