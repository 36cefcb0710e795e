"""What numbers of a case that cannot be calculated with come to: one line, on all ranks."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from petsc4py import PETSc

from tribox.app.errors import TriboxError
from tribox.app.explicit.energies import ExplicitError


@contextmanager
def failures_as(kind: type[TriboxError], where: str) -> Iterator[None]:
    """Raise what extreme numbers, or a state without a way on, lead to as an error of ours.

    Values of a case that are allowed one by one may overflow together. numpy's warnings of that are
    not shown: what becomes of it, forces that are no numbers, is looked for in each step.

    Raises:
        TriboxError: of this kind, in the place of an arithmetic error.
    """
    with np.errstate(over="ignore", invalid="ignore", divide="ignore", under="ignore"):
        try:
            yield
        except ExplicitError as error:
            raise kind(f"{where}: {error}; check the loads, the motions and the mesh") from None
        except PETSc.Error as error:
            said = str(error).strip().splitlines()[-1]
            raise kind(f"{where}: PETSc gives up: {said}") from None
        except MemoryError:
            raise kind(f"{where}: there is not enough memory for so many cells") from None
        except (ArithmeticError, np.linalg.LinAlgError) as error:
            said = " ".join(str(error).split()) or type(error).__name__
            raise kind(
                f"{where}: numbers out of range ({said}); check the magnitudes and units of the "
                "case: lengths, moduli, densities, penalties, velocities"
            ) from None
