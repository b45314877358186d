# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Secrets as people write them, and ordinary lines: secrets.txt and ordinary.txt beside the tests of bundles; and any secret in any form."""

import json
import random
import string
from pathlib import Path
from typing import NamedTuple

FOLDER = Path(__file__).parents[1] / "plugins/plugin_utils/_bundle"
TIME = "2026-11-22T14:02:12+0000 master_sync[812]: "


class Planted(NamedTuple):
    """A text, and what must not be left of it."""

    text: str
    parts: tuple[str, ...]


def _rows(name):
    lines = (FOLDER / name).read_text(encoding="utf-8").splitlines()
    return [line for line in lines if line and not line.startswith("#")]


def _planted(row):
    parts, _bar, text = row.replace("~~", "").partition(" || ")
    return Planted(text.replace("\\\\\\n", "\\\n").replace("\\n", "\n"), tuple(parts.split("&&")))


PLANTED = tuple(map(_planted, _rows("secrets.txt")))
ORDINARY = tuple(_rows("ordinary.txt"))

LETTERS, DIGITS = string.ascii_letters, string.digits
NAMES = """
password passwd passphrase PASSWORD DB_PASSWORD PGPASSWORD MYSQL_ROOT_PASSWORD SSHPASS robot_pass dbPassword wifi-password psk wpa-psk mqtt_pw rootpw
secret client_secret CLIENT_SECRET clientSecret camera/password passwort pwd adminPwd
""".split()
TOKENS = """
token access_token API_TOKEN authToken api_key API-KEY apiKey mapsApiKey ssh_key wifi.key private_key secretKey snmp_community session_id
licence_key SIGNING_KEY webhook x-api-key encryption_key vault_thing
""".replace("vault_thing", "").split()
# A phrase of several words may follow a name of NAMES, one word a name of TOKENS.
WRITTEN = (
    "{name}: {it}",
    "{name}={it}",
    "{name} = {it}",
    "{name} : {it}",
    "{name} is {it}",
    "{name}:\n{it}",
    "{name} =>{it}",
    "{name} -> {it}",
)
QUOTED = (
    '{name}: "{it}"',
    "{name}='{it}'",
    '{{"{name}": "{it}"}}',
    "{{'{name}': '{it}', 'x': 1}}",
    '"{name}": [\n"{it}"]',
    "<{name}>{it}</{name}>",
    '{{"a": {{"{name}":"{it}"}}}}',
    '{name} = """{it}"""',
    '{{"name": "{name}", "value": "{it}"}}',
    "--{name} '{it}'",
    '--{name}="{it}"',
    "{name}: |\n  {it}",
    "{name}: >-\n    {it}\n    {it}",
    "u'{name}': u'{it}'",
    '{name}:\n  "{it}"',
)
ELSEWHERE = (
    "https://anna:{it}@git.example.org/x.git",
    "amqp://bot:{it}@broker:5672",
    "Authorization: Bearer {it}",
    "Cookie: sid={it}",
    "run -p {it}",
    "mysql -u root -p{it} robots",
    "sshpass -p {it} ssh x",
    "curl -u anna:{it} http://x",
    "wpa_passphrase lab {it}",
    "GET /x?a=1&access_token={it}&b=2",
    "https://hooks.slack.com/services/T0/B0/{it}",
    "https://chat.example.org/hooks/{it}",
    "snmpwalk -v2c -c {it} host",
    "echo anna:{it} | chpasswd",
    "mosquitto_pub -u a -P {it} -t x",
    "--token {it}",
    "--db-password {it} -v",
    "redis-cli -a {it}",
    "PGPASSWORD={it} psql",
)
AROUND = (
    "{it}",
    "{time}{it}",
    "before\n{it}\nafter",
    "{time}one\n{time}{it}\n{time}two",
    "  {it}",
    "error: {it}",
    "env: A=1 {it}",
    "# {it}",
    "+ {it}",
    "- {it}",
    "msg: something failed; {it}",
    "\t{it}",
    "x" * 300 + " {it}",
    "({it})",
    "[INFO] [1669125734.123]: {it}",
)


def _word(drawn, signs=""):
    """One word, as people or programs make one."""
    kind = drawn.randrange(5)
    if kind == 0:
        return "".join(drawn.choices(string.ascii_lowercase, k=drawn.randrange(6, 12))) + drawn.choice(DIGITS + signs)
    if kind == 1:
        return "".join(drawn.choices(string.hexdigits[:16], k=drawn.choice((16, 32, 40, 64)))) + "z"
    if kind == 2:
        return "".join(drawn.choices(LETTERS + DIGITS + "_-", k=drawn.randrange(8, 40))).strip("-_") + "Q7"
    return "".join(drawn.choices(LETTERS + DIGITS + signs, k=drawn.randrange(7, 20))) + "w9"


def any_secret(seed):
    """Any secret, in any form, anywhere."""
    drawn = random.Random(seed)
    way = drawn.randrange(4)
    word = _word(drawn)
    if way == 0:
        it = " ".join(_word(drawn) for _number in range(drawn.randrange(1, 4)))
        text = drawn.choice((*WRITTEN, *QUOTED)).format(name=drawn.choice(NAMES), it=it)
    elif way == 1:
        it = _word(drawn, "!#$%^*~+._")
        text = drawn.choice((*WRITTEN, *QUOTED)).format(name=drawn.choice((*NAMES, *TOKENS)), it=it)
    elif way == 2:
        it = word
        text = drawn.choice(ELSEWHERE).format(it=it)
    else:
        it = word
        text = json.dumps(
            {"msg": drawn.choice((*WRITTEN, *QUOTED)).format(name=drawn.choice((*NAMES, *TOKENS)), it=it)}
        )
    around = drawn.choice(AROUND)
    prefix = TIME if "{time}" in around else ""
    inner = text.replace("\n", f"\n{prefix}")
    return Planted(around.format(it=inner, time=TIME), tuple(it.split(" ")))
