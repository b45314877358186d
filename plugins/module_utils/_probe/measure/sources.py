# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""Topics on their way between two roscores: those that did not arrive, in the states of discovery nodes.

Upstream's nodes and the bundled ones have the methods: `masterInfo` for the own one, `masterInfoFiltered` for another, as a
sync node asks it. If nothing is missing, no other computer is asked.
"""

import time
import typing
import xmlrpc.client

from ..._base.deadlines import PAUSE, call_all, poll
from ..._base.plain_text import plain
from ..._base.problem import explain_error
from ..._contract.outcomes import Outcome
from ..._machine.outcomes import classify_error
from ..ros_client.documents import NODE, STATE
from ..ros_client.ros import Ros
from ..ros_client.xml_rpc import server
from . import topics
from .talker import topic_of

FOLLOWS = 3.0  # seconds that discovery and sync nodes may need to follow: upstream's read their roscore once a second
LONGEST = 20.0  # seconds for all of them
MOST = 50  # topics of one discovery node that are reported
# Of the elements of a filter only sync_topics and ignore_services have a pattern (docs/understand/protocol.md).
FILTER = [False, "", "", "", r"\A/multimaster_verify/.*\Z", r"\A.*\Z", "", "", "", "", ""]

Row = typing.Dict[str, typing.Any]
Job = typing.Tuple[Row, typing.Set[str]]  # a master, and the topics that it is asked for


def sources(
    ros: Ros,
    masters: typing.List[Row],
    robots: typing.Dict[str, str],
    own: str,
    talkers: typing.List[str],
    deadline: float,
) -> typing.List[Row]:
    """Ask the own discovery node for the topics of the own roscore, and foreign ones for the talkers that are missing here.

    `robots`: {computer: its robot}; `talkers`: the computers that are to be heard here. Topics that others give, and topics that are not
    registered here yet, is waited for until the deadline (monotonic seconds).
    """
    try:
        there = set(topics.read_publishers(ros))
        jobs = list_jobs(masters, robots, own, talkers, there)
        rows = call_all(_ask, jobs, LONGEST, lambda job: _make_row(job, error="late", outcome=Outcome.NO_ANSWER))
        own_row = _ask_own(ros, masters, {topic_of(name) for name in robots if robots[name] == robots.get(own)}, own)
        given = {name for row in rows for name in row["given"]}
        if given:  # the sync node may be about to register them
            end = max(deadline, time.monotonic() + FOLLOWS)
            there = poll(lambda: set(topics.read_publishers(ros)), given.issubset, end)
    except OSError:
        return []  # the part `roscore` says so
    return own_row + [
        dict(row, **{key: [name for name in row[key] if name not in there] for key in ("topics", "given")})
        for row in rows
    ]


def list_jobs(
    masters: typing.List[Row],
    robots: typing.Dict[str, str],
    own: str,
    talkers: typing.List[str],
    there: typing.Set[str],
) -> typing.List[Job]:
    """List the masters of other robots with the topics of their talkers that are missing at the own roscore (`there`)."""
    jobs = []
    for master in masters:
        robot = robots.get(master["computer"])
        wanted = {topic_of(name) for name in talkers if robots.get(name) == robot} - there
        if wanted and robot != robots.get(own):
            jobs.append((master, wanted))
    return jobs


def _ask(job: Job) -> Row:
    return _read(job, server(job[0]["monitor_uri"], NODE).masterInfoFiltered, FILTER)


def _ask_own(ros: Ros, masters: typing.List[Row], mine: typing.Set[str], own: str) -> typing.List[Row]:
    """Ask the own discovery node for all topics of the roscore, again until it has followed. Raises OSError.

    Of these, the answer lists those of the own talkers (`mine`), and those that are missing in the state.
    """
    found: typing.List[Row] = []
    for master in (master for master in masters if master["computer"] == own):
        deadline, asked = time.monotonic() + FOLLOWS, set(topics.read_publishers(ros))
        while True:
            row = _read((master, asked), server(master["monitor_uri"], STATE).masterInfo)
            missing = asked.difference(row["given"])
            if row["error"] or not missing or time.monotonic() + PAUSE > deadline:
                break
            time.sleep(PAUSE)
            asked &= set(topics.read_publishers(ros))  # topics that have come since are no matter
        listed = asked & mine | set(sorted(missing)[:MOST])
        found.append(dict(row, topics=sorted(listed), given=sorted(listed.intersection(row["given"]))))
    return found


def _read(job: Job, method: typing.Callable[..., typing.Any], *arguments: typing.Any) -> Row:
    try:
        return _make_row(job, (name for name, nodes in method(*arguments)[4] if isinstance(name, str) and nodes))
    except (OSError, xmlrpc.client.Error) as problem:
        error = plain(explain_error(problem)) or type(problem).__name__
        return _make_row(job, error=error, outcome=classify_error(problem)[0])
    except Exception as problem:  # whatever a stranger answers
        return _make_row(job, error=type(problem).__name__, outcome=Outcome.FAILED)


def _make_row(job: Job, given: typing.Iterable[str] = (), error: str = "", outcome: Outcome = Outcome.ANSWERED) -> Row:
    master, wanted = job
    return {
        "computer": master["computer"],
        "topics": sorted(wanted),
        "given": sorted(wanted.intersection(given)),
        "error": error,
        "outcome": outcome.value,
    }
