# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later

"""The action fleet_bundle: the registered results of a run in, a file for helpers out."""

from __future__ import annotations

import os
import re
import time
from collections.abc import Iterator, Mapping
from typing import Any

from ansible.errors import AnsibleError
from ansible.module_utils.parsing.convert_bool import boolean
from ansible.utils.display import Display

from ..plugin_utils._base.plain import Mismatch, to_plain
from ..plugin_utils._base.plain_text import plain_data, plain_lines
from ..plugin_utils._bundle import bundle as bundles
from ..plugin_utils._bundle import secrets
from ..plugin_utils._bundle.archive import pack
from ..plugin_utils._inventory.roles import read_options
from ..plugin_utils._inventory.variables import BY_NAME, RESERVED
from ..plugin_utils._robot_io.refusal import FleetAction, Refusal
from ..plugin_utils._verify.observe.task_results import find_result
from ..plugin_utils._verify.report.judgement import judge_run, make_document
from ..plugin_utils._verify.report.page import TEMPLATE, make_page
from ..plugin_utils._verify.report.run import OPTIONS, Run
from . import fleet_report

WORD = re.compile(r"[\w.-]+")
NAME = "rosfleet-bundle-%Y-%m-%dT%H%M%S.zip"
ENCRYPTED = ("EncryptedString", "AnsibleVaultEncryptedUnicode")  # of ansible-core 2.19, and before
DIFFERENT_FINDINGS = (
    "The findings in the bundle are not all those of the fleet, since a name or a secret is a word that the verification uses; "
    "the output of verify is right."
)


class ActionModule(FleetAction):
    """Writes a bundle."""

    _VALID_ARGS = frozenset((*OPTIONS, "logs", "path", "anonymous"))

    def answer(self, args: Any, task_vars: dict[str, Any]) -> dict[str, Any]:
        """Return the path of the bundle."""
        option = str(args.get("path") or "")
        if not option:
            raise Refusal(
                "The option path is empty; expected a file for the bundle, such as bundle.zip: set verify_bundle."
            )
        path = fleet_report.name_file(option, time.strftime(NAME))
        try:
            bundle = fleet_report.read_run(args, task_vars)
            clean_run = self._remove_secrets(bundle, task_vars["hostvars"])
            if boolean(args.get("anonymous") or False):
                clean_run = bundles.rename(clean_run, *people(bundle, task_vars["hostvars"], args.get("machine")))
            judgement = judge_run(clean_run, pages=True, everything=False)
            data = make_bundle(clean_run, judgement)
            fleet_report.write(path, data, fleet_report.OWN_MODE)
        except Mismatch as problem:
            raise Refusal(str(problem)) from None
        except OSError as problem:
            message = f"The bundle cannot be written to {path}: {problem.strerror}; expected a file in a folder of yours: name another one."
            raise Refusal(message) from None
        same = kinds(judgement) == kinds(judge_run(bundle, pages=False, everything=False))
        Display().display(plain_lines(f"Bundle: {path}"))
        return {
            "changed": True,
            "path": path,
            "bytes": len(data),
            "msg": f"Wrote {path} for a maintainer. {READ_IT}",
            **({} if same else {"warnings": [DIFFERENT_FINDINGS]}),
        }

    def _remove_secrets(self, bundle: Run, hostvars: Any) -> Run:
        """Take out the values that are secrets or look like secrets."""
        context = self._play_context
        known = {str(getattr(context, name, "") or "") for name in ("password", "become_pass")}
        known |= secrets.collect_values(dict(os.environ))
        foreign: set[str] = set()
        registered_as = {text.partition(".")[0] for text in self._task.args.values() if isinstance(text, str)}
        own = {*BY_NAME, *RESERVED, *read_options(), *registered_as}
        for host in [*hostvars]:
            variables = read_raw(hostvars, host)
            known |= (
                secrets.collect_values(variables)
                | set(find_vault_values(variables))
                | set(find_template_secrets(hostvars, host, variables))
            )
            foreign |= secrets.collect_foreign(variables, own)
        return bundles.remove_secrets(bundle, secrets.Secrets(known, names(bundle), foreign - words(bundle)))


def words(bundle: Run) -> set[str]:
    """Return the words that each bundle contains: those of the plan and of versions, and the names of interfaces."""
    plan = {text for text in secrets.list_texts(to_plain(bundle.fleet)) if " " not in text}
    seen = [entry.probe.forwarding.interfaces for entry in bundle.observations.values() if entry.probe]
    versions = {
        word for machine in bundle.machines.values() for text in machine.values() for word in WORD.findall(text)
    }
    return plan | versions | {interface.interface for entry in seen for interface in entry}


READ_IT = "Passwords and keys were taken out if they could be recognised; read it before you give it away."


def make_bundle(bundle: Run, judgement: Any) -> bytes:
    """Return the bytes of the bundle, with its report."""
    document = plain_data({**make_document(bundle, judgement), "file": "report.json", "since": "", "differences": []})
    template = TEMPLATE.read_text(encoding="utf-8")
    html = make_page(template, bundle.fleet, document, judgement.matrices)
    return pack(bundles.write_files(bundle, html, document), time.localtime()[:6])


def kinds(judgement: Any) -> list[tuple[str, str, str]]:
    """Return kind, mode and verdict of each finding, without its names."""
    return sorted((entry.component.kind, entry.component.mode, entry.verdict) for entry in judgement.diagnosis.findings)


def names(bundle: Run) -> set[str]:
    """Return the names and addresses of the plan, which are no secrets."""
    fleet = bundle.fleet
    hosts = {name for entry in fleet.hosts_entries for name in (*entry.names, str(entry.address))}
    return {*fleet.master_of, *fleet.computers, *hosts}


def people(bundle: Run, hostvars: Any, machine: Any) -> tuple[dict[str, list[str]], set[str]]:
    """Return other names of the computers, and the names of the persons who log in."""
    aliases, users = {}, set()
    for host in bundle.fleet.computers:
        variables = read_raw(hostvars, host)
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


def read_raw(hostvars: Any, host: str) -> Mapping[str, Any]:
    """Return the variables of a host as they are written."""
    return hostvars.raw_get(host) if hasattr(hostvars, "raw_get") else hostvars[host]


def find_vault_values(value: Any) -> Iterator[str]:
    """Yield the values that the inventory has encrypted, in clear text."""
    if type(value).__name__ in ENCRYPTED:
        try:
            yield str(value)
        except AnsibleError:  # this run has no password for it, so its values have no clear text here
            return
    elif isinstance(value, (Mapping, list, tuple)):
        for part in value.values() if isinstance(value, Mapping) else value:
            yield from find_vault_values(part)


def find_template_secrets(hostvars: Any, host: str, variables: Mapping[str, Any]) -> Iterator[str]:
    """Yield the secrets of a host that a template makes, such as a look-up in a keyring."""
    for name, value in variables.items():
        if any("{" in text for text in secrets.collect_values({name: value})):
            try:
                yield from secrets.collect_values({name: hostvars[host][name]})
            except (AnsibleError, KeyError):
                continue
