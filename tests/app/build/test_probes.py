"""Places of probes in the mesh, and what is said of those that have none."""

import pytest
from mpi4py import MPI

from tribox.app.build.mesh import make_mesh
from tribox.app.build.model import displacement_on, resolved_bodies
from tribox.app.build.probes import place_probes
from tribox.app.case.reading import load_case
from tribox.app.errors import InputError


@pytest.fixture
def places(block, case_file):
    """Places of one probe in the small block: 1 mm wide from x = 0.5 mm on, and 0.5 mm high."""

    def find(probe, *overrides):
        path = case_file(f'{block}\n[[probe]]\nname = "here"\n{probe}')
        case = load_case(path, overrides)
        named = make_mesh(case, MPI.COMM_SELF)
        u = displacement_on(named, resolved_bodies(case.bodies, named))
        [found] = place_probes(case, named, u.function_space, "plane-strain")
        return found

    return find


def test_a_point_in_a_cell_and_one_between_four(places):
    inside = places("point = [0.85e-3, 0.25e-3]")
    assert inside.bodies == ("elastomer",) and inside.share.tolist() == [1.0]
    between = places("point = [0.8e-3, 0.2e-3]")
    assert between.share.tolist() == [0.25]
    assert between.found["elastomer"].point.tolist() == [0] * 4


def test_a_line_may_go_through_two_bodies(places):
    line = places("line = { from = [1.03e-3, 0.43e-3], to = [1.03e-3, -0.37e-3], points = 5 }")
    assert line.bodies == ("elastomer",) * 3 + ("aluminium",) * 2
    assert line.way == pytest.approx([0.0, 2e-4, 4e-4, 6e-4, 8e-4])
    assert line.place[3] == pytest.approx([1.03e-3, -0.17e-3])


def test_nodes(places):
    near = places('point = ["0.82 mm", "0.29 mm"]\nat = "node"')
    assert near.place[0] == pytest.approx([0.8e-3, 0.3e-3])
    # As near: (0.8, 0.3), (0.9, 0.3) and two below; the first is the leftmost and lowest.
    equal = places('point = ["0.85 mm", "0.25 mm"]\nat = "node"')
    assert equal.place[0] == pytest.approx([0.8e-3, 0.2e-3])
    second = places(
        'point = ["0.82 mm", "0.26 mm"]\nat = "node"',
        "bodies.elastomer.formulation=q2",
        "bodies.aluminium.formulation=q2",
    )
    assert second.place[0] == pytest.approx([0.8e-3, 0.25e-3])
    outside = places('point = ["1.7 mm", "0.5 mm"]\nat = "node"')
    assert outside.place[0] == pytest.approx([1.5e-3, 0.5e-3])
    assert outside.bodies == ("elastomer",)


@pytest.mark.parametrize("body", ["elastomer", "aluminium"])
def test_where_bodies_touch_one_is_chosen(places, body):
    for at in ("interpolated", "node"):
        found = places(f'point = [1e-3, 0]\nbody = "{body}"\nat = "{at}"')
        assert found.bodies == (body,)


@pytest.mark.parametrize(
    ("probe", "line"),
    [
        ('point = ["1.7 mm", "0.3 mm"]',
         "probe.0.point = [0.0017, 0.0003]: probe 'here': lies outside all bodies; the nearest "
         'is "elastomer", by 0.0002 m; it begins at (0.0015, 0.0003) m'),
        ('point = ["1 mm", "0.3 mm"]\nbody = "aluminium"',
         'lies outside the body "aluminium", by 0.0003 m; it begins at (0.001, 0) m'),
        ("point = [1e-3, 0]",
         "probe.0.point = [0.001, 0.0]: probe 'here': lies where elastomer and aluminium touch; "
         "choose one with body"),
        ('point = [0.8e-3, 0]\nat = "node"',
         "probe.0.point = [0.0008, 0.0]: nodes of elastomer and aluminium are equally near; "
         "choose one with body"),
        ("line = { from = [1e-3, 0.4e-3], to = [1e-3, 0.6e-3], points = 3 }",
         "probe.0.line: probe 'here': point 3 of 3, (0.001, 0.0006) m, lies outside all bodies"),
    ],
)  # fmt: skip
def test_places_that_are_none(places, probe, line):
    with pytest.raises(InputError) as told:
        places(probe)
    assert line in str(told.value)
