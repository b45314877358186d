# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The one exception that a user is meant to read."""


class Problem(Exception):
    """One sentence for the user: what was found, what was expected, what to do."""


def sentence(problem: Exception) -> str:
    """What an exception of a half-done change says to the user: a Problem its own words, an OSError which file."""
    if isinstance(problem, OSError):
        return "%s cannot be written (%s), expected a writable file system with room." % (
            problem.filename or "A file",
            problem.strerror,
        )
    return str(problem)
