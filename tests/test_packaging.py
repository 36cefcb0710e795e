"""What an installation with pip takes along: all packages, and the C sources beside them."""

import importlib
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

import tribox
from tests.ranks import mpi_environment

ROOT = Path(__file__).parents[1]
TOP = ("app", "forms", "geometry")


def project() -> dict:
    with (ROOT / "pyproject.toml").open("rb") as stream:
        return tomllib.load(stream)


def test_the_command_of_an_installation_exists():
    module, _, name = project()["project"]["scripts"]["tribox"].partition(":")
    assert callable(getattr(importlib.import_module(module), name))


@pytest.mark.parametrize(
    ("module", "names"),
    [
        ("tribox.app.case", "Case, load_case, check_case, json_schema, resolved_toml"),
        ("tribox.app.run", "run_case"), ("tribox.app.results", "Results, read"),
        ("tribox.app.fit", "Calibration, coordinates, fit_setup"),
        ("tribox.app.fit_model", "coordinates"), ("tribox.app.fit_run", "fit_setup"),
        ("tribox.forms.friction",
         "Dissipation, FrictionLaw, FrictionResponse, FrictionState, Regime"),
        ("tribox.forms.friction_map", "FrictionMap"),
        ("tribox.forms.friction_parameters", "FrictionMapParameters, with_preset"),
        ("tribox.forms.closed_forms", "effective_viscosity, film_fraction, steady_traction"),
    ],
)  # fmt: skip
def test_documented_imports_stay_where_they_are(module, names):
    for name in names.split(", "):
        assert callable(getattr(importlib.import_module(module), name))


def built(sources: Path, kind: str, target: Path) -> Path:
    """The file that a builder (``build_wheel`` or ``build_sdist``) makes of sources."""
    build = f"import sys; from setuptools.build_meta import {kind}; {kind}(sys.argv[1])"
    target.mkdir()
    command = [sys.executable, "-c", build, str(target)]
    subprocess.run(command, cwd=sources, check=True, capture_output=True)
    (made,) = target.iterdir()
    return made


@pytest.fixture(scope="module")
def sources(tmp_path_factory) -> Path:
    """A copy of what packages are made from, links as links."""
    here = tmp_path_factory.mktemp("packaging") / "sources"
    here.mkdir()
    for name in ("src", *TOP, "cases"):
        skipped = shutil.ignore_patterns("__pycache__", "*.egg-info")
        shutil.copytree(ROOT / name, here / name, symlinks=True, ignore=skipped)
    for path in ROOT.iterdir():
        if path.is_file():
            shutil.copy(path, here)
    return here


@pytest.fixture(scope="module")
def unpacked(sources) -> Path:
    """What is in an sdist of the sources."""
    target = sources.with_name("unpacked")
    with tarfile.open(built(sources, "build_sdist", sources.with_name("sdist"))) as sdist:
        sdist.extractall(target, filter="data")
    (top,) = target.iterdir()
    return top


@pytest.fixture(scope="module")
def installed(unpacked, sources) -> Path:
    """A directory that a wheel of the sdist has been unpacked into."""
    target = sources.with_name("installed")
    zipfile.ZipFile(built(unpacked, "build_wheel", sources.with_name("wheel"))).extractall(target)
    return target


CARRIED = (
    "app/case/materials.toml", "app/init/own-mesh.geo", "app/init/two-blocks.toml",
    "app/report/template.html", "cases/block-slide.toml", "cases/data/tribometer-synthetic.csv",
    "cases/forming/own-mesh.geo", "forms/native/lanes.h", "forms/native/plane_kernel.c",
    "geometry/native/closest_points.c",
)  # fmt: skip


def test_sdist_and_wheel_hold_the_package_and_nothing_else(unpacked, installed):
    assert {path.name.split("-")[0] for path in installed.iterdir()} == {"tribox"}
    for package in (unpacked / "src" / "tribox", installed / "tribox"):
        for name in CARRIED:
            assert (package / name).read_bytes() == (ROOT / name).read_bytes()
        for top in (*TOP, "cases"):
            for path in (ROOT / top).rglob("*"):
                if path.is_file() and path.suffix != ".pyc":
                    assert (package / path.relative_to(ROOT)).is_file(), path
    made = {"PKG-INFO", "setup.cfg", "build"}
    assert {path.name for path in unpacked.iterdir()} - made == {
        "src",
        *("CHANGELOG.md", "CITATION.cff", "LICENSE", "MANIFEST.in", "README.md"),
        *("pyproject.toml", "setup.py"),
    }


def test_a_release_has_one_version_everywhere():
    version = project()["project"]["version"]
    assert tribox.__version__ == version
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    (cited,) = re.findall(r"^version: (.*)$", citation, re.MULTILINE)
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    released, day = re.findall(r"^## \[(\d.*)\] - (\S+)$", changes, re.MULTILINE)[0]
    recipe = (ROOT / "conda" / "recipe.yaml").read_text(encoding="utf-8")
    (packed,) = re.findall(r"^  version: (\d.*)$", recipe, re.MULTILINE)
    assert (cited, released, packed) == (version, version, version)
    assert f"\ndate-released: {day}\n" in citation


def test_the_conda_package_needs_what_pip_s_needs():
    recipe = (ROOT / "conda" / "recipe.yaml").read_text(encoding="utf-8")
    listed = recipe.partition("  run:\n")[2].partition("\n\n")[0]
    run = {re.sub(r"#.*|\s", "", line).removeprefix("-") for line in listed.splitlines()}
    needed = set(project()["project"]["dependencies"]) - {"matplotlib"} | {"matplotlib-base"}
    assert needed <= run


def test_a_checkout_without_symbolic_links_runs_and_is_not_packaged(sources, tmp_path):
    tree = tmp_path / "tree"
    shutil.copytree(sources, tree, symlinks=True)
    for name in (*TOP, "cases"):
        link = tree / "src" / "tribox" / name
        content = os.readlink(link)
        link.unlink()
        link.write_text(content)
    script = (
        "from pathlib import Path; from tribox import load_case; import tribox.app, "
        "tribox.forms.friction, tribox.geometry.native; cases = Path(tribox.app.__file__).parents"
        "[1] / 'cases'; print(load_case(cases / 'block-slide.toml').title)"
    )
    done = subprocess.run(
        [sys.executable, "-P", "-c", script],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(tree / "src")},
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stderr) == (0, "") and done.stdout.strip()
    with pytest.raises(subprocess.CalledProcessError) as refused:
        built(tree, "build_wheel", tmp_path / "wheel")
    last = refused.value.stderr.decode().splitlines()[-1]
    assert last.startswith("src/tribox/app is no directory: ") and "core.symlinks" in last


SCRIPT = """
import sys
from pathlib import Path

import tribox
from tribox import load_case, read, run_case

case = load_case(Path(tribox.__file__).parent / "cases" / "block-slide.toml", sys.argv[1:])
run_case(case, Path("out"), quiet=True)
rows = read(Path("out")).history
print(tribox.__file__, len(rows), rows.normal_force.iloc[-1] > 0.0)
"""


def test_what_is_installed_runs_from_anywhere(installed, tmp_path):
    (tmp_path / "tribox").mkdir()  # what happens to have the name is not taken for the package
    coarse = ["geometry.upper.elements=[6, 3]", "geometry.lower.elements=[8, 3]"]
    few = ["stage.0.steps=2", "stage.1.steps=2"]
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, *coarse, *few],
        cwd=tmp_path,
        env=mpi_environment() | {"PYTHONPATH": str(installed), "PYTHONSAFEPATH": "1"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == [str(installed / "tribox" / "__init__.py"), "4", "True"]


def test_tests_of_an_installation_are_refused(installed, tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "tribox", "test"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(installed), "PYTHONSAFEPATH": "1"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2 and "the tests are in the source tree" in done.stderr


@pytest.mark.parametrize("top", TOP)
def test_a_package_under_its_folder_s_name_is_refused(top):
    with pytest.raises(ImportError, match=f"{top} is imported as tribox.{top}:"):
        importlib.import_module(top)
