# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: BSD-2-Clause

"""The exception Problem: its text is a sentence for the user."""


class Problem(Exception):
    """One sentence for the user: what was found, what was expected, what to do."""


def sentence(problem: Exception) -> str:
    """Return the sentence for a user about a half-done change: the words of a Problem, or the file of an OSError."""
    if isinstance(problem, OSError):
        file = problem.filename or "A file"
        return f"{file} cannot be written ({problem.strerror}), expected a writable file system with room."
    return str(problem)
