"""Which keys of a case were given."""

from __future__ import annotations

import tomllib

from tribox.app.case.case import Case, given_keys, resolved_toml
from tribox.app.case.reading import load_case


def test_given_keys_are_those_of_the_file(case_file, film):
    keys = given_keys(load_case(case_file(film), ["contact.0.friction.D_max=100 nm"]))
    assert {"title", "geometry.upper.elements", "contact.0.film.thickness"} < set(keys)
    assert {"contact.0.friction.D_max", "boundary.1.platen.pressure"} < set(keys)
    assert "contact.0.friction.eta_b" not in keys  # of the preset
    assert "contact.0.penalty_factor" not in keys and "solver.tolerance" not in keys


def test_of_a_resolved_case_all_keys_are_given(case_file, film):
    text = resolved_toml(load_case(case_file(film)))
    case = Case.model_validate(tomllib.loads(text))
    assert "contact.0.friction.eta_b" in given_keys(case)
