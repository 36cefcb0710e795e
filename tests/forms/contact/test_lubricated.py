"""A contact whose film is an unknown: its tangent, and what does not depend on the frame."""

from dataclasses import replace

import numpy as np
import pytest

from tests import contact_boxes
from tests.contact_boxes import unknowns_of
from tests.forms.contact import test_tool
from tests.forms.contact.test_tool import Rectangle, Scene, TwoBlocks, generate
from tests.laws import coulomb
from tribox.forms.contact.asperities import FilmModel
from tribox.forms.contact.lubricated import LubricatedTerm
from tribox.forms.contact.state import ContactMode
from tribox.forms.film.reynolds import FilmError, ReynoldsFilm, wedge_film
from tribox.forms.film.roughness import Exponential, RoughGap
from tribox.forms.friction.film_rheology import FilmRheology
from tribox.forms.friction.friction_map import FrictionMap
from tribox.forms.friction.parameters import FrictionMapParameters
from tribox.geometry.surfaces.rigid_polyline import Polyline
from tribox.geometry.surfaces.rigid_shapes import Circle

SIGMA = 0.01
PRESSED = ContactMode(rate_dependent=False)
COULOMB = coulomb(0.3, 25.0)
MAP = FrictionMap(
    FrictionMapParameters(
        mu_s=0.3, K_T=25.0, eta_b=1e-2, D_max=6 * SIGMA, beta=1.0, V_star=1e3, V_star_at=SIGMA
    )
)


def film_model(**changes):
    oil = FilmRheology(
        eta_b=1e-2, barus=0.1, critical_rate=1.0, thinning_exponent=0.7, eta_inf=1e-4
    )
    values = {"rough": RoughGap(SIGMA), "asperities": Exponential(1.0, SIGMA), "rheology": oil}
    values |= {"share": "contact", "oil": np.inf, "reach": 0.3, "steady": True, "scale": 1.0}
    return FilmModel(**{**values, **changes})


class Lubricated(Scene):
    """The scene of a tool with a film on it."""

    def __init__(self, law=COULOMB, shape=None, **changes):
        super().__init__(shape=shape)
        self.term = LubricatedTerm(self.term.surface, law, film_model(**changes), 3.0)


KINDS = {
    "steady": {}, "flooded": {"steady": False}, "given oil": {"steady": False, "oil": 0.02},
    "steady oil": {"oil": 0.035}, "map": {"share": "map", "law": MAP}, "three cells": {"cells": 3},
    "three cells with given oil": {"cells": 3, "steady": False, "oil": 0.02},
}  # fmt: skip


def slid(scene, down=-0.03, along=-0.04, close=0.002):
    """Unknowns after a step in which the tool slid, turned and closed; that before is committed."""
    first = scene.unknowns(1, 0.001, tool=0.0, theta=0.0)
    first[unknowns_of(scene.tool, 2)[1]] = down
    scene.term.commit(scene.term.evaluate(scene.vector(first), 1.0, PRESSED))
    x = first + scene.unknowns(2, 0.0005, tool=0.0, theta=0.003)
    x[unknowns_of(scene.tool, 2)[:2]] = along, down + close
    return x


@pytest.mark.parametrize("shape", ["circle", "corner"])
@pytest.mark.parametrize("kind", KINDS)
def test_the_tangent_is_that_of_differences(kind, shape):
    def corner(low):
        return Polyline(low + np.array([[-1.0, -0.12], [0.55, 0.02], [2.0, -0.14]]))

    scene = Lubricated(shape=None if shape == "circle" else corner, **KINDS[kind])
    x = slid(scene)
    trial = scene.residual(x)[1]
    film = trial.normal_contact.lubrication
    assert film.solution is not None
    assert film.pressure.max() > 0.01 * film.asperity.max()
    assert np.count_nonzero(trial.kinematics.closed) > 3
    assert scene.error(x, step=1e-7) < 1e-6


@pytest.mark.parametrize("steady", [True, False])
def test_the_tangent_over_a_smooth_master_beside_planes_of_symmetry(steady):
    held = contact_boxes.held_ends("Q4", 2, fine=True)
    options = {"fine": True, "degree": 5, "smoothing_angle": 0.5, "held": held}
    scene = contact_boxes.Scene("Q4", COULOMB, master=2, **options)
    assert scene.surface.images is not None
    scene.term = LubricatedTerm(scene.surface, COULOMB, film_model(steady=steady), 3.0)
    before = scene.vector([0.01, -0.03], 0.004, 0.9)
    x = scene.vector([0.03, -0.031], 0.005, 0.8, 0.0005)
    free = np.ones(scene.size)
    free[2 * held[0]] = before.array[2 * held[0]] = x.array[2 * held[0]] = 0.0
    scene.term.commit(scene.term.evaluate(before, 1.0, PRESSED))
    film = scene.residual(x)[1].normal_contact.lubrication
    assert film.pressure.max() > 0.005 and film.asperity.max() > 0.1
    assert scene.error(x, steps=(1e-6, 1e-7), free=free) < 1e-9


def test_gaps_of_vertices_are_those_at_the_vertices():
    """Those of parabolas too; the pressure of a vertex moves no other, and even ones stay even."""
    scene = Lubricated()
    surface, rule = scene.term.surface, scene.term.rule
    vertices, weight = surface.vertices, surface.slave.weight
    assert np.allclose(rule.spread.sum(axis=1), 1.0, rtol=0, atol=1e-13)
    for vertex in range(vertices.count):
        hat = np.where(vertices.of_point == vertex, vertices.shape, 0.0).sum(axis=1)
        expected = np.where(np.arange(vertices.count) == vertex, vertices.area[vertex], 0.0)
        assert vertices.sums(weight * hat, rule.spread) == pytest.approx(expected, abs=1e-13)
    bent, at = surface.slave.position[:, 0] ** 2, vertices.position[:, 0] ** 2
    assert vertices.sums(weight * bent, rule.shape) == pytest.approx(vertices.area * at)


@pytest.mark.parametrize("ratio", [2.0, 4.0])
def test_a_slider_round_a_cylinder_is_a_plane_one_whatever_its_facets(ratio, monkeypatch):
    """Half of its facets are longer by ``ratio``, and their sagitta is of the order of the film.

    The film falls from 2 h to h, and p = 6 η U L/h² (1/H − 2/(3 H²) − 1/3).
    """
    count, radius, least, eta, turned = 40, 0.82, 2e-4, 1e-2, 1e-3
    ends = np.cumsum(np.repeat([0.0, 1.0, ratio], [1, count // 2, count // 2]))
    ends /= ends[-1]

    def graded(shape, comm):
        named = generate(shape, comm)
        x = named.mesh.geometry.x
        x[:, 0] = np.interp(x[:, 0], np.linspace(0.0, 1.0, count + 1), ends)
        return named

    monkeypatch.setitem(test_tool.MESHES, 2, TwoBlocks(*[Rectangle(1.0, 0.5, (count, 1))] * 2))
    monkeypatch.setattr(test_tool, "generate", graded)
    scene = Lubricated(
        shape=lambda low: Circle(low + np.array([0.3, -1.3]), radius),  # it turns about its centre
        rough=RoughGap(0.0),
        asperities=Exponential(1e-30, SIGMA),
        rheology=FilmRheology(eta_b=eta),
        cells=4,
    )
    vertices, film = scene.term.surface.vertices, least * (2.0 - ends)
    angle, x = 2.0 - ends / radius, np.zeros((scene.size // 2, 2))
    radial = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    x[vertices.nodes] = scene.centre + (radius + film)[:, None] * radial - vertices.position
    x = x.reshape(-1)
    scene.term.commit(scene.term.evaluate(scene.vector(x), 1.0, PRESSED))
    x[unknowns_of(scene.tool, 2)[2]] = -turned * scene.motion.length
    found = scene.term.evaluate(scene.vector(x), 1.0).normal_contact.lubrication
    assert found.film == pytest.approx(film, rel=1e-3)
    wide, scale = film / least, 6.0 * eta * turned * radius / least**2
    exact = scale * (1.0 / wide - 2.0 / (3.0 * wide**2) - 1.0 / 3.0)
    assert found.solution.pressure[: count + 1] == pytest.approx(exact, abs=3e-3 * exact.max())
    load = scale * (np.log(2.0) - 2.0 / 3.0)
    assert scene.term.surface.vertices.area @ (found.ratio * found.pressure) == pytest.approx(
        load, rel=5e-3
    )


@pytest.mark.parametrize("angle", [0.05, 0.2])
def test_a_turning_tool_rubs_over_its_arc(angle):
    scene = Lubricated()
    scene.motion = scene.term.surface.master.motion
    x = scene.unknowns(1, 0.0, tool=0.0, theta=0.0)
    tool = unknowns_of(scene.tool, 2)
    x[tool[1]] = -0.03
    # The tool turns about the centre of its circle: that moves with the centre of the motion.
    arm = scene.surface.centre - scene.centre
    scene.term.commit(scene.term.evaluate(scene.vector(x), 1.0, PRESSED))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    x[tool[:2]] += arm - turn @ arm
    x[tool[2]] = angle * scene.motion.length
    trial = scene.residual(x)[1]
    slip = np.linalg.norm(trial.kinematics.slip, axis=1)[trial.kinematics.closed]
    assert len(slip) > 3
    assert slip == pytest.approx(0.82 * angle, rel=1e-2 * angle**2)


@pytest.mark.parametrize("kind", ["flooded", "three cells with given oil"])
def test_the_film_gives_off_what_its_flow_does(kind):
    scene = Lubricated(**KINDS[kind])
    trial = scene.residual(slid(scene, close=0.0))[1]
    film, slip = trial.normal_contact.lubrication, trial.kinematics.slip
    cells, found, step = film.solver.cells, film.solution, film.step
    a, b = cells.ends.T
    rise = found.pressure[b] - found.pressure[a]
    # What shear carries against the pressure is what pressure lets flow: their sum is constant.
    sheared = step.speed * wedge_film(step.film[cells.ends])[0] * rise
    drawn = np.einsum("qi,qi->q", film.along, slip) * film.pulled[scene.term.rule.facet_of]
    ratio = scene.term.state.area_ratio
    work = 0.5 * film.sign * np.sum(scene.term.surface.slave.weight * ratio * drawn)
    assert abs(work) > 0.0
    assert work == pytest.approx(np.sum(sheared) * trial.dt, rel=1e-9)


@pytest.mark.parametrize("share", ["contact", "map"])
def test_places_that_all_oil_has_left_have_a_tangent_too(share):
    """Where the gap has sheared them dry, as behind a contact, θ comes to exactly 0."""
    scene = Lubricated(MAP if share == "map" else COULOMB, share=share, steady=False, oil=0.02)
    x = slid(scene)
    history = scene.term.state.film
    scene.term.state.film = replace(history, volume=np.zeros_like(history.volume))
    film = scene.residual(x)[1].normal_contact.lubrication
    assert np.abs(film.filled[film.members]).min() == 0.0
    assert scene.error(x) < 1e-6


def test_a_film_without_a_solution_is_known_as_such(monkeypatch):
    def unsolved(*_):
        raise FilmError

    scene = Lubricated()
    x = slid(scene)
    assert not scene.residual(x)[1].normal_contact.lubrication.is_unsolved
    monkeypatch.setattr(ReynoldsFilm, "solve", unsolved)
    force, trial = scene.residual(1.0001 * x)
    assert trial.normal_contact.lubrication.is_unsolved
    assert not np.isfinite(force).all()
