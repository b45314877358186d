# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The contract: its examples come through the door whole, and each field has its documentation."""

import json

import pytest
from ansible_collections.rosfleet.multimaster.plugins.module_utils._contract.answers import ANSWERS
from ansible_collections.rosfleet.multimaster.plugins.module_utils._contract.fields import find_struct
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._robot_io.answer import check_answer
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._robot_io.robot_action import answer_of


def list_structs(struct):
    """The class of a part of an answer, and those of the parts in it."""
    below = [found for entry in struct.FIELDS.values() if (found := find_struct(entry.kind))]
    return [struct, *(each for part in below for each in list_structs(part))]


@pytest.mark.parametrize("module", ANSWERS)
def test_an_example_comes_through_the_door_whole(module):
    said = {key: value for part in ANSWERS[module] for key, value in part.make_sample().items()}
    taken = check_answer(json.dumps(said), answer_of(module))
    assert (taken.result, taken.left_out) == (said, [])


@pytest.mark.parametrize("module", ANSWERS)
def test_a_key_is_in_one_part_of_an_answer(module):
    keys = [key for part in ANSWERS[module] for key in part.FIELDS]
    assert len(keys) == len(set(keys))


@pytest.mark.parametrize("module", ANSWERS)
def test_each_field_has_a_sentence_and_an_example(module):
    for part in ANSWERS[module]:
        for struct in list_structs(part):
            for name, entry in struct.FIELDS.items():
                assert entry.text.endswith("."), (struct, name)
                assert name in struct.make_sample()
