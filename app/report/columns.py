"""What the columns of the tables are called in the report, and their units."""

from __future__ import annotations

from dataclasses import dataclass

from tribox.app.figures import symbols


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a table of results.

    Attributes:
        name: in the file; title: in the report; unit: SI, "" of a plain number.
    """

    name: str
    title: str
    unit: str = ""


_SYMBOLS = {
    "time": symbols.TIME,
    "velocity": symbols.VELOCITY,
    "normal_force": symbols.NORMAL_FORCE,
    "friction_force": symbols.FRICTION_FORCE,
    "friction_coefficient": symbols.RATIO,
    "film_thickness": symbols.FILM,
    "effective_viscosity": symbols.VISCOSITY,
}
_VECTORS = {
    "displacement": symbols.DISPLACEMENT,
    "force": symbols.REACTION,
    "moment": symbols.MOMENT,
}
_KNOWN = {
    column.name: column
    for column in (
        Column("step", "step"),
        Column("stage", "stage"),
        Column("label", "load step"),
        Column("steady", "steady"),
        Column("pair", "pair"),
        Column("surface", "surface"),
        Column("body", "body"),
        Column("tool", "tool"),
        Column("probe", "probe"),
        Column("angle", "angle", "rad"),
        Column("bend_angle", "bend angle", "rad"),
        Column("springback", "springback", "rad"),
        Column("radius", "radius", "m"),
        Column("off_circle", "off the circle", "m"),
        Column("length", "length", "m"),
        Column("mean_thickness", "mean thickness", "m"),
        Column("min_thickness", "least thickness", "m"),
        Column("max_thickness", "largest thickness", "m"),
        Column("thinnest_at", "thinnest at", "m"),
        Column("rotation", "rotation θ", "rad"),
        Column("driving_moment", "driving moment", "N m"),
        Column("slip_speed", "slip speed", "m/s"),
        Column("driven_displacement", "driven path", "m"),
        Column("tangential_force", "signed friction force", "N"),
        Column("normal_resultant", "normal resultant", "N"),
        Column("drag", "drag", "N"),
        Column("mu", "μ of the law"),
        Column("contact_area", "contact area A", "m²"),
        Column("stick_fraction", "share that sticks"),
        Column("viscous_fraction", "share only the film carries"),
        Column("max_penetration", "largest penetration", "m"),
        Column("twist_moment", "twisting moment", "N m"),
        Column("radial_force", "radial force", "N"),
        Column("newton_iterations", "Newton iterations"),
        Column("linear_iterations", "linear iterations"),
    )
}
_KINDS = {
    **{name: (f"{one.name} {one.symbol}_{{}}", one.unit) for name, one in _VECTORS.items()},
    "velocity": ("velocity v_{}", "m/s"),
    "boundary_force": ("force of boundaries, {}", "N"),
    "contact_force": ("force of contacts, {}", "N"),
    "driving_force": ("driving force, {}", "N"),
}


def column(name: str) -> Column:
    """The column of this name; of an unknown one the name itself, without a unit.

    Args:
        name: in the file, such as "force_x".
    """
    if name in _SYMBOLS:
        known = _SYMBOLS[name]
        return Column(name, f"{known.name} {known.symbol}", known.unit)
    if name in _KNOWN:
        return _KNOWN[name]
    kind, _, axis = name.rpartition("_")
    if axis in ("x", "y", "z") and kind in _KINDS:
        title, unit = _KINDS[kind]
        return Column(name, title.format(axis), unit)
    return Column(name, name)
