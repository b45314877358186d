# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Secrets, taken out of the data of a bundle. Pure: data in, the same data without them out.

A secret is known by the name next to it (`password: ...`), by its form (`AKIA...`, a private key, a random text), or by its value:
that of any variable of the inventory that is not the collection's own. Rather one text too many is taken out than one too few.

`tests/unit/plugins/plugin_utils/_bundle` has lines with secrets as people write them, and lines that stay as they are.
"""

from __future__ import annotations

import dataclasses
import ipaddress
import re
from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

T = TypeVar("T")

REMOVED = "(removed)"
SHORTEST = 4  # letters of a value that is searched
LONGEST = 4096
MOST = 5000  # values
ROOM = 1_000_000  # letters of different texts in data: one takes up to 15 microseconds

# Names of secrets, and their ends: `db_password`, `PGPASSWORD`. A phrase may follow the first ones, up to the end of its line;
# the others have one word.
_BEGIN = r"(?:(?<![^\W_])|(?-i:(?<=[a-z])(?=[A-Z])))"  # of a word, also of one in camel case
_PHRASES = (
    r"(?:password|passwd|passphrase|passwort|passcode|kennwort|contraseña|mot de passe|senha|secret|(?<![fn])pw"
    rf"|(?-i:(?<=[A-Z])(?<!COM)(?<!BY)(?<!TRES)PASS)|{_BEGIN}(?:pass|pwd|psk|credentials?|creds?))"
)
_KEYS = (
    r"(?:api|ssh|wep|wpa|wifi|wi-fi|wireless|wlan|network|licen[cs]e|encryption|shared|pre-?shared|access|private|secret|signing|auth|session"
    r"|storage|account|master|deploy|service|security|vault|aes|hmac|admin|root|user|client|server|robot|camera|mqtt)"
)
_SINGLE = (
    rf"(?:token|(?<=[a-z][_.])key|{_BEGIN}(?:cookie|vault|community|{_KEYS}[ _.-]?key(?:[_-]?id)?|pin[ _-]?code|(?-i:PIN|PUK|OTP)|otp|one[ _-]time code"
    r"|verification code|(?:session|php|j)sess?(?:ion)?_?id|session[ _]id|webhook(?:[ _-]?url)?|auth|sas|connection[ _]?string))"
)
_MORE = r"(?:s|\d{1,4}|[_-](?:id|value|text|hash|base64|enc|raw|plain|old|new))?"
_WORDS = rf"(?:{_PHRASES}|{_SINGLE}){_MORE}"
_QUOTED = (
    r"(?:[bBuUrRfF]{0,2}(?:\"\"\"[\s\S]{0,4000}?(?:\"\"\"|\Z)|'''[\s\S]{0,4000}?(?:'''|\Z)"
    r"|(?:\\{1,3}\"){3}[^\n]{0,4000}?(?:\\{1,3}\"){3}"
    r"|\\{1,3}\"[^\n]{0,4000}?\\{1,3}\"|\\{1,3}'[^\n]{0,4000}?\\{1,3}'|\"(?:[^\"\\\n]|\\[^\n])*\"|'(?:[^'\\\n]|\\[^\n])*'))"
)
_VALUE = rf"(?:{_QUOTED}|[\"'][^\n]+|[^\s,;&'\")\]}}]+)"
# Variables of an environment that a bundle has: those of ROS, and lists of folders. Of other variables it has only the names.
_LISTED = re.compile(r"ROS\w*|CATKIN_\w+|(?:\w+_)?PATH|PYTHON\w*|LANG|LC_\w+")
# Ansible's own names, and values that many variables have.
_ANSIBLE = re.compile(
    r"ansible_\w+|groups|group_names|hostvars|inventory_(?:hostname|hostname_short|dir|file)|omit|play_hosts|playbook_dir|role_\w+|vars|environment"
)
_CONFIGURATION = set(
    """
    true false none null auto default present absent started stopped enabled disabled localhost root local ipv4 ipv6
    noetic python3 production master robot robots computer network
    """.split()
)
_NAME = re.compile(rf"(?:{_WORDS}|[_.-]keys?)(?:[_-]file)?$|^vault", re.IGNORECASE)
_NO_NAME = re.compile(
    r"(?:^|[_.-])(?:public|pub|primary|foreign|sort|host|map|dict|known|cache|topic)[_-]?keys?$|^auth$", re.IGNORECASE
)

# The begin of a line of a journal; it may be between a name and its value on the next line.
_PREFIX = r"(?:[^\n]{0,20}\d\d:\d\d:\d\d\S{0,12} (?:[\w.-]{1,60} )?[\w./-]{1,60}(?:\[\d{1,9}\])?: )?"
_LINE = r"(?:\n|\\{1,3}n)"  # the end of a line, also in a text of JSON
_NEXT = rf"{_LINE}{_PREFIX}[ \t]*"
_IS = r"(?:\\{0,3}[\"']?\s{0,4}\]?\s{0,4}(?:[=:]+>?|-{1,2}>|\s(?:is|was|to|are|set to|changed to|is now|has been set to)\b:?)[ \t]*)"


_PEM = r"[A-Z0-9 ]{0,40}PRIVATE KEY[A-Z ]{0,40}-----"
_UPPER, _LOWER, _DIGIT = (rf"(?=[A-Za-z0-9+/]*{kind})" for kind in ("[A-Z]", "[a-z]", r"\d"))
# Words behind `password` and the like that do not begin a secret.
_ABOUT = (
    r"(?:is|are|for|was|were|and|or|of|has|have|in|to|on|at|by|with|from|not|no|file|files|auth|authentication|login|prompt|required|accepted|rejected"
    r"|expired?|expires|expiry|changed?|changes|ok|failed|failure|failures|mismatch|missing|incorrect|wrong|invalid|check|checked|checks|hash|hashes"
    r"|manager|policy|store|stores|database|age|length|field|entry|entries|protected|set|reset|needed|given|found|never|will|must|can|cannot"
    r"|does|did|may|should|as|than|that|which|still|already|too|bucket|ring|based|count|type|types|limit|less|refresh|refreshed|request|requests"
    r"|agent|server|service|lookup|query|update|updated|cache|cached|attempt|attempts|strength|empty|unknown|unset"
    r"|removed|line|lines|enabled|disabled|off|allowed|available|shown|stored|visible)\b"
)

# Each form of a secret, and its pattern. Group 1 is the name next to the secret, and stays.
# No pattern looks at a text more than a few hundred times: logs may be hostile.
FORMS = {
    "a private key": rf"(?s)-----BEGIN {_PEM}.*?(?:-----END {_PEM}|\Z)",
    "the rest of a private key": rf"(?s)\A.*-----END {_PEM}",
    "a line of a key": (
        rf"(?<![A-Za-z0-9+/=_.-])(?!/){_UPPER}{_LOWER}{_DIGIT}[A-Za-z0-9+/]{{60,}}={{0,2}}(?![A-Za-z0-9+=_.-])"
    ),
    # A key of WireGuard, also its public half: the text does not show which of the two it is.
    "32 bytes in base64": r"(?<![A-Za-z0-9+/])[A-Za-z0-9+/]{42}[AEIMQUYcgkosw048]=(?![A-Za-z0-9+/=])",
    "bytes in base64, filled up": (
        rf"(?<![A-Za-z0-9+/=_.-]){_UPPER}{_LOWER}{_DIGIT}[A-Za-z0-9+/]{{20,}}={{1,2}}(?![A-Za-z0-9+/=_.-])"
    ),
    "a text of ansible-vault": r"\$ANSIBLE_VAULT;[^\n]*(?:\s+(?:\S{1,40} ){0,3}[0-9a-f]{20,})*",
    "a key of age or PuTTY": r"\bAGE-SECRET-KEY-1[A-Z0-9]+|Private-Lines:[^\n]*(?:\n[A-Za-z0-9+/=]{20,})*",
    "a user in a URL": r"(?<=://)(?:[^\s/@:'\"]{0,200}:[^\s@'\"]{1,200}|[^\s/@'\"]{1,200})(?=@)",
    "a hook of a chat": r"(?i)(https?://[^\s/'\"<>]{1,200}/(?:[^\s'\"<>]{0,200}/)?(?:web)?hooks?/)[^\s'\"<>]+",
    "a hook of a chat at its own host": (
        r"(?i)((?<![\w.-])(?:https?://)?(?:[\w-]{1,63}\.){0,6}(?:hooks?\.\w{1,63}|webhook\w{0,56}\.\w{1,63}"
        r"|outlook\.office|maker\.ifttt|chat\.googleapis|discord(?:app)?|api\.telegram"
        r"|ntfy|logic\.azure|hc-ping|api\.pushover|pipedream)[\w.-]{0,200}(?::\d+)?/)[^\s'\"<>]+"
    ),
    "a query": (
        r"([?&](?:[\w.\[\]-]{1,60})=)(?=[^\s&#'\"<>]{16}|[^\s&#'\"<>]{0,15}[A-Z]"
        r"|[^\s&#'\"<>]{0,7}[A-Za-z][^\s&#'\"<>]{0,7}\d)[^\s&#'\"<>]+"
    ),
    "a header of HTTP": r"(?i)(authorization\\?[\"']?\s*[:=,]\s*)[^\n]+",
    "a cookie": r"(?i)\b(cookie\\?[\"']?\s*[:=]\s*)[^\n]+",
    "a bearer": r"(?i)\b((?:bearer|basic|digest)\s+)(?=[A-Za-z._~+/-]*[0-9A-Z=])[A-Za-z0-9._~+/=-]{8,}",
    "a JSON web token": r"\beyJ[A-Za-z0-9_-]{8,}\.[A-Za-z0-9_-]+(?:\.[A-Za-z0-9_-]*)?",
    "a key of Amazon": r"\b(?:AKIA|ASIA|AROA|AIDA|AGPA|ANPA)[A-Z0-9]{16}\b",
    "a key of Google": r"\bAIza[A-Za-z0-9_-]{30,}|\bya29\.[A-Za-z0-9_-]{20,}|\bGOCSPX-[\w-]{10,}",
    "a token of GitHub": r"\b(?:gh[pousr]_[A-Za-z0-9]{20,}|github_pat_[A-Za-z0-9_]{20,})",
    "a token of GitLab": r"\bgl[a-z]{2,5}-[A-Za-z0-9_-]{16,}",
    "a token of Slack": r"\bxox[abeprs]-[A-Za-z0-9-]{10,}|\bxapp-[A-Za-z0-9-]{10,}",
    "a key with a prefix": (
        r"\b(?:[srp]k[_-](?:live|test|proj|ant|or)[A-Za-z0-9_-]{10,}|sk-[A-Za-z0-9]{20,}|whsec_\w{10,})"
    ),
    "a token with a prefix": (
        r"\b(?:npm_|pypi-|hf_|hv[sb]\.|dop_v1_|tskey-|SG\.|shp(?:at|ss)_|lin_api_|ATATT|AccountKey="
        r"|dckr_pat_)[A-Za-z0-9._/+=-]{12,}"
    ),
    "a bot of Telegram": r"\b\d{8,10}:[A-Za-z0-9_-]{35}\b",
    "a hashed password": (
        r"\$(?:1|2[abxy]?|5|6|7|y|gy|argon2id?|apr1|sha1|pbkdf2[\w-]*)\$[^\s:'\"]{8,}|\{S?SHA\d*\}[A-Za-z0-9+/=]{20,}"
    ),
    "a password of sshpass": rf"\b(sshpass\s+-p\s*){_VALUE}",
    "a user of curl": rf"\b((?:curl|wget|http)\s[^\n]{{0,200}}?(?:-u|-a|--(?:proxy-)?user)[ =]?){_VALUE}",
    "a client of MySQL": (
        rf"\b((?:mysql\w*|mariadb[\w-]*|7z|mongo\w*|redis-cli)\s(?:[^\n|;]{{0,200}}?\s)?-[pa]\s?){_VALUE}"
    ),
    "a key of wpa_passphrase": rf"\b(wpa_passphrase\s+{_VALUE}\s+)[^\n|>]+",
    "an option of a client": (
        rf"\b((?:mosquitto_\w+|ipmitool|zip|unzip|vncviewer|xfreerdp|ldap\w+|openssl"
        rf"|kinit|docker login|ftp|lftp|sqlcmd|bcp)\s(?:[^\n|;]{{0,200}}?\s)?(?:-[PwkK]|/p:)\s?){_VALUE}"
    ),
    "a community of SNMP": rf"\b(snmp\w+\s[^\n|;]{{0,200}}?-[cAX]\s?){_VALUE}",
    "a user of Samba": r"\b((?:smbclient|mount\.cifs|rpcclient|net)\s[^\n|;]{0,200}?-U\s?[^\s%]+%)\S+",
    "a password for chpasswd": r"(\becho\s+(?:-\w+\s+){0,5}[\"']?[\w.-]+:)[^\n|]+(?=\|\s*(?:sudo\s+)?chpasswd)",
    "a password on standard input": (
        r"(\b(?:echo|printf)\s+(?:-\w+\s+){0,5})[^\n|]+"
        r"(?=\|\s*(?:sudo\s+-S|passwd|docker login|cryptsetup|gpg|kinit|su\b))"
    ),
    "a password as a word": (
        r"(\b(?:htpasswd\s+-\w*b\w*\s+\S+\s+\S+|add_user\s+\S+|change_password\s+\S+|useradd\s[^\n]{0,100}?-p"
        r"|requirepass|iwconfig\s+\S+\s+key|-passin\s+pass:|-passout\s+pass:|pass:)\s*)[^\s'\"]+"
    ),
    "a password of SQL": (
        rf"(?i)\b(identified\s+(?:with\s+\w+\s+)?by\s+(?:password\s+)?|(?:with\s+)?(?:encrypted\s+)?password\s+"
        rf"(?=')){_VALUE}"
    ),
    "the key of a line of .netrc": r"(\bmachine\s+\S+\s+login\s+\S+\s+password\s+)\S+",
    "an element": rf"(?i)(<(?:\w{{1,20}}:)?[\w./-]{{0,30}}?{_WORDS}\w{{0,10}}(?:\s[^<>]{{0,200}})?>)[^<]+",
    "an attribute next to a name": (
        rf"(?i)((?:\\{{0,3}}[\"'])?(?:name|key|id)(?:\\{{0,3}}[\"'])?\s*[=:]\s*\\{{0,3}}[\"'][\w./-]{{0,40}}?"
        rf"{_WORDS}\\{{0,3}}[\"']\s*[,; ]\s*(?:\\{{0,3}}[\"'])?(?:value|val|content|default)(?:\\{{0,3}}[\"'])?\s*[=:]\s*){_VALUE}"
    ),
    "a block of YAML": (
        rf"(?i)({_WORDS}\\{{0,3}}[\"']?\s{{0,4}}:[ \t]*[|>][-+\d]{{0,2}}[ \t]*)(?:{_LINE}{_PREFIX}[ \t]{{1,}}[^\n]+)+"
    ),
    "a list after its name": (
        rf"(?i)({_WORDS}\\{{0,3}}[\"']?\s{{0,4}}[:=]\s{{0,4}})[\[({{](?:{_LINE}{_PREFIX}|[^\])}}]){{0,2000}}[\])}}]?"
    ),
    "a header of its own name": (
        r"(?i)((?:x-[\w-]{0,30}(?:auth|key|token|secret)[\w-]{0,20})\\?[\"']?\s*[:=,]\s*)"
        r"(?![|>][-+\d]{0,2}(?:\s|\\))[^\n]+"
    ),
    "a value in quotes after its name": rf"(?i)({_WORDS}{_IS}(?:{_NEXT})?){_QUOTED}",
    "a value on the next line": rf"(?i)({_WORDS}{_IS}\\?{_NEXT})(?=\S)[^\n]+",
    "a phrase after its name": rf"(?im)({_PHRASES}{_MORE}{_IS})(?!\(removed\)|{_ABOUT}(?:[ ,;]|\.?$|\. ))[^\s][^\n]*",
    "a value after its name": rf"(?im)({_WORDS}{_IS})(?!\(removed\)|{_ABOUT}(?:[ ,;]|\.?$|\. )){_VALUE}",
    "a value behind its option": rf"(?i)((?<![\w-])--?[\w-]{{0,40}}?{_WORDS}\s+){_VALUE}",
    "a value behind its name": (
        rf"(?i)((?:{_BEGIN}(?:password|passphrase|passwd|passwort|kennwort|psk|pwd|pin code)|(?<![fn])pw)(?:\s+--\w+)?"
        rf"\s+)(?!\(removed\)|{_ABOUT}|[-/(<])[^\s][^\n]*"
    ),
    "a value some words behind its name": (
        rf"(?i)((?:password|passphrase|passwd|passwort|secret word)\s(?:[^\n:=]{{0,40}}?\s)?(?:is|was|will be)\s+)"
        rf"(?!{_ABOUT}){_VALUE}"
    ),
    "a value for a user": rf"(?i)({_PHRASES}\s(?:for|of|at|on|to)\s[^\s:=]{{1,60}}\s?[:=]\s?)(?!{_ABOUT})[^\s][^\n]*",
    "a user and a password": (
        r"(?i)(\b(?:login|user|as|failed for|credentials?)\s+[\w.-]{1,40}[:/])(?!\d+\b)(?=[^\s]{0,40}\d)[^\s:/]+"
    ),
    "a text for a command": rf"(<<<\s?){_VALUE}",
    "a line of a router or of Windows": (
        rf"(?i)(\b(?:enable\s+(?:secret|password)(?:\s+\d)?|snmp-server\s+community|password\s+\d"
        rf"|net\s+use\s[^\n]{{0,100}}?/user:\S+)\s+){_VALUE}"
    ),
    "a random value behind its name": (
        rf"(?i)({_BEGIN}(?:(?:{_KEYS} )?key|token|secret|code|pass)\s+)(?!\(removed\))(?=[^\s,;]{{0,99}}\d)"
        rf"(?=[^\s,;]{{0,99}}[A-Za-z])[^\s,;]{{6,}}"
    ),
    "a random value after `key`": (
        r"(?i)(\bkey\\?[\"']?\s*[=:]\s*[\"']?(?:s:)?)(?=[^\s,;&'\"]{0,99}\d)"
        r"(?=[^\s,;&'\"]{0,99}[A-Za-z])[^\s,;&'\"]{8,}"
    ),
    "a value behind -p": (
        r"(?<!mkdir)(?<!ssh)(?<!cp)(\s-p\s+)(?![-/.~$({]|\d+(?:[:/\s,-]|$)|\w+=|[\w.]+:\d)[^\s'\"]{4,}"
    ),
}
_PATTERNS = [re.compile(pattern) for pattern in FORMS.values()]
_RANDOM = re.compile(
    r"(?<![\w/+.=@~-])[A-Za-z0-9+_=-]{16,}(?![\w+/.=:-])|(?<![\w/.-])(?:[0-9a-f]{32,}|[0-9A-F]{32,})(?![\w.-])"
)
_UUID = re.compile(r"[0-9a-f]{8}(?:-[0-9a-f]{4}){3}-[0-9a-f]{12}", re.IGNORECASE)  # names of runs, boots and disks
_HEX = re.compile(r"[0-9a-f]+|[0-9A-F]+")
_SUM = re.compile(
    r"(?:md5|sha\d*|sum|digest|commit|revision|rev|hash|checksum|boot|invocation|build|version|image|type)"
    r"\W{0,3}(?:id|is|of)?\W{0,3}(?:[0-9a-f]{32,64}\W{1,3}(?:and|or|not|!=)\W{1,3})?$",
    re.IGNORECASE,
)
_CHANGE = re.compile(r"(?<=[a-z])[A-Z0-9]|(?<=[A-Z])[a-z0-9]|(?<=[0-9])[A-Za-z]")


def is_secret(name: str) -> bool:
    """Return True if the name of a variable, parameter or key is that of a secret."""
    return bool(_NAME.search(name)) and not _NO_NAME.search(name)


def collect_values(variables: Mapping[str, Any]) -> set[str]:
    """Collect the values of variables with the name of a secret."""
    values: set[str] = set()
    for name, value in variables.items():
        if is_secret(name):
            values |= set(list_texts(value))
        elif isinstance(value, Mapping):
            values |= collect_values({str(key): part for key, part in value.items()})
    return values


def collect_foreign(variables: Mapping[str, Any], own: Iterable[str]) -> set[str]:
    """Collect the values of variables that are no part of a bundle: all but the `own` ones, and Ansible's.

    Addresses and users in Ansible's variables stay in logs, see `Anonymous`.
    """
    names = set(own)
    values: set[str] = set()
    for name, value in variables.items():
        result = isinstance(value, Mapping) and {"changed", "failed", "skipped"} & value.keys()
        ansible = _ANSIBLE.fullmatch(name) and not name.endswith("_args")
        if name not in names and not result and not ansible:
            values |= {text for text in list_texts(value) if not _ordinary(text)}
    return values


def _ordinary(text: str) -> bool:
    """Return True if a value means nothing on its own: a word of configuration, a small number, an address."""
    if text.lower() in _CONFIGURATION or "{{" in text or (text.isdigit() and len(text) < 5):
        return True
    try:
        ipaddress.ip_interface(text)
    except ValueError:
        return False
    return True


def list_texts(value: Any) -> Iterable[str]:
    """Yield the texts and numbers in a value of any depth."""
    if isinstance(value, Mapping):
        value = list(value.values())
    if isinstance(value, (list, tuple)):
        for part in value:
            yield from list_texts(part)
    elif value is not None and not isinstance(value, bool):
        yield str(value)


class Secrets:
    """Takes secrets out. `known` are values of secrets, `kept` the names of the fleet, which are not secrets.

    `foreign` are values that are no part of a bundle. They are taken out of sentences and logs, but not out of data, where a word
    such as `ssh` may have a meaning.
    """

    def __init__(self, known: Iterable[str] = (), kept: Iterable[str] = (), foreign: Iterable[str] = ()) -> None:
        names = {name.lower() for name in kept}
        self._kept = names
        self._known = _compile_values(known, names)
        self._foreign = _compile_values(foreign, names)
        self._digests: dict[str, str] = {}
        self.room = ROOM  # letters that are still looked at in data; text beyond it is taken out unread
        self._seen: dict[str, str] = {}  # most texts of data are there many times

    def text(self, text: str) -> str:
        """Return a text, of any number of lines, without secrets."""
        text = self._foreign.sub(REMOVED, self._known.sub(REMOVED, text))
        return _RANDOM.sub(_replace_random, _clean(text))

    def word(self, text: str) -> str:
        """Return a value of data, such as a name or an address, without secrets."""
        return _clean(self._known.sub(REMOVED, text))

    def data(self, value: Any) -> Any:
        """Return plain data or dataclasses without secrets."""
        if isinstance(value, str):
            if len(value) < SHORTEST:
                return value
            return self._look(value)
        if isinstance(value, Mapping):
            return {key: self._clean_value(str(key), part) for key, part in value.items()}
        if isinstance(value, (list, tuple)):
            return type(value)(self.data(part) for part in value)
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            return self._record(value)
        return value

    def _look(self, text: str) -> str:
        if text not in self._seen:
            if len(text) > self.room:
                return REMOVED
            self.room -= len(text)
            self._seen[text] = self.text(text) if " " in text else self.word(text)
        return self._seen[text]

    def _clean_value(self, name: str, value: Any) -> Any:
        if is_secret(name) and name.lower() not in self._kept and value not in (None, "", 0, True, False):
            return REMOVED
        return self.data(value)

    def _record(self, value: T) -> T:
        """Return a dataclass without secrets. If its `name` is that of a secret, its other texts are removed too."""
        fields = dataclasses.fields(value)  # type: ignore[arg-type]
        # A public key in data is known by its place: the judgement compares it.
        parts = {
            field.name: self.data(getattr(value, field.name))
            if field.name != "public_key"
            else getattr(value, field.name)
            for field in fields
        }
        if isinstance(parts.get("environment"), Mapping):
            variables = parts["environment"].items()
            parts["environment"] = {name: text if _LISTED.fullmatch(name) else REMOVED for name, text in variables}
        if parts.get("digest"):  # a short value is found by its digest: a number shows as well which ones are the same
            parts["digest"] = self._digests.setdefault(parts["digest"], f"value {len(self._digests) + 1}")
        title = parts.get("name")
        if isinstance(title, str) and is_secret(title):
            parts.update({name: REMOVED for name in ("expected", "found", "value") if parts.get(name)})
        return dataclasses.replace(value, **parts)  # type: ignore[type-var]


def _compile_values(values: Iterable[str], names: set[str]) -> re.Pattern[str]:
    """Return the pattern of the lines of these values, the longest first."""
    lines = {line.strip() for value in values for line in value.splitlines()}
    worth = {line for line in lines if SHORTEST <= len(line) <= LONGEST and line.lower() not in names}
    return re.compile(rf"(?<![A-Za-z0-9])(?:{list_words(worth, MOST)})(?![A-Za-z0-9])")


def list_words(words: Iterable[str], most: int | None = None) -> str:
    """Return the words as alternatives of a pattern, the longest first; of no word a pattern that matches nothing."""
    longest = sorted(words, key=lambda word: (-len(word), word))[:most]
    return "|".join(map(re.escape, longest)) or r"(?!)"


def _clean(text: str) -> str:
    for pattern in _PATTERNS:
        text = pattern.sub(r"\1" + REMOVED if pattern.groups else REMOVED, text)
    return text


def _replace_random(match: re.Match[str]) -> str:
    """Return a long word, or REMOVED if it is as random as a key."""
    word = match[0]
    if _UUID.fullmatch(word):
        return word
    if _HEX.fullmatch(word):
        before = match.string[max(0, match.start() - 100) : match.start()]
        return word if len(word) < 32 or word.isdigit() or _SUM.search(before) else REMOVED
    changes = len(_CHANGE.findall(word))
    return REMOVED if changes >= len(word) / 4 and sum(letter.isdigit() for letter in word) >= 2 else word
