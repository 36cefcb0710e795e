"""One slave over two masters that meet below it, against one master in their place."""

import tomllib
from functools import lru_cache

import numpy as np
import pytest
from mpi4py import MPI

from tests.rectangles import Rectangle, Rectangles
from tests.solved import Cuts
from tribox.app.build.model import build_model
from tribox.app.case.case import Case
from tribox.app.results.contact_points import contact_nodes
from tribox.app.simulation.run_state import Observer
from tribox.app.simulation.simulation import Simulation
from tribox.app.simulation.surface_ends import LeftMaster
from tribox.geometry.meshes.gmsh_model import write_msh

PAD = Rectangle(-1e-3, 0.0, 1e-3, 0.5e-3, (10, 3))
COEFFICIENT = 0.3
FRICTION = f'{{ law = "coulomb", mu = {COEFFICIENT}, K_T = "1e12 Pa/m" }}'
MAP = (
    '{ law = "friction-map", mu_s = 0.3, mu_d = 0.1, A_d = "0.1 mm", B = 5000, K_T = "1e12 Pa/m", '
    'D_max = "1 um", alpha = 0, V_star = "1 m/s", V_star_at = "1 nm" }, film = { thickness = 0'
)
CASE = """
geometry = {{ mesh = "{mesh}" }}
contact = [{contacts}]
boundary = [
  {{ surface = "pad_top", displacement = {{ x = {along}, y = {down} }} }},
{holds}
]
stage = [{{ name = "press", duration = "1 s", steps = 2 }},
         {{ name = "slide", duration = "1 s", steps = {steps} }}]
[bodies]
pad = {{ material = "neo-hookean", E = "5 MPa", nu = {nu} }}
{bodies}
"""


def case_of(directory, dies, steps=2, slide=0.0, nu=0.0, friction=FRICTION):
    """A pad over dies, (left, right) in mm each."""
    bodies = {"pad": PAD}
    for number, (left, right) in enumerate(dies):
        cells = (max(int(8 * (right - left)), 2), 2)
        bodies[f"die{number}"] = Rectangle(1e-3 * left, -0.4e-3, 1e-3 * right, 0.0, cells)
    mesh = directory / "mesh.msh"
    write_msh(Rectangles(bodies), mesh)
    numbers = range(len(dies))
    contact = '{{ slave = "pad_bottom", master = "die{}_top", friction = {} }}'
    friction = friction if friction.endswith("}") else friction + " }"
    text = CASE.format(
        mesh=mesh,
        contacts=", ".join(contact.format(n, friction) for n in numbers),
        holds=",\n".join(
            f'{{ surface = "die{n}_bottom", displacement = {{ x = 0, y = 0 }} }}' for n in numbers
        ),
        bodies="\n".join(
            f'die{n} = {{ material = "hencky", E = "7000 GPa", nu = 0.3 }}' for n in numbers
        ),
        along=f'[["1 s", 0], ["2 s", "{slide} mm"]]',
        down='[["0 s", 0], ["1 s", "-0.05 mm"]]',
        steps=steps,
        nu=nu,
    )
    return Case.model_validate(tomllib.loads(text))


def solved(*arguments, **options):
    simulation = Simulation(build_model(case_of(*arguments, **options), MPI.COMM_SELF))
    cuts = Cuts()
    simulation.run(cuts)
    return simulation, cuts.count


@pytest.fixture(scope="module")
def scratch(tmp_path_factory):
    return tmp_path_factory.mktemp("dies")


@pytest.mark.parametrize("junction", [0.0, 0.03])
def test_a_uniform_pressure_has_no_dip_at_the_junction(scratch, junction):
    """At a vertex of the slave and near one; N by hand from a bar."""
    simulation = solved(scratch, [(-1.3, junction), (junction, 1.3)])[0]
    values = contact_nodes(simulation.model)
    first, second = (values["pressure"][values["pair"] == pair] for pair in (0, 1))
    pressure = first + second
    assert first[0] > 0.0 == first[-1] and second[0] == 0.0 < second[-1]
    K = float(simulation.model.problem.contacts[0].penalty[5])
    # P = G (1/λ − λ) of the bar, in a row with the penalty of its inner vertices.
    low, high = 0.9, 1.0
    for _ in range(100):
        stretch = 0.5 * (low + high)
        p = 2.5e6 * (1.0 / stretch - stretch)
        low, high = (stretch, high) if 0.5e-3 * (1 - stretch) + p / K > 0.05e-3 else (low, stretch)
    assert np.abs(pressure / p - 1.0).max() < 2e-3
    assert simulation.rows[-1].normal_force == pytest.approx(p * 2e-3, rel=5e-4)
    assert simulation.rows[-1].contact_area == pytest.approx(2e-3, rel=1e-6)


@lru_cache
def sliding(directory, junction, friction=FRICTION):
    dies = [(-1.3, 1.9)] if junction is None else [(-1.3, junction), (junction, 1.9)]
    return solved(directory, dies, steps=24, slide=0.55, nu=0.3, friction=friction)


def test_points_that_pass_bring_their_friction_along(scratch):
    """Forces, work and energies are those of one master, row by row."""
    (two, cuts), (one, _) = (sliding(scratch, at, MAP) for at in (0.13, None))
    assert cuts == 0
    for name, allowed in (
        ("normal_force", 2e-3),
        ("friction_force", 5e-3),
        ("mu", 5e-3),
        ("contact_area", 1e-6),  # the dies bulge into each other
        ("stick_fraction", 0.05),
        ("dissipation", 5e-3),
        ("interface_energy", 0.02),  # mean gaps of the divided facets are each their own
        ("strain_energy", 5e-3),
    ):
        ours, theirs = (np.array([getattr(row, name) for row in s.rows]) for s in (two, one))
        assert np.abs(ours - theirs).max() <= allowed * np.abs(theirs).max(), name
    assert two.rows[-1].friction_coefficient == pytest.approx(two.rows[-1].mu, rel=1e-6)
    assert abs(two.rows[-1].energy_error) < 0.01 * two.rows[-1].external_work
    forces = [row["normal_force"] for row in two.state.last_of_pairs()]
    assert all(force > 0.0 for force in forces)
    assert sum(forces) == pytest.approx(two.rows[-1].normal_force, rel=1e-12)


def test_what_another_master_carries_has_not_run_off(scratch):
    """Over the junction nothing is lost; over a gap of 0.4 mm between the dies it is."""
    for gap, said in ((0.0, 0), (0.4, 1)):
        dies = [(-1.3, 0.13), (0.13 + gap, 1.9)]
        model = build_model(case_of(scratch, dies, steps=8, slide=0.55), MPI.COMM_SELF)
        simulation, watch = Simulation(model), LeftMaster(model)

        class Watching(Observer):
            def step(self, state, row, result, watch=watch):
                watch.step(row)

        simulation.run(Watching())
        lines = list(watch.warnings())
        assert len(lines) == said, lines
