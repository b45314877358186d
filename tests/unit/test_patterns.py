# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Each regular expression of the product takes linear time, since what it reads may be of others.

A hostile text is made of the expression itself: something that begins as it does, and then one of its repeated parts, again and
again, up to something that it does not end with. Twice the text is to cost twice the time, not four times.
"""

import ast
import importlib
import itertools
import pathlib
import re
import time

import pytest

try:
    from re import _parser
except ImportError:  # Python 3.10
    import sre_parse as _parser

ROOT = pathlib.Path(__file__).parents[2]
NODES = ROOT / "roles/nodes/files/python"
METHODS = ("match", "fullmatch", "search", "sub", "subn", "findall", "finditer", "split")
#: whose are not tried here, since they have hundreds of parts: what tries them
ELSEWHERE = {
    "_bundle/secrets.py": "tests/unit/plugins/plugin_utils/_bundle/test_secrets.py, with the longest text that is read"
}
LENGTHS = (26, 4000)  # the first one for what doubles with each character
LIMIT = 0.02  # seconds for so many characters: a linear one takes some tens of microseconds
ENDS = ("\0", "", "\n", "x")


def sample(tokens):
    """Return a text that these tokens of a parsed expression match."""
    return "".join(map(_sample, tokens))


def _sample(token):
    kind, value = token
    name = str(kind)
    if name in ("LITERAL",):
        return chr(value)
    if name == "NOT_LITERAL":
        return "b" if value == ord("a") else "a"
    if name == "ANY":
        return "a"
    if name == "IN":
        return _one_of(value)
    if name in ("MAX_REPEAT", "MIN_REPEAT", "POSSESSIVE_REPEAT"):
        return sample(value[2]) * max(value[0], 0)
    if name == "SUBPATTERN":
        return sample(value[-1])
    if name == "ATOMIC_GROUP":
        return sample(value)
    if name == "BRANCH":
        return sample(value[1][0])
    return ""


def _one_of(choices):
    negative = choices and str(choices[0][0]) == "NEGATE"
    pattern = re.compile("[" + "".join(map(_choice, choices)) + "]")
    letters = itertools.chain(" =,;:a0_-/.\t\n", map(chr, range(33, 127)), map(chr, range(128, 400)))
    if not negative:
        letters = itertools.chain("a0 ", letters, (chr(value) for kind, value in choices if str(kind) == "LITERAL"))
    return next((letter for letter in letters if pattern.match(letter)), "")


def _choice(token):
    kind, value = str(token[0]), token[1]
    if kind == "NEGATE":
        return "^"
    if kind == "LITERAL":
        return re.escape(chr(value))
    if kind == "RANGE":
        return f"{re.escape(chr(value[0]))}-{re.escape(chr(value[1]))}"
    return {"DIGIT": r"\d", "NOT_DIGIT": r"\D", "SPACE": r"\s", "NOT_SPACE": r"\S", "WORD": r"\w", "NOT_WORD": r"\W"}[
        str(value).replace("CATEGORY_", "")
    ]


def list_hostile(pattern):
    """List what an expression may read for long: what comes first, what is repeated, and what comes at the end."""
    for before, body, after in _list_repeats(_parser.parse(pattern), "", ""):
        again = before[-1:] + body[:1]  # where a search may begin once more
        bodies = {body, body[:1], again, " ", "a", after[:1]} - {""}
        for one in bodies:
            for end in dict.fromkeys((*ENDS, after[:1])):
                yield before, one, end


def _list_repeats(tokens, before, after):
    tokens = list(tokens)
    for at, (kind, value) in enumerate(tokens):
        first, last = before + sample(tokens[:at]), sample(tokens[at + 1 :]) + after
        name = str(kind)
        if name in ("MAX_REPEAT", "MIN_REPEAT"):
            if value[1] > 100:
                yield first, sample(value[2]), last
            yield from _list_repeats(value[2], first, last)
        elif name == "SUBPATTERN":
            yield from _list_repeats(value[-1], first, last)
        elif name in ("ASSERT", "ASSERT_NOT"):
            yield from _list_repeats(value[1], first, last)
        elif name == "BRANCH":
            for branch in value[1]:
                yield from _list_repeats(branch, first, last)


def list_files():
    """List all files that run on controllers and robots, with the name of each as a module."""
    for path in sorted((ROOT / "plugins").rglob("*.py")):
        if "doc_fragments" not in path.parts:
            yield (
                path,
                "ansible_collections.rosfleet.multimaster." + ".".join(path.relative_to(ROOT).with_suffix("").parts),
            )
    for path in sorted((NODES / "rosfleet_multimaster").rglob("*.py")):
        yield path, ".".join(path.relative_to(NODES).with_suffix("").parts)


def list_patterns():
    """List (file, expression, flags, methods) of all that are written or made at the start."""
    found = {}
    for path, module in list_files():
        text = path.read_text(encoding="utf-8")
        if "re." not in text or str(path).endswith(tuple(ELSEWHERE)):
            continue
        for pattern, flags, methods in _list_written(text):
            found.setdefault((pattern, flags), (path, set()))[1].update(methods)
        if re.search(r"^\w*.*re\.compile\(", text, re.MULTILINE):
            for name, compiled in _list_compiled(module):
                used = {method for method in METHODS if re.search(rf"\b{name}\.{method}\b", text)}
                found.setdefault((compiled.pattern, compiled.flags), (path, set()))[1].update(
                    used or {"fullmatch", "match"}
                )
    return [(path, *key, sorted(methods)) for key, (path, methods) in found.items()]


def _list_written(text):
    """The expressions that are constants in a call of re."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Call) and ast.unparse(node.func).startswith("re.") and node.args:
            method = node.func.attr
            if method in METHODS and isinstance(node.args[0], ast.Constant) and isinstance(node.args[0].value, str):
                words = ast.unparse(node)
                flags = sum(
                    getattr(re, name) for name in set(re.findall(r"re\.(MULTILINE|DOTALL|IGNORECASE|ASCII)", words))
                )
                yield node.args[0].value, int(flags), {method}


def _list_compiled(module):
    """The compiled expressions of a module, also in its tables."""
    try:
        values = vars(importlib.import_module(module))
    except (ImportError, OSError):  # of ROS
        return
    for name, value in list(values.items()):
        waiting, seen = [value], 0
        while waiting and seen < 2000:
            one, seen = waiting.pop(), seen + 1
            if isinstance(one, re.Pattern):
                if isinstance(one.pattern, str):
                    yield name, one
            elif isinstance(one, dict):
                waiting += one.values()
            elif isinstance(one, (list, tuple, set)):
                waiting += one


def measure(pattern, flags, method, text):
    compiled = re.compile(pattern, flags)
    run = getattr(compiled, {"subn": "sub"}.get(method, method))
    began = time.thread_time()
    found = run("", text) if method in ("sub", "subn") else run(text)
    if method == "finditer":
        list(found)
    return time.thread_time() - began


def find_length(pattern, flags, method, before, body, end):
    """Return the length of the text for which an expression takes too long; 0 if it takes long for none."""
    for length in LENGTHS:
        text = before + body * (length // len(body)) + end
        if all(measure(pattern, flags, method, text) > LIMIT for _time in range(2)):
            return length
    return 0


@pytest.mark.slow
def test_each_expression_takes_linear_time():
    slow, rows = [], list_patterns()
    assert len(rows) > 200
    for path, pattern, flags, methods in rows:
        texts = dict.fromkeys(list_hostile(pattern))
        found = [(method, text) for text in texts for method in methods if find_length(pattern, flags, method, *text)]
        slow += [(str(path.relative_to(ROOT)), pattern, *one) for one in found[:1]]
    assert not slow
