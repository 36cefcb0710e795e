"""Draw friction over velocity three times: the data, the fitted law, and the run."""

import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas

from tribox import read
from tribox.forms.closed_forms import steady_traction

fit, run = (Path(name) for name in sys.argv[1:3])  # results of "tribox fit" and of "tribox run"
results = read(run)
data = pandas.read_csv(fit / "fit.csv")
data = data[data["slip [m]"].isna()]  # steady sliding only
# A velocity of the run: its last row. The first row of each film is that of the stage "press".
steps = results.sweep[results.sweep["stage"] == "slide"]
law = next(iter(results.parts.values())).case.contact[0].friction.parameters()
pressure = 3e6  # Pa, of the data and of the case
speeds = np.geomspace(7e-7, 4e-2, 400)

figure, axes = plt.subplots(figsize=(7, 4.4), layout="constrained")
print("film (nm)  velocity (m/s)      T/N data      law      run")
colours = ("#1b6ca8", "#b3202f", "#2b2b2b")  # those of these films in fit.png
for colour, film in zip(colours, sorted(steps["value"].unique()), strict=True):
    measured = data[np.isclose(data["thickness [m]"], film, atol=0.0)]
    mine = steps[steps["value"] == film]
    curve = steady_traction(speeds, film, pressure, law.mu_dynamic, law) / pressure
    axes.loglog(speeds, curve, color=colour, lw=1)
    axes.loglog(
        measured["velocity [m/s]"], measured["traction [Pa]"] / measured["pressure [Pa]"],
        "o", mfc="none", color=colour, label=f"D = {film * 1e9:g} nm",
    )  # fmt: skip
    axes.loglog(mine["velocity"], mine["friction_coefficient"], "x", ms=9, mew=2, color=colour)
    for speed, in_run in zip(mine["velocity"], mine["friction_coefficient"], strict=True):
        row = measured[np.isclose(measured["velocity [m/s]"], speed, atol=0.0)].iloc[0]
        seen = row["traction [Pa]"] / row["pressure [Pa]"]
        said = row["fitted_traction [Pa]"] / row["pressure [Pa]"]
        print(f"{film * 1e9:9.0f} {speed:15.3g} {seen:13.5f} {said:8.5f} {in_run:8.5f}")
axes.plot([], [], "k-", lw=1, label="fitted law")
axes.plot([], [], "kx", ms=9, mew=2, label="run")
axes.set(xlabel="sliding velocity V (m/s)", ylabel="friction over normal force T/N")
axes.legend(title="circles: data (synthetic)", ncols=2, fontsize=9)
figure.savefig("comparison.png", dpi=110)
