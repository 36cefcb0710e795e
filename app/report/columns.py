"""What the columns of the tables are called in the report, and their units."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a table of results.

    Attributes:
        name: in the file; title: in the report; unit: SI, "" of a plain number.
    """

    name: str
    title: str
    unit: str = ""


_KNOWN = {
    column.name: column
    for column in (
        Column("time", "time t", "s"),
        Column("step", "step"),
        Column("stage", "stage"),
        Column("label", "load step"),
        Column("steady", "steady"),
        Column("pair", "pair"),
        Column("surface", "surface"),
        Column("body", "body"),
        Column("velocity", "velocity V", "m/s"),
        Column("slip_speed", "slip speed", "m/s"),
        Column("driven_displacement", "driven path", "m"),
        Column("normal_force", "normal force N", "N"),
        Column("friction_force", "friction force F_T", "N"),
        Column("tangential_force", "signed friction force", "N"),
        Column("normal_resultant", "normal resultant", "N"),
        Column("drag", "drag", "N"),
        Column("friction_coefficient", "ratio F_T/N"),
        Column("mu", "μ of the law"),
        Column("film_thickness", "film thickness D", "m"),
        Column("effective_viscosity", "effective viscosity η_eff", "Pa s"),
        Column("contact_area", "contact area A", "m²"),
        Column("stick_fraction", "share that sticks"),
        Column("viscous_fraction", "share only the film carries"),
        Column("max_penetration", "largest penetration", "m"),
        Column("twist_moment", "twisting moment", "N m"),
        Column("radial_force", "radial force", "N"),
        Column("newton_iterations", "Newton iterations"),
    )
}
_KINDS = {
    "displacement": ("displacement u_{}", "m"),
    "velocity": ("velocity v_{}", "m/s"),
    "force": ("force R_{}", "N"),
    "boundary_force": ("force of boundaries, {}", "N"),
    "contact_force": ("force of contacts, {}", "N"),
    "moment": ("moment M_{}", "N m"),
}


def column(name: str) -> Column:
    """The column of this name; of an unknown one the name itself, without a unit.

    Args:
        name: in the file, such as "force_x".
    """
    if name in _KNOWN:
        return _KNOWN[name]
    kind, _, axis = name.rpartition("_")
    if axis in ("x", "y", "z") and kind in _KINDS:
        title, unit = _KINDS[kind]
        return Column(name, title.format(axis), unit)
    return Column(name, name)
