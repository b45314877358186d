# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_bundle: what a run has registered in, a file for those who are asked for help out."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import yaml
from ansible.errors import AnsibleError
from ansible.module_utils.parsing.convert_bool import boolean
from ansible.plugins.action import ActionBase
from ansible.utils.display import Display
from ansible_collections.rosfleet.multimaster.plugins.action import fleet_report
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._bundle import bundle as bundles
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._bundle import secrets
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._bundle.archive import packed
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._data.plain import Mismatch, to_plain
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet.plain_text import plain_data, plain_lines
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._fleet.variables import BY_NAME, RESERVED
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._judgement import judged as judgement
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._judgement.run import OPTIONS, Run
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._observed.task_results import find_result
from ansible_collections.rosfleet.multimaster.plugins.plugin_utils._report.page import TEMPLATE, page

ROLES = Path(__file__).parents[2] / "roles"
WORD = re.compile(r"[\w.-]+")
NAME = "rosfleet-bundle-%Y-%m-%dT%H%M%S.zip"
ENCRYPTED = ("EncryptedString", "AnsibleVaultEncryptedUnicode")  # of ansible-core 2.19, and before
SHIFTED = (
    "The findings in the bundle are not all those of the fleet, since a name or a secret is a word that the verification uses; "
    "what verify prints is right."
)


class ActionModule(ActionBase):
    """Writes a bundle."""

    _VALID_ARGS = frozenset((*OPTIONS, "logs", "path", "anonymous"))
    _requires_connection = False

    def run(self, tmp: str | None = None, task_vars: dict[str, Any] | None = None) -> dict[str, Any]:
        """Return the path of the bundle; see ActionBase."""
        result: dict[str, Any] = super().run(tmp, task_vars)
        task_vars = task_vars or {}
        given = str(self._task.args.get("path") or "")
        if not given:
            result.update(
                failed=True,
                msg="The option path is empty; expected a file for the bundle, such as bundle.zip: set verify_bundle.",
            )
            return result
        path = place(given)
        try:
            bundle = fleet_report.run_of(self._task.args, task_vars)
            cleaned = self._cleaned(bundle, task_vars["hostvars"])
            if boolean(self._task.args.get("anonymous") or False):
                cleaned = bundles.renamed(
                    cleaned, *people(bundle, task_vars["hostvars"], self._task.args.get("machine"))
                )
            judged = judgement.verdict(cleaned, pages=True, everything=False)
            data = made(cleaned, judged)
            fleet_report.write(path, data, fleet_report.OWN_MODE)
        except Mismatch as problem:
            result.update(failed=True, msg=str(problem))
            return result
        except OSError as problem:
            said = f"The bundle cannot be written to {path}: {problem.strerror}; expected a file in a folder of yours: name another one."
            result.update(failed=True, msg=said)
            return result
        same = kinds(judged) == kinds(judgement.verdict(bundle, pages=False, everything=False))
        result.update(changed=True, path=path, bytes=len(data), msg=f"Wrote {path} for those who help. {READ_IT}")
        Display().display(plain_lines(f"Bundle: {path}"))
        if not same:
            result["warnings"] = [SHIFTED]
        return result

    def _cleaned(self, bundle: Run, hostvars: Any) -> Run:
        """Take out what is known to be secret, or looks so."""
        context = self._play_context
        known = {str(getattr(context, name, "") or "") for name in ("password", "become_pass")}
        known |= secrets.values(dict(os.environ))
        foreign: set[str] = set()
        registered_as = {text.partition(".")[0] for text in self._task.args.values() if isinstance(text, str)}
        listed = {*BY_NAME, *RESERVED, *role_options(), *registered_as}
        for host in [*hostvars]:
            variables = raw(hostvars, host)
            known |= secrets.values(variables) | set(encrypted(variables)) | set(rendered(hostvars, host, variables))
            foreign |= secrets.foreign(variables, listed)
        return bundles.without(bundle, secrets.Secrets(known, names(bundle), foreign - words(bundle)))


def role_options() -> set[str]:
    """Return the names of the options that the collection's roles have: with those of the fleet, all that is the collection's."""
    specs = [yaml.safe_load(path.read_text()) for path in ROLES.glob("*/meta/argument_specs.yml")]
    return {name for spec in specs for entry in spec["argument_specs"].values() for name in entry.get("options") or {}}


def words(bundle: Run) -> set[str]:
    """Return the words that a bundle has anyway: those of the plan and of versions, and the names of interfaces."""
    plan = {text for text in secrets.texts(to_plain(bundle.fleet)) if " " not in text}
    seen = [entry.probe.forwarding.interfaces for entry in bundle.observations.values() if entry.probe]
    versions = {
        word for machine in bundle.machines.values() for text in machine.values() for word in WORD.findall(text)
    }
    return plan | versions | {interface.interface for entry in seen for interface in entry}


READ_IT = "Passwords and keys were taken out where they could be recognised; read it before you give it away."


def place(given: str) -> str:
    """Return the file that an option names: itself, or a new one in a folder."""
    path = os.path.abspath(os.path.expanduser(given))
    if given.endswith("/") or os.path.isdir(path):
        return os.path.join(path, time.strftime(NAME))
    return path


def made(bundle: Run, judged: Any) -> bytes:
    """Return the bytes of the bundle, with its report."""
    document = plain_data({**judgement.document(bundle, judged), "file": "report.json", "since": "", "differences": []})
    template = TEMPLATE.read_text(encoding="utf-8")
    html = page(template, bundle.fleet, document, judged.matrices, {"time": "", "differences": []})
    return packed(bundles.texts(bundle, html, document), time.localtime()[:6])


def kinds(judged: Any) -> list[tuple[str, str, str]]:
    """Return what the findings are, whatever the names."""
    return sorted((entry.part.kind, entry.part.mode, entry.verdict) for entry in judged.diagnosis.findings)


def names(bundle: Run) -> set[str]:
    """Return what is no secret, since the plan has it: names and addresses."""
    fleet = bundle.fleet
    hosts = {name for entry in fleet.hosts_entries for name in (*entry.names, str(entry.address))}
    return {*fleet.master_of, *fleet.computers, *hosts}


def people(bundle: Run, hostvars: Any, machine: Any) -> tuple[dict[str, list[str]], set[str]]:
    """Return other names of the computers, and the names of the persons who log in."""
    aliases, users = {}, set()
    for host in bundle.fleet.computers:
        variables = raw(hostvars, host)
        others = [variables.get("ansible_host"), variables.get("ansible_ssh_host")]
        if host in bundle.observations:
            others.append(find_result(hostvars[host], str(machine or "")).get("hostname"))
        aliases[host] = [name for name in others if isinstance(name, str) and name and "{" not in name]
        users |= {
            user
            for user in (variables.get("ansible_user"), variables.get("ansible_ssh_user"))
            if isinstance(user, str) and "{" not in user
        }
    return aliases, users


def raw(hostvars: Any, host: str) -> Mapping[str, Any]:
    """Return the variables of a host as they are written."""
    return hostvars.raw_get(host) if hasattr(hostvars, "raw_get") else hostvars[host]


def encrypted(value: Any) -> Iterator[str]:
    """Yield the values that the inventory has encrypted, as they are in clear."""
    if type(value).__name__ in ENCRYPTED:
        try:
            yield str(value)
        except AnsibleError:  # nobody gave the password, so nobody knows it here
            return
    elif isinstance(value, Mapping):
        for part in value.values():
            yield from encrypted(part)
    elif isinstance(value, (list, tuple)):
        for part in value:
            yield from encrypted(part)


def rendered(hostvars: Any, host: str, variables: Mapping[str, Any]) -> Iterator[str]:
    """Yield the secrets of a host that a template makes, such as a look-up in a keyring."""
    for name, value in variables.items():
        if any("{" in text for text in secrets.values({name: value})):
            try:
                yield from secrets.values({name: hostvars[host][name]})
            except (AnsibleError, KeyError):
                continue
