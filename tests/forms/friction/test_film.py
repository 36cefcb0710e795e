"""Film thickness: a number, a table over the pressure, a field."""

import numpy as np
import pytest

from tribox.forms.friction.film import ConstantFilm, FilmField, FilmTable, film_thickness

TABLE = FilmTable(((0.0, 60e-9), (1e6, 40e-9), (4e6, 10e-9)))


def test_the_slope_of_the_table_is_that_of_its_values():
    pressure = np.random.default_rng(0).uniform(0.0, 6e6, 1000)
    thickness, slope = TABLE.at(pressure)
    assert (np.diff(thickness[np.argsort(pressure)]) <= 0.0).all()
    h = 1.0
    away = np.min(np.abs(pressure[:, None] - [0.0, 1e6, 4e6]), axis=1) > 2 * h
    difference = (TABLE.at(pressure + h)[0] - TABLE.at(pressure - h)[0]) / (2 * h)
    np.testing.assert_allclose(slope[away], difference[away], rtol=1e-7, atol=1e-22)
    assert away.sum() > 900 and TABLE.at(np.array([9e6]))[0][0] == 10e-9
    # At a row: the slope towards higher pressures.
    np.testing.assert_allclose(TABLE.at(np.array([0.0, 1e6, 4e6]))[1], [-2e-14, -1e-14, 0.0])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ConstantFilm(-1e-9), r"film thickness = -1e-09 m is not allowed"),
        (lambda: film_thickness(float("nan")), "film thickness = nan m"),
        (lambda: FilmTable(()), "at least one row"),
        (lambda: FilmTable(((1.0, 1e-9), (1.0, 2e-9))), "that rise"),
        (lambda: FilmTable(((0.0, 1e-9), (1.0, -2e-9))), "-2e-09 m"),
        (lambda: FilmField(np.ones(3)).at(np.zeros(4)), "3 thicknesses for 4 contact points"),
    ],
)
def test_what_is_no_film_is_refused_in_one_line(make, message):
    with pytest.raises(ValueError, match=message) as error:
        make()
    assert "\n" not in str(error.value)
