"""The patch test: a uniform pressure through a flat interface of meshes that do not match."""

import pytest

from benchmarks.patch import SLAVE, Patch, errors

ALLOWED = 0.01
MISMATCHES = (14, 20, 24, 26, 28, 30)  # facets under the 31 of the slave


@pytest.fixture(scope="module")
def scratch(tmp_path_factory):
    return tmp_path_factory.mktemp("patch")


def test_matching_meshes_carry_the_pressure_exactly(scratch):
    """Within the tolerance of the solver, that is, and with one point per facet as with many."""
    for options in ((), ("contact.0.quadrature_degree=1",)):
        found = errors(Patch(SLAVE, SLAVE), scratch, *options)
        assert max(found.near, found.far) < 1e-7


@pytest.mark.parametrize(("cell", "stiffness"), [("quadrilateral", 70e3), ("triangle", 5.0)])
def test_default_quadrature_carries_the_pressure_through_any_finer_slave(cell, stiffness, scratch):
    for count in MISMATCHES:
        found = errors(Patch(SLAVE, count, cell=cell, stiffness=stiffness), scratch)
        assert found.near < ALLOWED, (count, found)
        assert found.far < 0.5 * ALLOWED, (count, found)
        assert found.near > 1e-5  # the meshes differ: an error there must be


def test_default_quadrature_does_so_with_the_stiff_side_as_slave(scratch):
    for count in MISMATCHES:
        found = errors(Patch(count, SLAVE, slave="aluminium"), scratch)
        assert found.near < ALLOWED, (count, found)


def test_a_point_on_a_node_of_a_soft_master_ends_on_one_side(scratch):
    """The middle one of five points on the middle one of seven facets is there for ever."""
    found = errors(Patch(7, 10, stiffness=5.0), scratch, "contact.0.quadrature_degree=9")
    assert found.near < ALLOWED


def test_error_falls_with_the_number_of_points(scratch):
    worst = [
        max(
            errors(Patch(SLAVE, count), scratch, f"contact.0.quadrature_degree={degree}").near
            for count in (24, 26, 28)
        )
        for degree in (1, 5, 15)
    ]
    assert worst[0] > 3.0 * worst[1] > 6.0 * worst[2]


def test_a_slave_much_coarser_than_the_master_fails_with_few_points(scratch):
    """Master nodes between the points of a slave facet carry nothing."""
    found = errors(Patch(SLAVE, 77), scratch, "contact.0.quadrature_degree=3")
    assert found.near > 0.1


def test_friction_does_no_harm_where_nothing_can_slip(scratch):
    option = 'contact.0.friction={ law = "coulomb", mu = 0.3 }'
    stuck = errors(Patch(SLAVE, 24, stiffness=5.0), scratch, option)
    assert stuck.near < ALLOWED and stuck.far < 0.5 * ALLOWED
