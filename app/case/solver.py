"""The `[solver]`, `[output]` and `[sweep]` tables of a case file."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    Field,
    PlainValidator,
    SerializerFunctionWrapHandler,
    field_validator,
    model_serializer,
)
from pydantic_core import PydanticCustomError

from tribox.app.case.quantities import Quantity
from tribox.app.case.table import (
    MOST_ENTRIES,
    Count,
    CountOrZero,
    Flag,
    Model,
    Place,
    Problem,
    Text,
    problems_error,
)

_LETTERS = "A-Za-z0-9.+=_%µμ-"
LABEL = re.compile(rf"[{_LETTERS}]*=[{_LETTERS}]*")
"""What the name of a directory looks like that a value of a sweep gets."""
LONGEST_LABEL = 200  # bytes of such a name; file systems take 255


def _petsc_value(value: object) -> object:
    """A PETSc option's value as it stands."""
    if not isinstance(value, str | int | float):
        raise PydanticCustomError("petsc", "must be text, a number, true or false")
    if isinstance(value, float) and not math.isfinite(value):
        raise PydanticCustomError("petsc", "must be finite")
    return value


PetscValue = Annotated[
    str | int | float | bool,
    PlainValidator(_petsc_value, json_schema_input_type=str | int | float | bool),
]


class MassScaling(Model):
    """Mass added so that an explicit step may be longer."""

    kind: Literal["uniform", "limiting"] = "limiting"
    """ "uniform" raises every density by a factor, "limiting" adds mass only to the elements that
    would ask for a shorter step than `step`"""
    factor: Annotated[float, Quantity(ge=1.0)] | None = None
    """factor of all densities; with uniform"""
    step: Annotated[float, Quantity("s", gt=0.0)] | None = None
    """time step, before step_safety, that the mass has to allow; needed with limiting, instead of a
    factor with uniform"""

    def problems(self, place: Place) -> Iterator[Problem]:
        """Keys that do not fit together; `place` is where this table stands in the case."""
        if self.kind == "limiting":
            if self.factor is not None:
                reason = 'goes with kind = "uniform" only; limiting elements need step'
                yield Problem((*place, "factor"), reason, self.factor)
            elif self.step is None:
                yield Problem((*place, "step"), 'missing; the step to reach, such as "1e-7 s"')
        elif (self.factor is None) == (self.step is None):
            found = "neither" if self.step is None else "both"
            yield Problem(place, f"give either factor or step, found {found}")


EXPLICIT_KEYS = ("step_safety", "damping", "mass_scaling", "kinetic_limit")


class Solver(Model):
    """How the equations are solved."""

    kind: Literal["implicit", "explicit"] = "implicit"
    """time integration: implicit quasi-static, or explicit dynamic (stages may choose for
    themselves)"""
    tolerance: Annotated[float, Quantity(gt=0.0, lt=1.0)] = 1e-8
    """residual at which a step is solved, relative to the contact force"""
    max_iterations: Count = 25
    """most Newton iterations in one attempt"""
    min_step_fraction: Annotated[float, Quantity(gt=0.0, le=1.0)] = 1e-4
    """smallest part of a step that is tried before giving up"""
    linear: Literal["auto", "direct", "krylov"] = "auto"
    """linear solver: MUMPS, or GMRES with algebraic multigrid; auto: by size, and MUMPS where
    iterations take too long"""
    partition: Literal["contact", "cells"] = "contact"
    """what ranks share out evenly: cells and slave facets, or cells only"""
    petsc: dict[Text, PetscValue] = Field(default={})
    """PETSc options of the implicit solver: name without "-", and a number, true, false or a word;
    those that print, name files or run code are refused"""

    step_safety: Annotated[float, Quantity(gt=0.0, le=1.0)] = 0.9
    """time step over the stable step; explicit only"""
    damping: Annotated[float, Quantity("1/s", ge=0.0)] = 0.0
    """c of the mass-proportional damping force c m v; explicit only"""
    mass_scaling: MassScaling | None = None
    """mass added for a longer step; explicit only"""
    kinetic_limit: Annotated[float, Quantity(gt=0.0)] = 0.05
    """kinetic over strain energy above which a run with scaled mass warns; explicit only"""

    @field_validator("petsc")
    @classmethod
    def _only_allowed(cls, options: dict[str, Any]) -> dict[str, Any]:
        """Options that say how a system is solved, and nothing else."""
        if problems := list(option_problems(options)):
            raise problems_error(problems)
        return options

    @model_serializer(mode="wrap")
    def _without_idle_keys(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out the keys that an implicit run has no use for."""
        idle = () if self.kind == "explicit" else EXPLICIT_KEYS
        return {key: value for key, value in handler(self).items() if key not in idle}

    def problems(self, place: Place) -> Iterator[Problem]:
        """Keys that do not fit together; `place` is where this table stands in the case."""
        if self.kind == "implicit":
            for key in EXPLICIT_KEYS:
                if key in self.model_fields_set:
                    yield Problem((*place, key), 'goes with kind = "explicit" only')
        elif self.mass_scaling is not None:
            yield from self.mass_scaling.problems((*place, "mass_scaling"))


class Output(Model):
    """The files that are written beside the history."""

    fields_every: CountOrZero = 1
    """steps between two outputs of the fields; 0 writes them only at the end of each stage and
    velocity"""
    figures: Flag = True
    """whether figures are drawn at the end"""
    checkpoint_every: CountOrZero = 0
    """steps between two checkpoints; 0 for none by steps"""
    checkpoint_interval: Annotated[float, Quantity("s", gt=0.0)] = 600.0
    """time on the clock between two checkpoints; one is written in any case when a run ends, is
    stopped or fails"""
    checkpoints_kept: CountOrZero = 2
    """checkpoints that are kept, the latest; 0 writes none"""


class Sweep(Model):
    """One key of the case, run with several values."""

    key: Text
    """dotted key to change, list entries by number, such as contact.0.film.thickness"""
    values: tuple[Any, ...] = Field(min_length=1, max_length=MOST_ENTRIES)
    """the values, each written as it would be at the key itself"""

    @property
    def labels(self) -> tuple[str, ...]:
        """One name for each value, such as "thickness=10nm", usable for a directory.

        Files are called by their names alone where these differ: wherever they are.
        """
        last, texts = self.key.rsplit(".", 1)[-1], [_as_text(value) for value in self.values]
        if self.names_files and len({Path(text).name for text in texts}) == len(texts):
            texts = [Path(text).name for text in texts]
        return tuple(_as_name(f"{last}={text}") for text in texts)

    @property
    def names_files(self) -> bool:
        """Whether the values are names of files: of meshes, or of laws in Python."""
        return self.key.rsplit(".", 1)[-1] in ("mesh", "class")


def _as_text(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list | tuple):
        return "x".join(map(_as_text, value))
    return str(value)


def _as_name(text: str) -> str:
    """Text without spaces and without what a directory name or a shell would stumble over."""
    return re.sub(rf"[^{_LETTERS}]+", "_", re.sub(r"(?<=\d)\s+(?=\D)", "", text.strip()))


# -- PETSc options that a case may give: those that say how a system is solved, and nothing else ---
#
# PETSc has options that run code (``pc_type python``) or write any file (``ksp_view_mat
# binary:FILE``), and a case is to be data. So names are looked up in the table below, and values
# are numbers, true or false, or words that it lists; a new option is a new line there.

Kind = str | tuple[str, ...]
"""What a value may be: "number", "numbers" (with commas between them), "flag", or these words."""

_KRYLOV = (
    "preonly richardson chebyshev cg groppcg pipecg cgne fcg gmres fgmres lgmres dgmres pgmres "
    "pipefgmres gcr pipegcr bcgs bcgsl fbcgs fbcgsr ibcgs qmrcgs bicg cgs tfqmr tcqmr minres "
    "symmlq cr lsqr"
)
_WORDS = {
    "ksp_type": _KRYLOV,
    "ksp_pc_side": "left right symmetric",
    "ksp_norm_type": "none preconditioned unpreconditioned natural",
    "ksp_gmres_cgs_refinement_type": "refine_never refine_ifneeded refine_always",
    "pc_type": "none jacobi pbjacobi vpbjacobi bjacobi asm gasm sor eisenstat ilu icc lu cholesky "
    "qr svd gamg hypre redundant telescope kaczmarz",
    "pc_factor_mat_solver_type": "mumps petsc superlu superlu_dist umfpack klu cholmod mkl_pardiso "
    "pastix strumpack",
    "pc_factor_mat_ordering_type": "natural nd 1wd rcm qmd rowlength amd external",
    "pc_factor_shift_type": "none nonzero positive_definite inblocks",
    "pc_asm_type": "basic restrict interpolate none",
    "pc_asm_local_type": "additive multiplicative",
    "pc_jacobi_type": "diagonal rowl1 rowmax rowsum",
    "pc_gamg_type": "agg classical",
    "pc_gamg_esteig_ksp_type": _KRYLOV,
    "pc_mg_type": "multiplicative additive full kaskade",
    "pc_mg_cycle_type": "v w",
    "pc_hypre_type": "boomeramg",
    "pc_hypre_boomeramg_cycle_type": "V W",
    "pc_hypre_boomeramg_coarsen_type": "CLJP Ruge-Stueben modifiedRuge-Stueben Falgout PMIS HMIS",
    "pc_hypre_boomeramg_interp_type": "classical direct multipass multipass-wts ext+i ext+i-cc "
    "standard standard-wts block block-wtd FF FF1 ext ad-wts ext-mm ext+i-mm ext+e-mm",
    "pc_hypre_boomeramg_measure_type": "local global",
    "snes_linesearch_type": "bt basic l2 cp nleqerr none",
    "snes_type": "newtonls newtontr",
    "mat_coarsen_type": "mis hem misk",
    "mat_superlu_dist_colperm": "NATURAL MMD_AT_PLUS_A MMD_ATA METIS_AT_PLUS_A PARMETIS",
    "mat_superlu_dist_rowperm": "NOROWPERM LargeDiag_MC64 LargeDiag_AWPM",
    "mat_superlu_dist_fact": "SamePattern SamePattern_SameRowPerm DOFACT",
} | {
    f"pc_hypre_boomeramg_relax_type_{where}": "Jacobi sequential-Gauss-Seidel "
    "seqboundary-Gauss-Seidel SOR/Jacobi backward-SOR/Jacobi symmetric-SOR/Jacobi "
    "l1scaled-SOR/Jacobi Gaussian-elimination l1-Gauss-Seidel backward-l1-Gauss-Seidel CG "
    "Chebyshev FCF-Jacobi l1scaled-Jacobi"
    for where in ("all", "up", "down", "coarse")
}
_NUMBERS = (
    # Krylov methods
    "ksp_rtol ksp_atol ksp_divtol ksp_max_it ksp_min_it ksp_gmres_restart ksp_gcr_restart "
    "ksp_gmres_haptol ksp_gmres_breakdown_tolerance ksp_bcgsl_ell ksp_bcgsl_xres "
    "ksp_lgmres_augment ksp_dgmres_eigen ksp_dgmres_max_eigen ksp_richardson_scale "
    "ksp_chebyshev_esteig_steps ksp_check_norm_iteration ksp_fcg_mmax "
    # factorisations, sweeps and subdomains
    "pc_factor_levels pc_factor_fill pc_factor_shift_amount pc_factor_zeropivot "
    "pc_factor_column_pivot pc_factor_nonzeros_along_diagonal pc_sor_omega pc_sor_its pc_sor_lits "
    "pc_eisenstat_omega pc_bjacobi_blocks pc_bjacobi_local_blocks pc_asm_blocks "
    "pc_asm_local_blocks pc_asm_overlap pc_gasm_overlap pc_gasm_total_subdomains "
    "pc_redundant_number pc_telescope_reduction_factor "
    # multigrid
    "pc_gamg_threshold_scale pc_gamg_agg_nsmooths pc_gamg_aggressive_coarsening "
    "pc_gamg_coarse_eq_limit pc_gamg_process_eq_limit pc_gamg_esteig_ksp_max_it pc_mg_levels "
    "pc_mg_smoothup pc_mg_smoothdown pc_mg_multiplicative_cycles mat_coarsen_misk_distance "
    "pc_gamg_square_graph pc_gamg_injection_index "
    # nonlinear solver
    "snes_max_it snes_max_funcs snes_divergence_tolerance snes_linesearch_order "
    "snes_linesearch_damping snes_linesearch_max_it snes_linesearch_maxstep "
    "snes_linesearch_minlambda snes_linesearch_alpha snes_linesearch_rtol snes_linesearch_atol "
    "snes_linesearch_ltol snes_ksp_ew_version snes_ksp_ew_rtol0 snes_ksp_ew_rtolmax "
    "snes_ksp_ew_gamma snes_ksp_ew_alpha snes_ksp_ew_alpha2 snes_ksp_ew_threshold"
)
_FLAGS = (
    "ksp_gmres_modifiedgramschmidt ksp_gmres_classicalgramschmidt ksp_gmres_preallocate "
    "ksp_initial_guess_nonzero ksp_richardson_self_scale ksp_chebyshev_esteig_noisy "
    "pc_factor_diagonal_fill pc_factor_reuse_ordering pc_factor_reuse_fill "
    "pc_factor_pivot_in_blocks pc_sor_symmetric pc_sor_backward pc_sor_forward "
    "pc_sor_local_symmetric pc_sor_local_backward pc_sor_local_forward pc_jacobi_abs "
    "pc_jacobi_fixdiagonal pc_eisenstat_no_diagonal_scaling "
    "pc_gamg_repartition pc_gamg_reuse_interpolation "
    "pc_gamg_asm_use_agg pc_gamg_aggressive_square_graph pc_gamg_use_sa_esteig "
    "pc_gamg_parallel_coarse_grid_solver pc_gamg_recompute_esteig pc_mg_distinct_smoothup "
    "snes_ksp_ew snes_linesearch_keeplambda snes_linesearch_norms mat_superlu_dist_equil "
    "mat_superlu_dist_iterrefine mat_superlu_dist_replacetinypivot mat_coarsen_misk_use_matrix "
    "pc_hypre_boomeramg_nodal_relaxation pc_hypre_boomeramg_keeptranspose"
)
_LISTS = (
    "ksp_chebyshev_esteig ksp_chebyshev_eigenvalues pc_gamg_threshold "
    "pc_gamg_rank_reduction_factors"
)
_BOOMERAMG = (
    "max_levels max_iter tol strong_threshold max_row_sum truncfactor P_max agg_nl agg_num_paths "
    "grid_sweeps_all grid_sweeps_up grid_sweeps_down grid_sweeps_coarse relax_weight_all "
    "outer_relax_weight_all nodal_coarsen nodal_coarsen_diag vec_interp_variant vec_interp_qmax "
    "vec_interp_smooth numfunctions coarsen_max_levels min_coarse_size max_coarse_size rtol"
)
ALLOWED: Mapping[str, Kind] = (
    dict.fromkeys(_NUMBERS.split(), "number")
    | dict.fromkeys(_FLAGS.split(), "flag")
    | dict.fromkeys(_LISTS.split(), "numbers")
    | {f"pc_hypre_boomeramg_{name}": "number" for name in _BOOMERAMG.split()}
    | {name: tuple(words.split()) for name, words in _WORDS.items()}
)
"""Kind of value by name."""

# Controls of MUMPS that are numbers and no more: not its output units (ICNTL 1 to 4), by which
# Fortran writes files, nor factors kept in files (22, 34), nor unknowns left over (19).
_MUMPS = re.compile(r"mat_mumps_(?:icntl_(?!(?:[1-4]|19|22|34)$)[1-9][0-9]?|cntl_[1-7])")
# Solvers within solvers: of the levels of multigrid, of subdomains, of eigenvalue estimates.
_INNER = re.compile(
    r"(?:(?:mg_levels|mg_fine|mg_coarse|sub|redundant|telescope|esteig|pc_gamg_esteig)_"
    r"(?:[0-9]{1,2}_)?)+"
)
_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
LONGEST = 80  # letters of a value


def option_problems(options: Mapping[str, Any]) -> Iterator[Problem]:
    """What is wrong with PETSc options; places are seen from their table."""
    for name, value in options.items():
        kind = _kind_of(name)
        if kind is None:
            yield Problem((name,), _unknown(name), value)
        elif not _fits(value, kind):
            yield Problem((name,), f"must be {_described(kind)}", value)


def _kind_of(name: str) -> Kind | None:
    """What an option's value may be; None for an option that a case may not give."""
    inner = _INNER.match(name)
    for candidate in (name, name[inner.end() :] if inner else name):
        if candidate in ALLOWED:
            return ALLOWED[candidate]
        if _MUMPS.fullmatch(candidate):
            return "number"
    return None


def _fits(value: Any, kind: Kind) -> bool:
    """Whether a value is of a kind; numbers and flags may be written as text."""
    if isinstance(kind, tuple):
        return isinstance(value, str) and value in kind
    if kind == "flag":
        return isinstance(value, bool) or value in ("true", "false")
    if isinstance(value, bool):
        return False
    if isinstance(value, int | float):
        return abs(value) < 1e300 and math.isfinite(value)
    if not isinstance(value, str) or len(value) > LONGEST:
        return False
    parts = value.split(",") if kind == "numbers" else [value]
    return all(_NUMBER.fullmatch(part) for part in parts)


def _described(kind: Kind) -> str:
    if isinstance(kind, tuple):
        return "one of " + ", ".join(f'"{word}"' for word in kind)
    return {
        "flag": "true or false",
        "number": "a number",
        "numbers": 'a number, or several as in "0.1,0.05"',
    }[kind]


def _unknown(name: str) -> str:
    """The reason why an option is refused, with the nearest that is not."""
    bare = name.lstrip("-")
    if bare != name and _kind_of(bare) is not None:
        return f'write it without the hyphen: "{bare}"'
    inner = _INNER.match(name)
    within, tail = (name[: inner.end()], name[inner.end() :]) if inner else ("", name)
    near = difflib.get_close_matches(tail, ALLOWED, n=1, cutoff=0.8)
    hint = f' (did you mean "{within}{near[0]}"?)' if near else ""
    return (
        f"no PETSc option that a case may give{hint}; these are options of ksp_, pc_, mg_levels_, "
        "sub_, mat_mumps_ and snes_ that neither print, nor name files, nor run code (see "
        "docs/case-file.md)"
    )
