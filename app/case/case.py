"""A case: all tables of a case file together, complete and free of contradictions, in SI."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Self

from pydantic import (
    Field,
    PrivateAttr,
    SerializerFunctionWrapHandler,
    ValidationError,
    ValidationInfo,
    field_validator,
    model_serializer,
    model_validator,
)

from tribox.app.case import generators
from tribox.app.case.bodies import Body, OwnBody, formulation_problems
from tribox.app.case.boundary import (
    Boundary,
    Gravity,
    boundary_problems,
    control_problems,
    named_stage_problems,
)
from tribox.app.case.contact import DRAWN, Contact
from tribox.app.case.friction import OwnLaw
from tribox.app.case.geometry import GeneratedGeometry, MeshGeometry
from tribox.app.case.probe import Probe, probe_problems
from tribox.app.case.solver import LONGEST_LABEL, Output, Solver, Sweep
from tribox.app.case.stage import (
    LoadStep,
    Stage,
    load_steps_of,
    order_problems,
    release_problems,
    solver_of,
    stage_problems,
)
from tribox.app.case.table import (
    MOST_ENTRIES,
    Line,
    Model,
    Name,
    Place,
    Problem,
    nearest,
    problems_error,
)
from tribox.app.case.time_tables import TimeTable
from tribox.app.case.toml_files import KeyPathError, flat, set_value, toml_text, value_at
from tribox.app.case.tools import AnyTool, MeshTool, tool_problems
from tribox.app.case.validation import format_problem, problems_of

Geometry = Annotated[
    generators.BlocksGeometry
    | generators.PlacedBlocksGeometry
    | generators.CylinderOnBlockGeometry
    | generators.TwoCylindersGeometry
    | generators.BoxesGeometry
    | generators.SphereGeometry
    | MeshGeometry,
    Field(discriminator="kind"),
]
_MAY_LACK = ("contact", "probe", "tools")
_NEEDS_EXPLICIT = 'goes with solver.kind = "explicit" only'


class Case(Model):
    """One case: everything that defines a run, in SI, complete and free of contradictions.

    The attributes are the tables of the case file. Two cases are equal if these are; where they
    were read from does not count.
    """

    title: Line = ""
    """what the case is about, in one line"""
    geometry: Geometry
    """shapes and mesh"""
    bodies: dict[str, Body] = Field(min_length=1)
    """material and element formulation of each body, [bodies.NAME]"""
    contact: tuple[Contact, ...] = Field(default=(), max_length=MOST_ENTRIES)
    """pairs of surfaces that may touch, [[contact]]; default: none"""
    tools: dict[Name, AnyTool] = Field(default_factory=dict)
    """rigid shapes that bodies are pressed on, [tools.NAME]"""
    boundary: tuple[Boundary, ...] = Field(default=(), max_length=MOST_ENTRIES)
    """supports, motions and loads of surfaces, [[boundary]]; needed without tools"""
    gravity: Gravity | None = None
    """acceleration of gravity, which acts on the mass of all bodies"""
    stage: tuple[Stage, ...] = Field(min_length=1, max_length=MOST_ENTRIES)
    """the parts of the run, one after the other, [[stage]]"""
    probe: tuple[Probe, ...] = Field(default=(), max_length=MOST_ENTRIES)
    """points, lines, bodies and contacts that are followed, [[probe]]"""
    solver: Solver = Solver()
    """how the equations are solved"""
    output: Output = Output()
    """what is written beside the history"""
    sweep: Sweep | None = None
    """one key that is run with several values"""

    _source: Path | None = PrivateAttr(None)
    _past: bool = PrivateAttr(False)  # read to look at results: nothing that it names is needed

    @model_serializer(mode="wrap")
    def _without_empty_arrays(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave `probe = []` out, to which no [[probe]] could be added, and an empty [tools]."""
        return {key: value for key, value in handler(self).items() if key not in _MAY_LACK or value}

    @property
    def source(self) -> Path | None:
        """The file this case was read from; None for a case made in Python."""
        return self._source

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Case) and self.__dict__ == other.__dict__

    def with_mesh(self, path: Path) -> Case:
        """The same case with the mesh that was made of its drawing."""
        geometry = self.geometry.model_copy(update={"meshed": path})
        return self.model_copy(update={"geometry": geometry})

    def sweep_cases(self) -> list[tuple[str, Case]]:
        """(label such as "thickness=10nm", case) of each value; empty without a sweep."""
        if self.sweep is None:
            return []
        return [
            (label, self._rebuilt(self._swept_data(value)))
            for label, value in zip(self.sweep.labels, self.sweep.values, strict=True)
        ]

    def swept_value(self, part: Case) -> float | str | None:
        """One of the sweep's cases at the swept key: a number in SI, also of a program, or text."""
        assert self.sweep is not None
        value = value_at(part, self.sweep.key)
        if isinstance(value, TimeTable) and len(value.times) == 1:
            value = value.values[0]
        if isinstance(value, int | float) and not isinstance(value, bool):
            return float(value)
        if self.sweep.key.endswith(".material"):  # of an entry of the library its law says little
            body = value_at(part, self.sweep.key.removesuffix(".material"))
            value = getattr(body, "library", None) or value
        return value if isinstance(value, str) else None

    def named_files(self) -> Iterator[tuple[Place, Path]]:
        """Files that the case reads, each with its key: meshes, classes of the user's own."""
        for key in ("mesh", "meshed") if isinstance(self.geometry, MeshGeometry) else ():
            if (path := getattr(self.geometry, key)) is not None:
                yield ("geometry", key), path
        for name, tool in self.tools.items():
            if isinstance(tool, MeshTool):
                yield ("tools", name, "file"), tool.file
        for number, contact in enumerate(self.contact):
            if isinstance(contact.friction, OwnLaw):
                yield ("contact", number, "friction", "class"), contact.friction.file
        for name, body in self.bodies.items():
            if isinstance(body, OwnBody):
                yield ("bodies", name, "class"), body.file

    def _rebuilt(self, data: dict[str, Any]) -> Case:
        """Another case, with file names seen from the same place."""
        return Case.model_validate(data, context={"source": self._source, "past": self._past})

    def _swept_data(self, value: object) -> dict[str, Any]:
        """The keys that were given, with one value of the sweep; defaults follow from them."""
        assert self.sweep is not None
        data = self.model_dump(mode="json", exclude_unset=True, exclude={"sweep"})
        set_value(data, self.sweep.key, value)
        return data

    @model_validator(mode="before")
    @classmethod
    def _mesh_is_a_kind(cls, data: Any) -> Any:
        """`mesh = "file.msh"` alone says what kind of geometry it is."""
        geometry = data.get("geometry") if isinstance(data, Mapping) else None
        if isinstance(geometry, Mapping) and "mesh" in geometry and "kind" not in geometry:
            return {**data, "geometry": {"kind": "file", **geometry}}
        return data

    @field_validator("bodies", mode="before")
    @classmethod
    def names_of_bodies(cls, bodies: Any, info: ValidationInfo) -> Any:
        """The bodies are those of the generator; said before anything inside them is looked at."""
        geometry = info.data.get("geometry")
        if isinstance(geometry, GeneratedGeometry) and isinstance(bodies, Mapping):
            if problems := list(_name_problems(bodies, geometry.named_bodies)):
                raise problems_error(problems)
        return bodies

    @model_validator(mode="after")
    def _fits_together(self, info: ValidationInfo) -> Self:
        self._source = (info.context or {}).get("source")
        self._past = bool((info.context or {}).get("past"))
        problems = list(self._problems())
        if not problems and self.sweep is not None:
            problems = list(self._sweep_problems())
        if problems:
            raise problems_error(problems)
        return self

    def _problems(self) -> Iterator[Problem]:
        """What no table can see alone."""
        yield from self.geometry.problems(("geometry",))
        for name, body in self.bodies.items():
            yield from body.problems(("bodies", name))
            if isinstance(body, OwnBody) and not self._past:
                yield from body.file_problems(("bodies", name))
        if isinstance(self.geometry, GeneratedGeometry):
            yield from self._formulation_problems(self.geometry)
            yield from self._surface_problems(self.geometry)
        pairs: dict[frozenset[str], int] = {}
        labels: dict[str, int] = {}
        for index, contact in enumerate(self.contact):
            # Of a run that is over the file of a law need not be there any more.
            if not (self._past and isinstance(contact.friction, OwnLaw)):
                yield from contact.problems(("contact", index))
            first = pairs.setdefault(frozenset((contact.slave, contact.master)), index)
            if first != index:
                reason = f"this pair of surfaces is contact.{first} already"
                yield Problem(("contact", index, "slave"), reason, contact.slave)
            same = labels.setdefault(contact.label, index)
            if same != index and first == index:
                reason = f"is what contact.{same} is called already"
                yield Problem(("contact", index, "name"), reason, contact.label)
        if not self.boundary and not self.tools:
            yield Problem(("boundary",), "missing; nothing holds, moves or loads the bodies")
        yield from boundary_problems(self.boundary, ("boundary",), self.geometry.built_section)
        section = self.geometry.built_section
        yield from probe_problems(self.probe, self.bodies, self.contact, ("probe",), section)
        yield from stage_problems(self.stage, self.boundary, ("stage",), self.tools)
        yield from self._tool_problems()
        names = [stage.name for stage in self.stage]
        for index, contact in enumerate(self.contact):
            yield from contact.stage_problems(("contact", index), names)
            yield from self._fit_problems(contact, ("contact", index, "interference"))
        yield from self.solver.problems(("solver",))
        yield from order_problems(self.stage, self.solver.kind, ("stage",))
        solvers = {stage.name: solver_of(stage, self.solver.kind) for stage in self.stage}
        yield from control_problems(self.boundary, solvers, ("boundary",))
        kind, holding = self.solver.kind, self._releasable()
        yield from release_problems(self.stage, holding, self._presses_in, kind, ("stage",))
        yield from self._gravity_problems(solvers)
        yield from self._inertia_problems()
        for index, stage in enumerate(self.stage):
            if stage.velocities and not stage.velocities_within(self.film_conductance):
                reason = "leaves no velocity: the film stress eta_b V/D exceeds it at all of them"
                place = ("stage", index, "film_stress_limit")
                yield Problem(place, reason, stage.film_stress_limit)

    def _tool_problems(self) -> Iterator[Problem]:
        """Mistakes in the tools, and contacts that take one for a body's surface."""
        section, stages = self.geometry.built_section, [stage.name for stage in self.stage]
        yield from tool_problems(self.tools, stages, self.is_explicit, section)
        for index, contact in enumerate(self.contact):
            tool = self.tools.get(contact.master)
            if contact.slave in self.tools:
                reason = "is a tool; a tool is the master, the slave is a surface of a body"
                yield Problem(("contact", index, "slave"), reason, contact.slave)
            if tool is not None and contact.smoothing_angle is not None:
                place = ("contact", index, "smoothing_angle")
                reason = "goes with a master of facets on a body; tools are smooth as they are"
                yield Problem(place, reason, contact.smoothing_angle)
            if tool is not None and contact.fade_length is not None:
                place = ("contact", index, "fade_length")
                reason = "goes with a master of facets on a body; give the tool a fillet there"
                yield Problem(place, reason, contact.fade_length)
            acts = [self.acts_in(contact, name) for name in stages]
            if tool is not None and contact.tied and acts != sorted(acts, reverse=True):
                reason = (
                    "grips what is tied to it from the first stage on and may only let go, once"
                )
                yield Problem(("tools", contact.master, "stages"), reason, list(tool.stages or ()))

    def _fit_problems(self, contact: Contact, place: Place) -> Iterator[Problem]:
        """Press fits that have no time to come on, or no solver that knows them."""
        if contact.interference is None:
            return
        if self.is_explicit:
            yield Problem(place, 'goes with solver.kind = "implicit" only')
        elif contact.comes_on and self.fit_time(contact) is None:
            reason = (
                "comes on over the first stage in which the pair acts, which needs a duration, as "
                "all stages before it do; or give a table [[time, value], ...]"
            )
            yield Problem(place, reason)
        elif contact.interference == DRAWN and not self.acts_in(contact, self.stage[0].name):
            reason = f'"{DRAWN}" is the overlap at the start: let it act in the first stage'
            yield Problem(place, reason)

    def fit_time(self, contact: Contact) -> tuple[float, float] | None:
        """Start and end, s, of the first stage in which a contact acts; None without known ones."""
        start = 0.0
        for stage in self.stage:
            if stage.duration is None:
                return None
            if self.acts_in(contact, stage.name):
                return start, start + stage.duration
            start += stage.duration
        return None

    def acts_in(self, contact: Contact, stage: str) -> bool:
        """Whether a contact's surfaces, or its tool, feel each other in a stage."""
        tool = self.tools.get(contact.master)
        acts = contact.acts_in(stage) and (tool is None or tool.acts_in(stage))
        return acts and not self.is_released(contact, stage)

    def is_released(self, contact: Contact, stage: str) -> bool:
        """Whether a contact's forces are being given up in a stage, or have been before it."""
        names = [one.name for one in self.stage]
        past = self.stage[: names.index(stage) + 1] if stage in names else ()
        given_up = {name for one in past for name in one.release}
        return bool(given_up & self.names_of(contact))

    def names_of(self, contact: Contact) -> set[str]:
        """What a contact is released by: its name, or its tool's."""
        return {contact.label} | ({contact.master} & self.tools.keys())

    def _presses_in(self, name: str, stage: str) -> bool:
        """Whether a contact of this name, or with this tool, acts in a stage."""
        mine = [one for one in self.contact if name in self.names_of(one)]
        return any(self.acts_in(one, stage) for one in mine)

    def _releasable(self) -> dict[str, str]:
        """What a stage may release, by name: a surface, a tool, a contact pair, or two of them."""
        kinds: dict[str, list[str]] = {b.surface: ["surface"] for b in self.boundary if b.holds}
        for tool in self.tools:
            if any(contact.master == tool for contact in self.contact):
                kinds.setdefault(tool, []).append("tool")
        for label in dict.fromkeys(contact.label for contact in self.contact):
            kinds.setdefault(label, []).append("contact pair")
        return {name: " and a ".join(found) for name, found in kinds.items()}

    @property
    def is_explicit(self) -> bool:
        """Whether a stage runs with explicit dynamics."""
        return self.solver.kind == "explicit" and any(s.solver != "implicit" for s in self.stage)

    def _gravity_problems(self, solvers: Mapping[str, str]) -> Iterator[Problem]:
        """Gravity without a direction or on bodies without mass."""
        if self.gravity is None:
            return
        yield from self.gravity.problems(("gravity",))
        place = ("gravity", "stages")
        yield from named_stage_problems(self.gravity.stages, solvers, place)
        if self.geometry.built_section is not None:
            yield from self.gravity.section_problems(self.geometry.built_section, ("gravity",))
        for name, body in self.bodies.items():
            if body.density is None and not self.is_explicit:
                reason = 'missing; gravity needs the mass of each body, in "kg/m^3"'
                yield Problem(("bodies", name, "density"), reason)

    def _inertia_problems(self) -> Iterator[Problem]:
        """Bodies without mass in explicit dynamics, and inertia where there is none."""
        for name, body in self.bodies.items():
            if self.is_explicit and body.density is None:
                reason = 'missing; explicit dynamics needs the mass of each body, in "kg/m^3"'
                yield Problem(("bodies", name, "density"), reason)
            if body.velocity is None:
                continue
            if not self.is_explicit:
                yield Problem(("bodies", name, "velocity"), _NEEDS_EXPLICIT)
            if self.geometry.built_section is not None:
                place = ("bodies", name, "velocity")
                yield from body.velocity.section_problems(self.geometry.built_section, place)
        for index, boundary in enumerate(self.boundary):
            for key in ("platen", "spring"):
                table = getattr(boundary, key)
                if not self.is_explicit and table is not None and table.mass > 0.0:
                    yield Problem(("boundary", index, key, "mass"), _NEEDS_EXPLICIT, table.mass)

    @property
    def film_conductance(self) -> float:
        """Largest eta_b/D of all contacts, Pa s/m; 0 without a film."""
        return max((contact.film_conductance for contact in self.contact), default=0.0)

    @property
    def load_steps(self) -> list[LoadStep]:
        """The load steps of all stages, in order."""
        out: list[LoadStep] = []
        for stage in self.stage:
            before = out[-1].velocity if out else 0.0
            out += load_steps_of(stage, self.film_conductance, before)
        return out

    def _formulation_problems(self, geometry: GeneratedGeometry) -> Iterator[Problem]:
        for name, reason in formulation_problems(self.bodies, geometry.cell):
            place = ("bodies", name, "formulation")
            yield Problem(place, reason, self.bodies[name].formulation)
        second = any(body.formulation == "q2" for body in self.bodies.values())
        for index, contact in enumerate(self.contact):
            if trouble := contact.smoothing_problem(geometry.cell, 2 if second else 1):
                where = ("contact", index, "smoothing_angle")
                yield Problem(where, trouble, contact.smoothing_angle)

    def _surface_problems(self, geometry: GeneratedGeometry) -> Iterator[Problem]:
        named: list[tuple[Place, str]] = []
        masters = (*geometry.named_surfaces, *self.tools)
        for name in self.tools:
            if name in (*geometry.named_surfaces, *geometry.named_groups):
                yield Problem(("tools", name), "a surface of the mesh has this name already")
        for index, contact in enumerate(self.contact):
            if contact.slave not in self.tools:
                named.append((("contact", index, "slave"), contact.slave))
            if contact.master not in masters:
                what = "surface or tool" if self.tools else "surface"
                reason = f"no such {what}; {nearest(contact.master, masters)}"
                yield Problem(("contact", index, "master"), reason, contact.master)
        for index, boundary in enumerate(self.boundary):
            named.append((("boundary", index, "surface"), boundary.surface))
            if boundary.surface in geometry.named_groups:
                yield from boundary.group_problems(("boundary", index))
        for place, name in named:
            is_group = place[0] == "boundary" and name in geometry.named_groups
            if name not in geometry.named_surfaces and not is_group:
                known = "is a body" if name in self.bodies else "no such surface"
                reason = f"{known}; {nearest(name, geometry.named_surfaces)}"
                yield Problem(place, of_a_tool(name) if name in self.tools else reason, name)

    def _idle_film(self) -> str | None:
        """Why the sweep changes nothing, where it is one of a film that its law does not know."""
        assert self.sweep is not None
        first, _, rest = self.sweep.key.partition(".")
        number, _, rest = rest.partition(".")
        if first != "contact" or not rest.startswith("film") or not number.isdecimal():
            return None
        if int(number) >= len(self.contact):
            return None
        contact = self.contact[int(number)]
        if contact.acting_film is not None or contact.film is not contact.given_film:
            return None
        law = contact.friction.law
        return f'has no effect with law = "{law}": all runs would be the same; remove [sweep]'

    def _sweep_problems(self) -> Iterator[Problem]:
        """Each value must make a valid case, and a directory of its own."""
        assert self.sweep is not None
        if (idle := self._idle_film()) is not None:
            yield Problem(("sweep", "key"), idle, self.sweep.key)
            return
        labels = self.sweep.labels
        seen: dict[str, int] = {}  # by the case in full: comparing each with each takes minutes
        for index, (label, value) in enumerate(zip(labels, self.sweep.values, strict=True)):
            place = ("sweep", "values", index)
            if len(label.encode()) > LONGEST_LABEL:
                yield Problem(place, f"is too long for the name of a directory ({label[:40]}...)")
            if label in labels[:index]:
                yield Problem(place, "is in the list twice", value)
            try:
                data = self._swept_data(value)
                first = seen.setdefault(self._rebuilt(data).model_dump_json(), index)
                if first != index and label not in labels[:index]:  # in other units, say
                    yield Problem(place, f"is the same as sweep.values.{first}", value)
            except KeyPathError as error:
                yield Problem(("sweep", "key"), str(error), self.sweep.key)
                return
            except ValidationError as error:
                problem = problems_of(error, Case, data)[0]
                if not problem.place:  # An unknown key, which no value can cure.
                    yield Problem(("sweep", "key"), problem.reason, self.sweep.key)
                    return
                yield Problem(place, _seen_from(self.sweep.key, problem), value)


def of_a_tool(name: str) -> str:
    """Why a boundary cannot be that of a tool."""
    return f"is a tool; what moves it stands in [tools.{name}]"


def _seen_from(key: str, problem: Problem) -> str:
    """The reason of a problem in a swept case; with its place, if that is not the swept key."""
    return problem.reason if ".".join(map(str, problem.place)) == key else format_problem(problem)


def _name_problems(bodies: Mapping[str, Any], names: Sequence[str]) -> Iterator[Problem]:
    for name in bodies:
        if name not in names:
            yield Problem((name,), f"no such body; {nearest(name, names)}")
    for name in names:
        if name not in bodies:
            yield Problem((name,), f"missing; add [bodies.{name}] with its material")


def _rename_files(data: dict[str, Any], case: Case, files: Mapping[Path, str]) -> None:
    """Put other names for the files of a case into its data, those of a sweep's values too."""

    def renamed(value: Path | str) -> str:
        """A mesh, or a class in its file."""
        if isinstance(value, Path):
            return files.get(value, str(value))
        file, _, name = value.rpartition(":")
        return f"{files.get(Path(file), file)}:{name}"

    for (*tables, key), path in case.named_files():
        table: Any = data
        for one in tables:
            table = table[one]
        table[key] = renamed(table[key] if key == "class" else path)
    if case.sweep is not None and case.sweep.names_files:
        parts = [part for _, part in case.sweep_cases()]
        data["sweep"]["values"] = [renamed(value_at(part, case.sweep.key)) for part in parts]


def resolved_toml(case: Case, files: Mapping[Path, str] | None = None) -> str:
    """The case as a file, with every default and unit written out; it reads back to an equal case.

    With a sweep, keys that were not given are written as comments: the swept key may decide them,
    so that fixing them would make another case.
    """
    data = case.model_dump(mode="json", exclude_none=True)
    if files:
        _rename_files(data, case, files)
    given = case.model_dump(mode="json", exclude_unset=True) if case.sweep is not None else None
    return toml_text(data, given)


# -- What of a case was given, and not filled in by a default --------------------------------------


def given_keys(case: Case) -> list[str]:
    """Dotted keys that a case file gave, such as "contact.0.film.thickness", in its order."""
    return [key for key, _ in flat(case.model_dump(mode="json", exclude_unset=True))]
