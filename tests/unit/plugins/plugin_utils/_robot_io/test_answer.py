# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""Whatever a robot answers, what is taken of it is plain data of the documented shape; a true answer is taken whole."""

import json
import math
import random
from pathlib import Path

import hostile_answers
import pytest
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._base.plain_text import is_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._robot_io import answer
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._robot_io.documentation import read_documentation

ROOT = Path(__file__).parents[5]

MODULES = ROOT / "plugins" / "modules"
ON_ROBOTS = sorted(
    path.stem
    for path in MODULES.glob("*.py")
    if not path.stem.startswith("fleet_") and (ROOT / "plugins" / "action" / path.name).exists()
)
CASES = 30  # for each module


def text_of(module):
    return (MODULES / f"{module}.py").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def kinds():
    return {module: read_documentation(module, text_of) for module in ON_ROBOTS}


def drawn_value(drawn, kind):
    """A value as it is documented, of texts as a hostile robot would choose them."""
    if kind.type in ("bool", "int", "float"):
        return {"bool": True, "int": drawn.randrange(70000), "float": drawn.random()}[kind.type]
    if kind.type == "list":
        return [drawn_value(drawn, kind.each) for _number in range(drawn.randrange(3))]
    if kind.type == "dict" and kind.parts is not None:
        return {name: drawn_value(drawn, part) for name, part in kind.parts.items()}
    if kind.type == "dict":
        return {"a name": "a text", "another": "text"}
    return drawn.choice(["a text", "192.168.1.229", "eth0"])


def checked(value, lines=False):
    """Assert that a value is plain data."""
    if isinstance(value, dict):
        for name, part in value.items():
            assert is_plain(name)
            checked(part, lines or name == "diff")
    elif isinstance(value, list):
        for part in value:
            checked(part, lines)
    elif isinstance(value, str):
        assert all(is_plain(line.replace("\t", "")) for line in (value.split("\n") if lines else [value]))
    else:
        assert value is None or type(value) in (bool, int, float)
        assert value is None or math.isfinite(value)


@pytest.mark.parametrize("module", ON_ROBOTS)
def test_a_documented_answer_is_taken_whole(kinds, module):
    said = {name: drawn_value(random.Random(1), kind) for name, kind in kinds[module].items()}
    said["failed"] = False
    taken = answer.check_answer(json.dumps(said), kinds[module])
    assert (taken.result, taken.left_out, taken.trace) == (said, [], "")


@pytest.mark.slow
@pytest.mark.parametrize("module", ON_ROBOTS)
def test_a_drawn_answer_is_documented_plain_data_or_refused(kinds, module):
    drawn = random.Random(module)
    true = {name: drawn_value(drawn, kind) for name, kind in kinds[module].items()}
    refused = 0
    for _case in range(CASES):
        said = hostile_answers.answer(drawn, {**true, "failed": drawn.random() < 0.2}, "/mark", "kobuki2computer")
        text = answer.find_answer(said.decode("utf-8", "replace"))
        try:
            taken = answer.check_answer(text, kinds[module])
        except answer.StrangeAnswer as strange:
            assert 0 < len(str(strange)) < 400
            assert is_plain(str(strange))
            refused += 1
            continue
        assert set(taken.result) <= {*kinds[module], "diff", "warnings"}
        checked(taken.result)
    assert 0 < refused < CASES


@pytest.mark.parametrize("order", hostile_answers.ORDERS, ids="+".join)
def test_an_order_to_ansible_is_refused_or_left_out(kinds, order):
    said = {"changed": False, "installed": [], "removed": [], "msg": "The packages were right.", **order}
    try:
        taken = answer.check_answer(json.dumps(said), kinds["multimaster_packages"])
    except answer.StrangeAnswer:
        return
    assert set(taken.result) <= {*kinds["multimaster_packages"], "diff", "warnings"}
    checked(taken.result)


@pytest.mark.parametrize(
    ("said", "found"),
    [
        ('{"add_host": {}}', "the key add_host, which no module of the collection answers"),
        ('{"changed": "yes"}', "a text at changed; the module answers true or false"),
        ('{"installed": {}}', "a mapping at installed; the module answers a list"),
        ('{"installed": [3]}', "a number at installed[0]; the module answers a text"),
        ('{"msg": {"__ansible_type": "x"}}', "a mapping at msg; the module answers a text"),
        ("{}", "no installed"),
        ('{"installed": []', "no JSON"),
        ("[" * 200_000, "values too deep in each other"),
        ("{" + '"a":1,' * 1_100_000 + "}", "1100001 values"),
        ('{"installed": [], "removed": [], "x": 1e999}', "1e999, which is no finite number"),
        ('{"installed": [], "removed": [], "x": NaN}', '"NaN", which is no finite number'),
        ('{"installed": [], "removed": [], "x": 123456789012345678901}', "a number of 21 digits"),
        ('{"installed": [], "removed": [], "x": -1e20}', "a number of more than 20 digits"),
    ],
)
def test_what_is_found_is_said(kinds, said, found):
    with pytest.raises(answer.StrangeAnswer) as strange:
        answer.check_answer(said, kinds["multimaster_packages"])
    assert str(strange.value) == found


def test_undocumented_keys_are_left_out_and_told(kinds):
    taken = answer.check_answer('{"installed": [], "removed": [], "hidden": 1}', kinds["multimaster_packages"])
    assert (taken.result, taken.left_out) == ({"installed": [], "removed": []}, ['"hidden"'])


@pytest.mark.parametrize(
    "messages",
    [
        ["one", "two"],
        [{"event": {"msg": "one", "__ansible_type": "Event"}, "__ansible_type": "WarningSummary"}, {"msg": "two"}],
    ],
)
def test_warnings_are_texts_in_each_ansible_core(kinds, messages):
    taken = answer.check_answer(
        json.dumps({"installed": [], "removed": [], "warnings": messages}), kinds["multimaster_packages"]
    )
    assert taken.result["warnings"] == ["one", "two"]


def test_a_crash_says_its_last_line(kinds):
    crash = {"failed": True, "exception": "Traceback (most recent call last):\nValueError: no such thing\n"}
    taken = answer.check_answer(json.dumps(crash), kinds["multimaster_packages"])
    assert taken.result == {"failed": True, "msg": "ValueError: no such thing"}
    assert taken.trace.startswith("Traceback")


def test_what_shells_write_around_an_answer_does_not_matter():
    assert answer.find_answer('motd\n{"a": 1}\n \nbye') == '{"a": 1}'
    assert answer.find_answer("nothing") == ""
