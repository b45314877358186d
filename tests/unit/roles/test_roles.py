# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""All roles are of one shape, and their specifications say what their defaults are."""

import pathlib
import re

import pytest
import yaml
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._plan import units

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
    tasks = {path.stem: path.read_text(encoding="utf-8") for path in (role / "tasks").glob("*.yml")}
    inner = set(re.findall(r"(?:include|import)_tasks: (\w+)\.yml", "".join(tasks.values())))
    assert set(specification) == set(tasks) - inner - {
        "options"
    }  # it has no task, and costs no process of the controller
    assert (role / "README.md").is_file()
    assert read(role / "meta/main.yml")["galaxy_info"]["license"] == "GPL-3.0-or-later"
    for entry in specification.values():
        assert entry["short_description"] and entry["description"]
        for name, option in entry["options"].items():
            assert name.startswith(role.name + "_")
            assert option["description"]


def test_the_role_services_takes_every_service_of_a_plan():
    options = read(next(role for role in ROLES if role.name == "services") / "meta/argument_specs.yml")
    choices = options["argument_specs"]["main"]["options"]["services_list"]["choices"]
    assert sorted(choices) == sorted((*units.OTHERS, *units.NODES))


# What a role takes of another one: as the default of an option, so it can be seen.
HANDED_ON = {"environment_digest", "nodes_sums", "tunnel_digest"}
TOGETHER = "computer"  # this role hands over what the others have


@pytest.mark.parametrize("role", [role for role in ROLES if role.name != TOGETHER], ids=lambda role: role.name)
def test_a_role_reads_no_variable_of_another_role(role):
    others = "|".join(other.name for other in ROLES if other != role)
    files = [path for folder in ("defaults", "vars", "tasks", "templates") for path in role.glob(f"{folder}/*")]
    for path in files:
        expressions = re.findall(r"\{\{.*?\}\}|\{%.*?%\}|when:.*|that:.*", path.read_text(encoding="utf-8"), re.DOTALL)
        words = {word for text in expressions for word in re.findall(r"(?<![\w.'])[a-z_]+(?!\w|:|=[^=])", text)}
        foreign = {word for word in words if re.match(rf"({others})_", word) and not word.startswith(f"{role.name}_")}
        assert foreign <= (HANDED_ON if path.parent.name == "defaults" else set()), path


@pytest.mark.parametrize("role", ROLES, ids=lambda role: role.name)
def test_no_result_of_a_task_hides_an_option(role):
    """A registered result and a fact outlive the role, and have precedence over the default of an option."""
    texts = [path.read_text(encoding="utf-8") for path in (role / "tasks").glob("*.yml")]
    registered = {name for text in texts for name in re.findall(r"register: (\w+)", text)}
    assert not registered & set(read(role / "defaults/main.yml"))


CONCERNS = ("environment", "firewall", "hosts", "multicast_routing", "nodes", "routes", "services", "sysctl")


@pytest.mark.parametrize("name", CONCERNS)
def test_a_concern_is_one_task_which_the_whole_computer_has_too(name):
    """The role of the whole computer hands over the same variables as each role."""
    tasks = [
        task for task in read(ROLES[0].parent / name / "tasks/main.yml") if "ansible.builtin.import_role" not in task
    ]
    (handed,) = [task["rosfleet.multimaster.multimaster_computer"] for task in tasks]
    variables = set(re.findall(rf"\b{name}_\w+", str(handed)))
    folder = ROLES[0].parent / TOGETHER
    together = "".join((folder / path).read_text(encoding="utf-8") for path in ("tasks/main.yml", "vars/main.yml"))
    assert variables and variables <= set(re.findall(r"\w+", together))


@pytest.mark.parametrize("playbook", ["site.yml", "teardown.yml"])
def test_no_expression_of_a_playbook_is_long(playbook):
    lines = (ROLES[0].parent.parent / "playbooks" / playbook).read_text(encoding="utf-8").splitlines()
    assert len(lines) <= 90 and max(map(len, lines)) <= 160


def test_the_folders_of_the_nodes_are_those_of_the_units():
    folders = read(ROLES[0].parent / "nodes/vars/main.yml")
    assert (folders["nodes_library"], folders["nodes_configuration"]) == (units.LIBRARY, units.CONFIGURATION)


# What runs on the controller alone. Of all else a robot answers, so it has to be an action of ours: the door for answers is there.
ON_THE_CONTROLLER = {
    *("assert", "debug", "set_fact", "meta"),
    *(f"{verb}_{what}" for verb in ("include", "import") for what in ("role", "tasks", "playbook")),
}
WORDS = set(
    """
    name when block rescue always register vars loop loop_control run_once ignore_errors ignore_unreachable become no_log check_mode
    diff changed_when failed_when any_errors_fatal throttle notify tags module_defaults until retries delay
    """.split()
)


def tasks_of(entries):
    """Each task of a file, also of blocks; a play is not one."""
    for entry in entries or ():
        for part in ("tasks", "pre_tasks", "post_tasks", "handlers", "block", "rescue", "always"):
            yield from tasks_of(entry.get(part))
        if "hosts" not in entry and not {"block"} & set(entry):
            yield entry


def plays():
    """The files with tasks, and whether these run on the controller."""
    root = ROLES[0].parent.parent
    yield from ((path, False) for role in ROLES for path in (role / "tasks").glob("*.yml"))
    for path in (root / "playbooks").rglob("*.yml"):
        yield path, all(entry.get("hosts", "localhost") == "localhost" for entry in read(path))


@pytest.mark.parametrize(("path", "local"), list(plays()), ids=lambda value: getattr(value, "stem", None))
def test_a_robots_program_answers_by_the_collections_door(path, local):
    actions = ROLES[0].parent.parent / "plugins" / "action"
    for task in tasks_of(read(path)):
        (module,) = [name for name in task if name not in WORDS]
        short = module.rpartition(".")[2]
        if module.startswith("ansible.builtin."):
            assert local or short in ON_THE_CONTROLLER, f"{path.name}: {module}"
        else:
            assert (actions / f"{short}.py").exists(), f"{path.name}: {module}"


def test_no_label_that_marks_packets_is_in_the_name_of_a_node():
    """A stranger reads the names of talkers at any roscore, and could forge what is followed."""
    folder = next(role for role in ROLES if role.name == "verify") / "tasks"
    agreed = [task for task in tasks_of(read(folder / "main.yml")) if task.get("no_log")]
    (secret,) = [name for task in agreed for name in task["ansible.builtin.set_fact"]]
    (trace,) = read(folder / "packet_trace.yml")
    assert trace["module_defaults"]["rosfleet.multimaster.multimaster_packet_trace"]["run"] == f"{{{{ {secret} }}}}"
