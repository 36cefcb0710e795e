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
    """Results cannot be written: a full disk, a directory that is gone; what is there is valid."""

    exit_code = 4


class Interrupted(KeyboardInterrupt):
    """A signal has stopped a run between two steps, on all ranks, and its state has been saved.

    Any other ``KeyboardInterrupt`` comes at once, on this rank alone: nothing collective may
    follow.
    """
