"""What an installation with pip takes along: all packages, and the C sources beside them."""

import importlib
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TOP = ("app", "forms", "geometry")


def project() -> dict:
    with (ROOT / "pyproject.toml").open("rb") as stream:
        return tomllib.load(stream)


def settings() -> dict:
    return project()["tool"]["setuptools"]


def test_the_command_of_an_installation_exists():
    module, _, name = project()["project"]["scripts"]["tribox"].partition(":")
    assert callable(getattr(importlib.import_module(module), name))


@pytest.mark.parametrize(
    ("module", "names"),
    [
        ("tribox.app.case", "Case, load_case, check_case, json_schema, resolved_toml"),
        ("tribox.app.run", "run_case"),
        ("tribox.app.results", "Results, read"),
        ("tribox.app.fit", "Calibration, coordinates, fit_setup"),
        ("tribox.app.fit_model", "coordinates"),
        ("tribox.app.fit_run", "fit_setup"),
        (
            "tribox.forms.friction",
            "Dissipation, FrictionLaw, FrictionResponse, FrictionState, Regime",
        ),
        ("tribox.forms.friction_map", "FrictionMap"),
        ("tribox.forms.friction_parameters", "FrictionMapParameters, with_preset"),
        ("tribox.forms.closed_forms", "effective_viscosity, film_fraction, steady_traction"),
    ],
)
def test_documented_imports_stay_where_they_are(module, names):
    for name in names.split(", "):
        assert callable(getattr(importlib.import_module(module), name))


def test_every_directory_with_modules_is_a_package_that_is_found():
    assert settings()["packages"]["find"]["where"] == ["src"]
    for top in TOP:
        assert (ROOT / "src" / "tribox" / top).resolve() == ROOT / top
        for path in (ROOT / top).rglob("*.py"):
            assert (path.parent / "__init__.py").is_file(), path


def test_every_file_that_is_no_module_is_package_data():
    data = settings()["package-data"]
    for top in TOP:
        for path in (ROOT / top).rglob("*"):
            if path.is_file() and path.suffix not in (".py", ".pyc"):
                package = ".".join(("tribox", *path.relative_to(ROOT).parent.parts))
                assert any(path.match(pattern) for pattern in data[package]), path
