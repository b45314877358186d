# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""All roles are of one shape, and their specifications say what their defaults are."""

import pathlib

import pytest
import yaml

ROLES = sorted((pathlib.Path(__file__).resolve().parents[3] / "roles").iterdir())


def read(path):
    return yaml.safe_load(path.read_text(encoding="utf-8"))


@pytest.mark.parametrize("role", ROLES, ids=lambda role: role.name)
def test_the_specification_equals_the_defaults(role):
    """A default that is computed from the plan stands in the defaults alone: documentation takes no templates."""
    defaults = read(role / "defaults/main.yml")
    options = read(role / "meta/argument_specs.yml")["argument_specs"]["main"]["options"]
    assert set(options) == set(defaults)
    for name, value in defaults.items():
        computed = isinstance(value, str) and "{{" in value
        assert ("default" in options[name]) is not computed, name
        assert options[name].get("default", value) == value, name


@pytest.mark.parametrize("role", ROLES, ids=lambda role: role.name)
def test_every_role_has_the_same_parts(role):
    specification = read(role / "meta/argument_specs.yml")["argument_specs"]
    assert set(specification) == {path.stem for path in (role / "tasks").glob("*.yml")} - {"sshd"}
    assert (role / "README.md").is_file()
    assert read(role / "meta/main.yml")["galaxy_info"]["license"] == "GPL-3.0-or-later"
    for entry in specification.values():
        assert entry["short_description"] and entry["description"]
        for name, option in entry["options"].items():
            assert name.startswith(role.name + "_")
            assert option["description"]
