"""A results directory that is free, or may be cleared, and then belongs to one process."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tribox.app.errors import InputError
from tribox.app.results.directory import check_free, check_no_links, prepare
from tribox.app.results.earlier_sweep import sweep_labels
from tribox.app.results.lock import DirectoryLock, in_use, owner_of


class Claim:
    """A results directory, from the first look at it until all is written."""

    def __init__(self, directory: Path, force: bool) -> None:
        """Nothing is done yet.

        Args:
            directory: of the results.
            force: whether results that are there may be cleared.
        """
        self.directory, self._force = directory, force
        self._lock = DirectoryLock(directory)

    def take(self, goes_on: bool = False) -> None:
        """See that results may be written, and lock the directory; nothing is cleared yet.

        Args:
            goes_on: whether it is for a run that goes on, so that there are results.

        Raises:
            InputError: it holds results and ``force`` is not given, or other files, or links, or
                another process is writing there.
            OutputError: it cannot be made or written.
        """
        if goes_on:
            check_not_in_use(self.directory)
            check_no_links(self.directory)
        else:
            self._check()
        self._lock.take()

    def clear(self, begins: bool = False) -> None:
        """Look again, and clear old results.

        Args:
            begins: whether a run begins here, as of :func:`~tribox.app.results.directory.prepare`.

        Raises:
            InputError: as of :meth:`take`, if somebody has come between.
            OutputError: the directory cannot be written.
        """
        prepare(self.directory, self._check(), begins)

    def release(self) -> None:
        """Unlock the directory; it goes if it was made for this claim and nothing was written."""
        self._lock.release()

    def _check(self) -> tuple[str, ...]:
        """Labels of the sweep whose results may be cleared."""
        check_not_in_use(self.directory, self._lock.held)
        labels = sweep_labels(self.directory)
        check_free(self.directory, self._force, labels)
        for label in labels:
            check_not_in_use(self.directory / label)
        return labels


def check_not_in_use(directory: Path, by_this: bool = False) -> None:
    """See that no process is writing into a directory, but perhaps this one.

    Raises:
        InputError: one is.
    """
    owner = None if by_this else owner_of(directory)
    if owner is not None:
        raise InputError(in_use(directory, owner))


@contextmanager
def claimed(directory: Path, force: bool, goes_on: bool = False) -> Iterator[Claim]:
    """Context of a :class:`Claim` that has been taken."""
    claim = Claim(directory, force)
    claim.take(goes_on)
    try:
        yield claim
    finally:
        claim.release()
