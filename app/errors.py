"""The exceptions a user can meet, and the exit codes they end the program with."""

from __future__ import annotations


class TriboxError(Exception):
    """Base of all errors that are reported as one line instead of a traceback."""

    exit_code = 1


class InputError(TriboxError):
    """The case file, an option or a file it names is wrong; nothing was run."""

    exit_code = 2


class SolutionError(TriboxError):
    """The solver could not go on; the last converged state has been saved."""

    exit_code = 3


class OutputError(TriboxError):
    """Results cannot be written any more: a full disk, or a directory that is gone."""

    exit_code = 4
