"""Mistakes in case files: one clear line for each."""

from pathlib import Path

import pytest

from tests.app.case.test_case import FILM_CASE, MAP
from tribox.app.case.reading import check_case, load_case
from tribox.app.errors import InputError

ROOT = Path(__file__).parents[3]


@pytest.fixture
def film(tmp_path: Path) -> Path:
    path = tmp_path / "film.toml"
    path.write_text(FILM_CASE)
    return path


DRIVEN = '{ surface = "bottom", displacement = { x = "driven" } }'
TWICE = '{ surface = "top", displacement = { x = 0 } }'

MISTAKES = [
    # keys
    ("contact.0.frction=3", 'unknown key "frction" in contact.0; did you mean "friction"?'),
    (f"{MAP}.viscosty=3", f'unknown key "viscosty" in {MAP}; did you mean "eta_b"?'),
    (f"{MAP}.mu=3", f'key "mu" in {MAP} does not go with law = "friction-map"'),
    ("contact.0.thickness=3", '"thickness" in contact.0; did you mean "film.thickness"?'),
    ("solvr.tolerance=1", 'unknown key "solvr"; did you mean "solver"?'),
    ("output.zzz=1", 'unknown key "zzz" in output; valid keys: fields_every, figures'),
    ("boundary.0.velocity.w=0", '"w" in boundary.0.velocity; valid keys: x, y, z'),
    ("bodies.elastomer.E=1", 'does not go with material = "mooney-rivlin"'),
    ("geometry.mesh=a.msh", 'key "mesh" in geometry does not go with kind = "two-blocks"'),
    ('bodies.elastomer={ material = "hencky" }', "give E and nu, or G and K; found none of them"),
    # values
    ("contact.0.film.thickness=-3 nm", 'contact.0.film.thickness = "-3 nm": must be >= 0 m'),
    ("contact.0.film.thickness=3 s", 'thickness = "3 s": "s" has the wrong dimension'),
    ("contact.0.film.thickness=3 nmm", 'unknown unit "nmm"'),
    ("contact.0.film.thickness=nan", "contact.0.film.thickness = nan: must be finite"),
    ("contact.0.film.thickness=thin", "must be a number (in m) or text with a unit"),
    ("bodies.aluminium.nu=0.5", "bodies.aluminium.nu = 0.5: must be > -1 and < 0.5"),
    ("bodies.aluminium.E=70 GPa m", '"GPa m" has the wrong dimension'),
    ("bodies.elastomer.C10=-1 MPa", "must be > 0 Pa (half the shear modulus)"),
    ("bodies.aluminium.material=steel", 'bodies.aluminium.material = "steel": must be one of'),
    ("bodies.aluminium.formulation=q3", 'formulation = "q3": must be "q1", "q1-sri" or "q2"'),
    ("bodies.aluminium={}", 'bodies.aluminium.material: missing; one of "neo-hookean", "hencky"'),
    ("bodies.elastomr.E=1", 'bodies.elastomr: no such body; did you mean "elastomer"?'),
    ("geometry={}", 'geometry.kind: missing; one of "two-blocks", "blocks"'),
    ("geometry.kind=spheres", 'geometry.kind = "spheres": must be one of'),
    ("geometry.upper.elements=[3]", "geometry.upper.elements.1: missing entry"),
    ("geometry.lower.elements=[3, 2.5]", "elements.1 = 2.5: must be a whole number"),
    ("geometry.lower.elements=[3, 0]", "elements.1 = 0: must be >= 1"),
    ("geometry.lower.grading=0", "geometry.lower.grading = 0: must be > 0"),
    ("contact.0.quadrature_degree=0", "quadrature_degree = 0: must be >= 1"),
    ("output.figures=1", "output.figures = 1: must be true or false"),
    ("title=3", "title = 3: must be text, in quotes"),
    ('stage.0.name=""', 'stage.0.name = "": must not be empty'),
    ("contact={}", "contact: must be an array of tables: write [[contact]]"),
    ("solver=3", "solver = 3: must be a table, { kind = ... }; its keys: kind,"),
    ("contact.0.friction=0.1", '= 0.1: must be a table, { law = "friction-map", ... }; kinds: '),
    ("boundary.0.displacement=1 mm",
     'displacement = "1 mm": must be a table, { x = ... }; its keys: x, y, z'),
    ("solver.petsc.mat=[1]", "solver.petsc.mat = [1]: must be text, a number, true or false"),
    ("solver.kind=explicit;bodies.elastomer.density=1e3",
     "bodies.aluminium.density: missing; explicit dynamics needs the mass of each body"),
    ("solver.damping=1", 'solver.damping: goes with kind = "explicit" only'),
    ("stage.0.solver=explicit", 'stage.0.solver = "explicit": needs solver.kind = "explicit"'),
    ("stage.0.relax=true", "stage.0.relax: goes with explicit stages only"),
    ("stage.0.ramp=1 ms", "stage.0.ramp = 0.001: goes with velocity or velocities only"),
    ("bodies.elastomer.velocity.x=1", "bodies.elastomer.velocity: goes with solver.kind = "),
    ("boundary.1.platen.mass=1 g", "boundary.1.platen.mass = 0.001: goes with solver.kind"),
    ("boundary.1.platen.pressure={ table = [[0, 1]], rmp = 1 }", 'pressure: unknown key "rmp"'),
    ("boundary.1.platen.pressure={ ramp = 'smooth' }", "pressure.table: must be [[time, value]"),
    ("boundary.1.platen.pressure={ table = [[0, '1 m']] }", 'table.0.1 = "1 m": "m" has the wrong'),
    ("boundary.1.platen.pressure={ table = [[0, 1]], ramp = 'cos' }",
     'pressure.ramp = "cos": must be "linear" or "smooth"'),
    ("boundary.1.spring={ direction = 'x', stiffness = 1, end = 0 }",
     '"top" is already moved in x by boundary.1.displacement.x'),
    ("boundary.1.spring={ direction = 'x', end = 0 }", "boundary.1.spring.stiffness: missing"),
    ("solver.tolerance=0", "solver.tolerance = 0: must be > 0 and < 1"),
    ("boundary.1.platen.pressure=[[0, 1], [0, 2]]", "pressure.1.0 = 0: the time must increase"),
    ("boundary.1.platen.pressure=[[0, 1], [1]]", "pressure.1 = [1]: must be a pair [time, value]"),
    ("boundary.1.platen.pressure=[[0, '1 m']]", 'pressure.0.1 = "1 m": "m" has the wrong'),
    ("boundary.1.displacement.x=drivn", '[[time, value], ...], or "driven"'),
    # geometry
    ("geometry.upper.elements=[3, 2]", "geometry.upper: give either elements or size"),
    ('geometry.lower={ width = 1, height = 1 }', "geometry.lower: give either elements or size"),
    ("geometry.offset=2 mm", "geometry.offset = 0.002: must lie between -0.001 m and 0.002 m"),
    ("geometry.upper.size=1e-12", "geometry: elastomer: size = 1e-12 m is too small"),
    # film and law
    (f"{MAP}.eta_b=0", f"{MAP}.eta_b = 0.0: a film thicker than D_min (3e-08 m > 0 m) needs"),
    (f"{MAP}.beta=1", f"{MAP}: give either alpha or beta, found both"),
    (f'{MAP}={{ preset = "friction-map", mu_s = 0.1, K_T = 1 }}', "or gamma, found neither"),
    (f"{MAP}.gamma=1e-25", f"{MAP}: give either V_star (with V_star_at) or gamma, found both"),
    (f"{MAP}.D_max=0.0 nm", 'D_max = "0.0 nm": must be > 0 m'),
    (f"{MAP}.D_min=250 nm", f"{MAP}.D_max = 2.5e-07: must be > D_min = 2.5e-07 m"),
    (f"{MAP}.mu_d=0.2", f"{MAP}.mu_d = 0.2: must be <= mu_s = 0.12"),
    (f"{MAP}.alpha=[['10 nm', 0.1], ['10 nm', 0.2]]", "alpha.1.0 = \"10 nm\": the film thickness"),
    (f"{MAP}.alpha=1.5", f"{MAP}.alpha = 1.5: must be >= 0 and <= 1"),
    (f"{MAP}.preset=paper", f'{MAP}.preset = "paper": must be "paper-printed", "paper-swapped"'),
    (f"{MAP}.law=stribek", f'{MAP}.law = "stribek": must be one of "friction-map", "coulomb"'),
    ('contact.0.friction={ law = "coulomb" }', f"{MAP}.mu: missing; coefficient of friction"),
    (f'{MAP}={{ law = "friction-map", mu_s = 0.1, D_max = 1 }}',
     f"{MAP}.K_T: missing; tangential stiffness of the asperities, in Pa/m"),
    # surfaces
    ("contact.0.master=elastomer_contact", "contact.0.master = \"elastomer_contact\": must differ"),
    ("contact.0.slave=elastomer_contct", 'no such surface; did you mean "elastomer_contact"?'),
    ("contact.0.slave=elastomer", '"elastomer": is a body; did you mean "elastomer_'),
    ("boundary.1.surface=zzz", 'boundary.1.surface = "zzz": no such surface; there are'),
    ("bodies.aluminium.formulation=q1-sri;geometry.cell=triangle", '"q1-sri" needs quadrilaterals'),
    ("contact.0.penalty=1e13 Pa/m;contact.0.penalty_factor=10", "either penalty or penalty_factor"),
    # boundaries
    ('boundary.0={ surface = "bottom" }', "boundary.0: does nothing; give displacement"),
    ("boundary.0.displacement={}", "boundary.0: does nothing"),
    (f"boundary=[{TWICE}, {TWICE}, {DRIVEN}]",
     '"top" is already moved in x by boundary.0.displacement.x'),
    ("boundary.1.velocity.x=1", "boundary.1.velocity.x: \"top\" is already moved in x"),
    ("boundary.1.displacement.y=0", "boundary.1.platen.direction: \"top\" is already moved in y"),
    ("boundary.1.platen.force=1 N", "boundary.1.platen: give either pressure or force, found both"),
    ('boundary.1.platen={ direction = "y" }', "pressure or force, found neither"),
    # stages
    ('stage.0={ name = "a" }', "stage.0: give either duration (with steps) or velocities"),
    ("stage.1.velocities=[1e-8, 0]", "stage.1.velocities.1 = 0: must not be 0"),
    ("stage.1.velocities=[1e-8, inf]", "stage.1.velocities.1 = inf: must be finite"),
    ("stage.1.velocities=[]", "stage.1.velocities = []: must hold at least one velocity"),
    ("stage.1.duration=1 s", "stage.1.duration: does not go with velocities"),
    ("stage.1.min_steps=300", "stage.1.max_steps = 200: must be >= min_steps = 300"),
    ("stage.0.slip_step=1 um", "stage.0.slip_step: goes with velocities only"),
    ('stage.1={ name = "b", velocities = [1] }', "stage.1.slip_step: missing"),
    ("stage.1.name=press", 'stage.1.name = "press": two stages have this name'),
    ("boundary.1.displacement.x=0", "stage.1.velocities: moves nothing: no boundary has"),
    ('stage=[{ name = "a", duration = 1 }]', "boundary.1.displacement.x = \"driven\": never moves"),
    # sweeps
    ('sweep={ key = "contact.0.film.thicknes", values = [1] }',
     'sweep.key = "contact.0.film.thicknes": unknown key "thicknes" in contact.0.film; did you'),
    ('sweep={ key = "contact.1.mu", values = [1] }', 'contact has no entry "1"; entries are'),
    ('sweep={ key = "title.a", values = [1] }', "sweep.key = \"title.a\": title is no table"),
    ('sweep={ key = "a b", values = [1] }', 'sweep.key = "a b": not a dotted key'),
    ('sweep={ key = "contact.0.film.thickness", values = ["1 nm", "2 nm", "0.001 um"] }',
     'sweep.values.2 = "0.001 um": is the same as sweep.values.0'),
    ('sweep={ key = "contact.0.film.thickness", values = ["1 nm", "-3 nm"] }',
     'sweep.values.1 = "-3 nm": must be >= 0 m'),
    ('sweep={ key = "contact.0.friction.mu_s", values = [0.05] }',
     f"sweep.values.0 = 0.05: {MAP}.mu_d = 0.1: must be <= mu_s = 0.05"),
    ('sweep={ key = "contact.0.film.thickness", values = ["1 nm", "1  nm"] }',
     'sweep.values.1 = "1  nm": is in the list twice'),
    ('sweep={ key = "contact.0.film.thickness", values = [] }', "must have at least 1 entry"),
    # overrides
    ("contact.7.slave=a", '"contact.7.slave=a": contact has no entry "7"'),
    ("stage.0", '"stage.0": an override is written key=value'),
    ("bodies.rubber pad.nu=3", "not a dotted key such as contact.0.film.thickness, or bodies.'"),
]  # fmt: skip


@pytest.mark.parametrize(("overrides", "expected"), MISTAKES, ids=[m[0] for m in MISTAKES])
def test_a_mistake_gives_one_clear_line(film, overrides, expected):
    with pytest.raises(InputError) as error:
        load_case(film, overrides.split(";"))
    message = str(error.value)
    assert expected in message
    assert "\n" not in message and "pydantic" not in message and len(message) < 300
    lines = check_case(film, overrides.split(";"))
    assert message == lines[0], "each of these cases has exactly one mistake"
    assert len(lines) == 1


def test_the_example_errors_of_the_documentation(film):
    shown = (ROOT / "docs" / "case-file.md").read_text().replace("cases/x.toml", str(film))
    for override in ("contact.0.film.thickness=-3 nm", f"{MAP}.viscosty=3"):
        [line] = check_case(film, [override])
        assert line in shown


def test_several_mistakes_are_counted_and_listed(film):
    overrides = ["contact.0.film.thickness=-3 nm", "stage.0.steps=0", "output.figurs=true"]
    lines = check_case(film, overrides)
    assert [line.removeprefix(f"{film}: ") for line in lines] == [
        'unknown key "figurs" in output; did you mean "figures"?',
        'contact.0.film.thickness = "-3 nm": must be >= 0 m',
        "stage.0.steps = 0: must be >= 1",
    ]
    with pytest.raises(InputError) as error:
        load_case(film, overrides)
    assert str(error.value) == f"{lines[0]} (and 2 more; tribox check lists them)"
    assert check_case(film) == []


def test_a_missing_body(film):
    film.write_text(FILM_CASE.replace("\naluminium = ", "\naluminum = "))
    lines = check_case(film)
    assert lines[0].endswith('bodies.aluminum: no such body; did you mean "aluminium"?')
    assert "bodies.aluminium: missing" in lines[1]


NOT_TOML = {
    'E = "5 MPa"': [("E = 5 MPa", 'a value with a unit stands in quotes: E = "5 MPa"'),
     ("E = 5*10**6", "no sums")],
    'width = "1.0 mm"': [("width = 1.0 mm", 'in quotes: width = "1.0 mm"')],
    'law = "coulomb"': [("law = coulomb", 'text stands in quotes: law = "coulomb"'),
     ('law = "coulomb', "the quote is not closed"), ("law = “coulomb”", "quotes are straight")],
    "figures = false": [("figures = False", "write figures = false"),
     ("figures = no", "write figures = false"), ("figures = None", "leave figures out")],
    "mu = 0.2": [("mu = 0,2", "decimals stand behind a point: 0.2"),
     ("mu = .2", "a digit stands before the point too: 0.2"),
     ("mu = 2.", "a digit stands behind the point too: 2.0"),
     ("mu: 0.2", "have = between them: mu ="), ("mu 0.2", "have = between them: mu ="),
     ("mu =", "mu has no value"), ("mu = 0.2;", "without a semicolon"),
     ("mu = 0.2 // friction", "comments begin with #"),
     ("mu = 0.2\nmu = 0.3", "mu stands there twice"), ("µ = 0.2", "a key consists of letters")],
    "[bodies.aluminium]": [("[bodies.aluminium", "the bracket is not closed: [bodies.aluminium]"),
     ("[bodies.my plate]", 'in quotes: [bodies."my plate"]'),
     ("[bodies.elastomer]", "there is a table [bodies.elastomer] already")],
    '[[boundary]]\nsurface = "top"': [('[[boundary]\nsurface = "top"', "closed: [[boundary]]")],
    "{ x = 0, y = 0 }": [("{ x = 0,\n y = 0 }", "a table in braces stands on one line")],
    '"-0.05 mm"]]': [('"-0.05 mm"]', "a list above is not closed with ]")],
    'title = "small block"': [('title = "C:\\users"', "write / in paths")],
}  # fmt: skip


@pytest.mark.parametrize(
    ("old", "new", "said"), [(old, *one) for old, those in NOT_TOML.items() for one in those]
)
def test_what_is_no_toml_gets_the_likely_cure(block, tmp_path, old, new, said):
    path = tmp_path / "case.toml"
    assert old in block
    path.write_text(block.replace(old, new, 1), encoding="utf-8")
    [line] = check_case(path)
    assert ": not valid TOML: " in line and said in line


def test_tables_of_which_there_are_several(block, tmp_path):
    path = tmp_path / "case.toml"
    path.write_text(block.replace("[[stage]]", "[stage]"))
    assert "headed [[stage]]" in check_case(path)[0]


def test_files_that_cannot_be_read(tmp_path):
    gone = tmp_path / "gone.toml"
    assert check_case(gone) == [f"{gone}: no such file"]
    assert check_case(tmp_path)[0].startswith(f"{tmp_path}: cannot be read (")
    binary = tmp_path / "binary.toml"
    binary.write_bytes(b"a\n\xff\xfe\x00")
    assert check_case(binary) == [
        f"{binary}: not a text file in UTF-8: byte 2 (line 2) is 0xff; save it as UTF-8 in the "
        "editor"
    ]
    broken = tmp_path / "broken.toml"
    broken.write_text('title = "a"\nsteps = = 3\n')
    [line] = check_case(broken)
    assert line.startswith(f"{broken}:2: not valid TOML: ") and ".toml, is" not in line
    deck = tmp_path / "part.inp"
    deck.write_text("*NODE\n1, 0.0, 0.0\n")
    assert "a case file, ending in .toml, is asked for" in check_case(deck)[0]
    with pytest.raises(InputError) as error:
        load_case(gone)
    assert error.value.exit_code == 2
