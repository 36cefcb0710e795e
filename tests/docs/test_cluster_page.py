"""The job of the page on clusters, run with stand-ins for what Slurm has."""

import os
import subprocess
from pathlib import Path

import pytest

from tests.docs.blocks import find_blocks
from tests.docs.pages import ROOT

PAGE = ROOT / "docs" / "how-to" / "clusters.md"
JOB = ROOT / "examples" / "cluster" / "press.sbatch"


def test_the_page_shows_the_job_of_the_examples():
    assert JOB.read_text(encoding="utf-8") in [block.text for block in find_blocks(PAGE)]


@pytest.mark.parametrize(
    ("code", "restarts", "again"),
    [(0, None, False), (130, None, True), (130, "19", True), (130, "20", False), (3, "1", False)],
)
def test_a_job_goes_on_only_after_a_run_that_was_stopped(tmp_path, code, restarts, again):
    for name, ends in (("srun", code), ("scontrol", 0)):
        stand_in = tmp_path / name
        stand_in.write_text(f'#!/bin/sh\necho "{name} $*" >>"{tmp_path}/told"\nexit {ends}\n')
        stand_in.chmod(0o755)
    slurm = {"SLURM_SUBMIT_DIR": str(tmp_path), "SLURM_JOB_ID": "7"}
    if restarts is not None:
        slurm["SLURM_RESTART_COUNT"] = restarts
    environment = os.environ | slurm | {"PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}"}
    done = subprocess.run(["bash", str(JOB)], cwd=tmp_path, env=environment, check=False)
    assert done.returncode == code
    ran, *put_back = Path(tmp_path, "told").read_text(encoding="utf-8").splitlines()
    assert ran == "srun --mpi=pmix tribox run press.toml --out results/press --resume"
    assert put_back == ["scontrol requeue 7"] * again
