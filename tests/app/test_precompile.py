"""What the image compiles beforehand is all that runs need."""

import tomllib
from pathlib import Path

import pytest
from dolfinx import jit
from mpi4py import MPI

from tests.flowing import SOFT_METAL
from tribox.app.build.model import build_model
from tribox.app.case.case import Case
from tribox.app.precompile import compile_forms
from tribox.app.results.fields import StressField
from tribox.geometry.compat import compiler_cache


@pytest.fixture
def cache(tmp_path, monkeypatch) -> Path:
    """A cache of this test's own, with all that is compiled already: other tests fill theirs."""
    for path in compiler_cache().glob("*"):
        (tmp_path / path.name).symlink_to(path)
    monkeypatch.setitem(jit.DOLFINX_DEFAULT_JIT_OPTIONS, "cache_dir", (str(tmp_path), ""))
    assert compiler_cache() == tmp_path
    return tmp_path


def test_runs_compile_nothing_that_has_not_been_compiled(cache, block, film):
    def compiled() -> set[str]:
        return {path.name for path in cache.glob("*.so")}

    lines = list(compile_forms())
    assert len(lines) == len(set(lines)) >= 10
    before = compiled()
    assert before
    pushed = block.replace("[boundary.displacement]", 'pressure = "1 kPa"\n[boundary.displacement]')
    cases = [tomllib.loads(text) for text in (block, film, pushed)]
    triangles = tomllib.loads(film)
    triangles["geometry"]["cell"] = "triangle"
    full = tomllib.loads(film)
    full["bodies"]["elastomer"]["formulation"] = "q1"
    full["contact"][0]["quadrature_degree"] = 5
    ring = tomllib.loads(block.replace('thickness = "1 mm"', 'section = "axisymmetric"'))
    ring["boundary"][1]["displacement"]["x"] = 0
    boxes = tomllib.loads(block.replace('thickness = "1 mm"', ""))
    boxes["geometry"]["kind"] = "two-boxes"
    for name in ("upper", "lower"):
        boxes["geometry"][name] |= {"depth": "1 mm", "elements": [2, 1, 2]}
    tetrahedra = {**boxes, "geometry": {**boxes["geometry"], "cell": "tetrahedron"}}
    for data in (*cases, triangles, full, ring, boxes, tetrahedra):
        model = build_model(Case.model_validate(data), MPI.COMM_SELF)
        StressField(model.problem.u, model.problem.solids).update()
    for data in (full, ring, boxes):
        data["bodies"]["aluminium"] = SOFT_METAL
        data["bodies"]["elastomer"]["prony"] = [[0.5, "1 s"]]
        model = build_model(Case.model_validate(data), MPI.COMM_SELF)
        assert any(solid.flows for solid in model.problem.solids)
        assert all(solid.remembers for solid in model.problem.solids)
        for solid in model.problem.solids:
            solid.evaluate(tangent=True)
    assert compiled() == before
