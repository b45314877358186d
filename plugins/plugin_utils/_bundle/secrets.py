# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Secrets, taken out of what goes into a bundle. Pure: data in, the same data without them out.

Three ways to know one: by the name beside it (`password: ...`), by its form (`AKIA...`, a private key), and by its value, where
the inventory or the environment has it under such a name. Rather one text too many is taken out than one too few.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple, TypeVar

T = TypeVar("T")

REMOVED = "(removed)"
SHORTEST = 4  # letters of a value that is looked for on its own
LONGEST = 4096

_WORDS = (
    r"(?:pass(?:word|wd|phrase|code)?|pwd|psk|secret|token|credentials?|cookie|vault|auth[_-]?key|wep[_-]?key|wireless[_-]?key"
    r"|api[_-]?key|access[_-]?key(?:[_-]?id)?|private[_-]?key|secret[_-]?key|license[_-]?key|signing[_-]?key|encryption[_-]?key)"
    r"(?:s|\d+|[_-](?:id|value|text|file|hash|base64))?"
)
_BEGIN = r"(?:(?<![A-Za-z])|(?-i:(?<=[a-z])(?=[A-Z])))"  # of a word, also of one in camel case
_VALUE = r"(?:\"(?:[^\"\\]|\\.)*\"|'(?:[^'\\]|\\.)*'|[^\s,;&'\")\]}]+)"
_NAME = re.compile(rf"{_BEGIN}{_WORDS}$|^vault", re.IGNORECASE)


class Form(NamedTuple):
    """A form of a secret: what it is called, its pattern, and what is left of it."""

    name: str
    pattern: re.Pattern[str]
    left: str = REMOVED


def _form(name: str, pattern: str, left: str = REMOVED, flags: int = 0) -> Form:
    return Form(name, re.compile(pattern, flags), left)


_BEHIND = r"\1" + REMOVED
_PEM = r"[A-Z0-9 ]{0,40}PRIVATE KEY[A-Z ]{0,40}-----"
_UPPER, _LOWER, _DIGIT = (rf"(?=[A-Za-z0-9+/]*{kind})" for kind in ("[A-Z]", "[a-z]", r"\d"))

# No pattern looks at a text more than a few hundred times: logs may be anybody's.
FORMS = (
    _form("a private key", rf"-----BEGIN {_PEM}.*?(?:-----END {_PEM}|\Z)", flags=re.DOTALL),
    _form("the rest of a private key", rf"\A.*-----END {_PEM}", flags=re.DOTALL),
    _form(
        "a line of a key",
        rf"(?<![A-Za-z0-9+/=_.-])(?!/){_UPPER}{_LOWER}{_DIGIT}[A-Za-z0-9+/]{{60,}}={{0,2}}(?![A-Za-z0-9+=_.-])",
    ),
    _form("a text of ansible-vault", r"\$ANSIBLE_VAULT;[^\n]*(?:\s+(?:\S{1,40} ){0,3}[0-9a-f]{20,})*"),
    _form("a user in a URL", r"(?<=://)(?:[^\s/@:'\"]{0,200}:[^\s@'\"]{1,200}|[^\s/@'\"]{1,200})(?=@)"),
    _form("a header of HTTP", r"(authorization[\"']?\s*[:=]\s*)[^\n]+", _BEHIND, re.IGNORECASE),
    _form("a cookie", r"\b(cookie\s*:\s*)[^\n]+", _BEHIND, re.IGNORECASE),
    _form("a bearer", r"\b(bearer\s+)[A-Za-z0-9._~+/=-]{8,}", _BEHIND, re.IGNORECASE),
    _form("a JSON web token", r"\beyJ[A-Za-z0-9_-]{8,}\.[A-Za-z0-9_-]+(?:\.[A-Za-z0-9_-]*)?"),
    _form("a key of Amazon", r"\b(?:AKIA|ASIA|AROA|AIDA|AGPA|ANPA)[A-Z0-9]{16}\b"),
    _form("a key of Google", r"\bAIza[A-Za-z0-9_-]{30,}|\bya29\.[A-Za-z0-9_-]{20,}"),
    _form("a token of GitHub", r"\b(?:gh[pousr]_[A-Za-z0-9]{20,}|github_pat_[A-Za-z0-9_]{20,})"),
    _form("a token of GitLab", r"\bgl[a-z]{2,5}-[A-Za-z0-9_-]{16,}"),
    _form("a token of Slack", r"\bxox[abeprs]-[A-Za-z0-9-]{10,}"),
    _form("a key with a prefix", r"\b(?:[srp]k[_-](?:live|test|proj|ant|or)[A-Za-z0-9_-]{10,}|sk-[A-Za-z0-9]{20,})"),
    _form("a token with a prefix", r"\b(?:npm_|pypi-|hf_|hvs\.|dop_v1_|tskey-|SG\.)[A-Za-z0-9._-]{16,}"),
    _form("a hashed password", r"\$(?:1|2[abxy]?|5|6|7|y|gy|argon2id?|apr1|sha1)\$[^\s:'\"]{8,}"),
    _form("a password of sshpass", rf"\b(sshpass\s+-p\s*){_VALUE}", _BEHIND),
    _form("a user of curl", rf"\b(curl\s[^\n]{{0,200}}?(?:-u|--(?:proxy-)?user)[ =]?){_VALUE}", _BEHIND),
    _form(
        "a value beside its name", rf"({_BEGIN}{_WORDS}[\"']?\s*(?:[=:]+>?|\s+is\b)\s*){_VALUE}", _BEHIND, re.IGNORECASE
    ),
    _form("a value behind its option", rf"(--?[\w-]{{0,40}}{_BEGIN}{_WORDS}\s+){_VALUE}", _BEHIND, re.IGNORECASE),
    _form(
        "a value behind its name",
        rf"(\b(?:password|passphrase|passwd|psk|api key|access token)\s+)(?!(?:is|for|was|and|or|of|has|in|to)\b){_VALUE}",
        _BEHIND,
        re.IGNORECASE,
    ),
)


def named(name: str) -> bool:
    """Say whether the name of a variable, parameter or key says that its value is a secret."""
    return bool(_NAME.search(name))


def values(variables: Mapping[str, Any], encrypted: Iterable[str] = ()) -> set[str]:
    """Collect the values of variables whose names say that they are secrets, and of those that are `encrypted`."""
    chosen = set(encrypted)
    found: set[str] = set()
    for name, value in variables.items():
        if name in chosen or named(name):
            found |= set(_texts(value))
        elif isinstance(value, Mapping):
            found |= values({str(key): part for key, part in value.items()})
    return found


def _texts(value: Any) -> Iterable[str]:
    if isinstance(value, Mapping):
        value = list(value.values())
    if isinstance(value, (list, tuple)):
        for part in value:
            yield from _texts(part)
    elif value is not None and not isinstance(value, bool):
        yield str(value)


class Secrets:
    """Takes secrets out; `known` are values of which it is known. `kept` are names of the fleet: they are no secrets."""

    def __init__(self, known: Iterable[str] = (), kept: Iterable[str] = ()) -> None:
        names = {name.lower() for name in kept}
        lines = {line.strip() for value in known for line in value.splitlines()}
        worth = {line for line in lines if SHORTEST <= len(line) <= LONGEST and line.lower() not in names}
        longest = sorted(worth, key=lambda text: (-len(text), text))
        inner = "|".join(map(re.escape, longest))
        self._known = re.compile(rf"(?<![A-Za-z0-9])(?:{inner})(?![A-Za-z0-9])") if inner else None

    def text(self, text: str) -> str:
        """Return a text, of any number of lines, without secrets."""
        if self._known:
            text = self._known.sub(REMOVED, text)
        for form in FORMS:
            text = form.pattern.sub(form.left, text)
        return text

    def data(self, value: Any) -> Any:
        """Return plain data or dataclasses without secrets."""
        if isinstance(value, str):
            return self.text(value) if len(value) >= SHORTEST else value
        if isinstance(value, Mapping):
            return {key: self._beside(str(key), part) for key, part in value.items()}
        if isinstance(value, (list, tuple)):
            return type(value)(self.data(part) for part in value)
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            return self._record(value)
        return value

    def _beside(self, name: str, value: Any) -> Any:
        if named(name) and value not in (None, "", 0, True, False):
            return REMOVED
        return self.data(value)

    def _record(self, value: T) -> T:
        """Return a dataclass without secrets; where its `name` is that of a secret, so are its other texts."""
        fields = [field.name for field in dataclasses.fields(value)]  # type: ignore[arg-type]
        parts = {name: self.data(getattr(value, name)) for name in fields}
        called = parts.get("name")
        if isinstance(called, str) and named(called) and {"expected", "found", "value"} & parts.keys():
            parts.update({name: REMOVED for name in ("expected", "found", "value") if parts.get(name)})
        return dataclasses.replace(value, **parts)  # type: ignore[type-var]
