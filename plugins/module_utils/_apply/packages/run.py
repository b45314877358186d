# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""One run of the module multimaster_packages: Debian packages, of which the collection removes only its own ones.

The record is written before the first package: so packages of an interrupted run are taken back, too. A package that
another one replaces (chrony replaces systemd-timesyncd) is in the record as well, and comes back with the removal.
"""

import re
import typing

from ..._base import commands
from ..._base.plain_text import LINE, plain, quote
from ..._base.problem import Problem, sentence
from ..._machine import fkie
from ..transaction.file_bundle import OPTIONS as FILES
from ..transaction.file_bundle import ManagedFiles
from ..transaction.module import Concern, Fields, ModuleRun
from ..transaction.transaction import StepFailure

OPTIONS = {
    "names": {"type": "list", "elements": "str", "required": True},
    "keep": {"type": "bool", "default": False},
    "records": FILES["records"],
}
BUNDLE = "packages"
_HEAD = "# The Debian packages that the collection rosfleet.multimaster installed."
_APT = ["apt-get", "--quiet", "--yes", "--option=DPkg::Lock::Timeout=60", "--option=Dpkg::Options::=--force-confold"]
_LIMIT = 1200.0  # seconds; a robot may be far from its package sources
_LIMIT_SIMULATION = 60.0  # seconds
_ENVIRONMENT = dict(commands.CLEAN, DEBIAN_FRONTEND="noninteractive")
_LONGEST = 400  # characters of the output of apt
_REPLACED = re.compile(r"# ([a-z0-9][a-z0-9+.-]+) replaced ([a-z0-9 +.-]+)")
_REMOVAL = re.compile(r"^Remv ([a-z0-9][a-z0-9+.-]+)", re.MULTILINE)


class PackageChanges(typing.NamedTuple):
    """The names of packages."""

    new: typing.List[str]  # wanted and not installed
    leftover: typing.List[str]  # installed by the collection, and wanted no more
    intent: typing.List[str]  # packages that the collection has installed, or is about to install
    after: typing.List[str]  # packages that it has installed at the end


def changes(
    wanted: typing.Sequence[str], installed: typing.Collection[str], ours: typing.Sequence[str], keep: bool
) -> PackageChanges:
    """Compare the wanted packages with the installed ones, and with those that the collection has installed (`ours`).

    With `keep`, packages that are no longer wanted stay.
    """
    new = [name for name in wanted if name not in installed]
    leftover = [] if keep else [name for name in ours if name not in wanted]
    intent = sorted({*ours, *new})
    return PackageChanges(new, leftover, intent, [name for name in intent if name not in leftover])


def read_replaced(record: str) -> typing.Dict[str, typing.List[str]]:
    """Read the record: the packages that each of ours has replaced."""
    lines = [_REPLACED.fullmatch(line) for line in record.splitlines()]
    return {line.group(1): line.group(2).split() for line in lines if line}


def find_removals(simulation: str) -> typing.List[str]:
    """List the packages that apt-get would remove, in the output of its simulation."""
    return sorted(set(_REMOVAL.findall(simulation)))


class Packages(ModuleRun):
    """The run, planned from the options of the module."""

    def __init__(self, options: typing.Mapping[str, typing.Any]) -> None:
        strange = [name for name in options["names"] if not fkie.PACKAGE.fullmatch(name)]
        if strange:
            raise Problem(
                f"The option names has {quote(strange[0])}; expected the name of a Debian package, for example "
                "ros-noetic-fkie-master-sync."
            )
        packages = fkie.packages(options["names"], fkie.INSTALLED)
        installed = [entry["name"] for entry in packages if entry["installed"]]
        ours = [entry["name"] for entry in packages if entry["ours"]]
        self.changes = changes(options["names"], installed, ours, options["keep"])
        self.removed = [name for name in self.changes.leftover if name in installed]
        self.records = options["records"]
        self.replaced = read_replaced(fkie.read_record(fkie.INSTALLED))
        self.replaced.update(_find_replaced(self.changes.new))
        self.record = self._record_of(self.changes.after)
        self.changed = bool(self.changes.new or self.removed or self.record.changed)

    def _record_of(self, names: typing.Sequence[str]) -> ManagedFiles:
        replaced = [f"# {name} replaced {' '.join(self.replaced[name])}" for name in names if name in self.replaced]
        content = "".join(f"{line}\n" for line in (_HEAD, *replaced, *names))
        file = {"path": fkie.INSTALLED, "content": content, "mode": "0644", "validate": []}
        files = [file] if names else []
        return ManagedFiles({"bundle": BUNDLE, "files": files, "brief": [], "records": self.records})

    @property
    def packages_back(self) -> typing.List[str]:
        """The packages that come back, since those that had replaced them are removed."""
        return [entry for name in self.removed for entry in self.replaced.get(name, ())]

    @property
    def refusals(self) -> typing.List[str]:
        """The sentences on a record that cannot be written."""
        return self.record.refusals

    @property
    def difference(self) -> typing.List[typing.Dict[str, str]]:
        """The difference of the record."""
        return self.record.difference

    def apply(self) -> None:
        """Record and install, or remove and forget. Raises Problem; packages that were installed before it stay in the record."""
        last: typing.Optional[ManagedFiles] = self.record
        if self.changes.new:
            # A package to remove is in the record with those to install, until it is gone.
            (self._record_of(self.changes.intent) if self.changes.leftover else self.record).apply()
            last = self._record_of(self.changes.after) if self.changes.leftover else None
            _apt("install", "--no-install-recommends", *self.changes.new)
        if self.packages_back:  # in one transaction: Debian wants one of the two
            _apt("install", "--no-install-recommends", *self.packages_back, *(f"{name}-" for name in self.removed))
        elif self.removed:
            _apt("remove", *self.removed)
        try:
            if last:
                last.apply()
        except StepFailure as problem:
            raise Problem(
                f"{sentence(problem.cause)} The packages are as planned: run the play again."
            ) from problem.cause

    def failure(self, problem: Problem) -> Fields:
        """Return the return values besides the sentence: apt may have installed a part."""
        return dict(self.result(), changed=self.changed)

    def result(self) -> Fields:
        """Return the values besides `changed`, `msg` and `diff`."""
        return {"installed": self.changes.new, "removed": self.removed}

    def summary(self, check_mode: bool) -> str:
        """Return one sentence on all that was done."""
        be = "would be" if check_mode else "were"
        return (
            f"{len(self.changes.new)} packages {be} installed, {len(self.removed)} removed"
            f"{''.join(f', {name} is back' for name in self.packages_back)}."
            if self.changed
            else "The packages were right."
        )


def _find_replaced(names: typing.Sequence[str]) -> typing.Dict[str, typing.List[str]]:
    """Find the packages that each of these replaces. Mostly no package is replaced, and one question is enough."""
    if not names or not find_removals(_simulate(names)):
        return {}
    found = {name: find_removals(_simulate([name])) for name in names}
    return {name: gone for name, gone in found.items() if gone}


def _simulate(names: typing.Sequence[str]) -> str:
    """Let apt-get list the steps of an installation; empty if it cannot (the installation says why).

    Raises Problem if it does not answer: the packages that these replace would not come back with their removal.
    """
    words = [*_APT[:2], "--simulate", "install", "--no-install-recommends", *names]
    answer = commands.run(words, environment=_ENVIRONMENT, limit=_LIMIT_SIMULATION, user=commands.find_nobody())
    if answer.status < 0:
        raise Problem(
            f"{quote(answer.error, LINE)}, so it is not known which packages the new ones replace; expected an answer: run "
            f"'apt-get {plain(' '.join(words[2:]), LINE)}' on this computer by hand. Nothing was changed."
        )
    return answer.text


def _apt(*words: str) -> None:
    """Run apt-get. Raises Problem with its last words."""
    answer = commands.run([*_APT, *words], environment=_ENVIRONMENT, limit=_LIMIT)
    if answer.status != 0:
        errors = [line for line in answer.error.splitlines() if line.startswith("E:")] or answer.error.splitlines()[-1:]
        raise Problem(
            f"apt-get {plain(' '.join(words), LINE)} failed ({quote(' '.join(errors) or f'status {answer.status}', _LONGEST)}); expected "
            "package sources that have these packages, and a network: run it on this computer by hand."
        )


CONCERN = Concern("multimaster_packages", OPTIONS, lambda module, memory: Packages(module.params))
