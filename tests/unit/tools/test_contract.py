# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""RETURN of the modules that measure is made of the contract: short, and as the file has it."""

import pytest
import yaml
from ansible_collections.rosfleet.multimaster.plugins.module_utils._contract.answers import ANSWERS
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._robot_io.documentation import SECTION

from tools import contract

MODULES = contract.MODULES


@pytest.mark.parametrize("module", ANSWERS)
def test_the_documentation_is_made_of_the_contract(module):
    text = (MODULES / f"{module}.py").read_text(encoding="utf-8")
    assert contract.fill(module, text) == text, "run `make copies`"


@pytest.mark.slow
@pytest.mark.parametrize("module", ANSWERS)
def test_the_documentation_has_one_level_of_fields(module):
    section = yaml.safe_load(SECTION.search((MODULES / f"{module}.py").read_text(encoding="utf-8"))[1])
    assert list(section) == [key for part in ANSWERS[module] for key in part.FIELDS]
    for entry in section.values():
        assert entry["description"] and all("contains" not in below for below in entry.get("contains", {}).values())
