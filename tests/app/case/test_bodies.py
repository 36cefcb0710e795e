"""Mistakes in the materials of a case: one clear line for each."""

import math
import re
import tomllib

import pytest

from tests.app.case.test_case import FILM_CASE
from tribox.app.build.model import notes_on_branches, notes_on_materials
from tribox.app.case.case import Case, given_keys, resolved_toml
from tribox.app.case.library import entries
from tribox.app.case.quantities import parse_quantity
from tribox.app.case.reading import check_case
from tribox.app.case.toml_files import toml_text
from tribox.forms.bodies.elastoplastic import ElastoPlastic

YEOH = {"material": "yeoh", "C10": 1, "K": 9}
OGDEN = {"material": "ogden", "mu": [1], "alpha": [2], "K": 1}
METAL = {"material": "elastoplastic", "E": 7e10, "nu": 0.3}


def flows(law, **keys):
    return METAL | {"hardening": {"law": law, **keys}}


def rated(law, **keys):
    return flows("linear", yield_stress=1) | {"rate": {"law": law, **keys}}


def branched(*branches):
    return flows("linear", yield_stress="80 MPa") | {"kinematic": list(branches)}


RUBBER = {"material": "neo-hookean", "G": 1, "K": 9}
PRONY = RUBBER | {"prony": [[0.2, "10 ms"], [0.1, "1 s"]]}
WLF = {"law": "wlf", "C1": 17.4, "C2": 51.6, "reference": "20 degC", "temperature": "40 degC"}
HOT = {"law": "arrhenius", "energy": "80 kJ/mol", "reference": 293, "temperature": 313}


MISTAKES = [
    ({"material": "steel"}, 'material = "steel": must be one of "neo-hookean", "hencky"'),
    ({"material": "AA1050"}, 'no such material; did you mean "AA1050-O", "AA1100-O"'),
    ({"material": "Mooney-Rivlin"}, 'no such material; did you mean "mooney-rivlin"'),
    ({"material": "hencky", "library": "AA1050-O"}, 'library = "AA1050-O": is of material = "elas'),
    ({"material": "PU-90A", "C10": 1}, 'key "C10" in bodies.aluminium does not go with'),
    ({"material": "AA1050-O", "E": -1}, "bodies.aluminium.E = -1: must be > 0 Pa"),
    ({"material": "AA1050-O", "hardening": {"q": 1}}, 'unknown key "q" in bodies.aluminium.hard'),
    (YEOH | {"C10": 0}, "bodies.aluminium.C10 = 0: must be > 0 Pa"),
    ({"material": "yeoh", "C10": 1}, "bodies.aluminium.K: missing; bulk modulus, in Pa"),
    (YEOH | {"C40": 1}, 'unknown key "C40" in bodies.aluminium; did you mean "C'),
    (OGDEN | {"mu": [1, 2]}, "alpha: has 1 entries and mu 2: must be as many"),
    (OGDEN | {"alpha": [0]}, "bodies.aluminium.alpha.0 = 0: must not be 0"),
    (OGDEN | {"alpha": [99]}, "bodies.aluminium.alpha.0 = 99: must be >= -30 and <= 30"),
    (OGDEN | {"mu": []}, "bodies.aluminium.mu = []: must have at least 1 entry"),
    (OGDEN | {"mu": 3}, "bodies.aluminium.mu = 3: must be an array"),
    (OGDEN | {"mu": [-1]}, "half the sum of mu alpha, is -1 Pa: must be > 0 Pa"),
    (OGDEN | {"mu": ["1 m"]}, 'bodies.aluminium.mu.0 = "1 m": "m" has the wrong dimension'),
    (METAL, "bodies.aluminium.hardening: missing; yield stress over the plastic strain"),
    (METAL | {"hardening": 3}, "bodies.aluminium.hardening = 3: must be a table"),
    (METAL | {"hardening": {}}, 'bodies.aluminium.hardening.law: missing; one of "linear"'),
    (flows("swft"), 'bodies.aluminium.hardening.law = "swft": must be one of "linear"'),
    (flows("linear"), "hardening.yield_stress: missing; yield stress"),
    (flows("linear", yield_stress=0), "hardening.yield_stress = 0: must be > 0 Pa"),
    (flows("linear", yield_stress="-3 MPa"), 'yield_stress = "-3 MPa": must be > 0 Pa'),
    (flows("linear", yield_stress=3, modulus=-1), "hardening.modulus = -1: must be >= 0 Pa"),
    (flows("linear", yield_stress=3, n=1), '"n" in bodies.aluminium.hardening does not go with'),
    (
        flows("voce", yield_stress=3, saturation_stress=2, exponent=9),
        "hardening.saturation_stress = 2.0: must be >= yield_stress = 3 Pa",
    ),
    (flows("swift", K=3, strain0=0.1, n=1.2), "hardening.n = 1.2: must be >= 0 and <= 1"),
    (flows("swift", K=3, strain0=0, n=0.2), "hardening.strain0 = 0: must be > 0"),
    (flows("table", points=[[0, 3], [0.1, 2]]), "points.1.1 = 2.0: must be >= 3 Pa, that of the"),
    (flows("table", points=[[0, 3], [0, 4]]), "points.1.0 = 0: the plastic strain must increase"),
    (flows("table", points=[[0.1, 3]]), "hardening.points.0.0 = 0.1: must be 0"),
    (flows("table", points=3), "points = 3: must be a table of rows [[plastic strain, yield"),
    (flows("table", points=[[0, 0]]), "hardening.points.0.1 = 0: must be > 0 Pa"),
    (flows("table", points=[]), "hardening.points = []: a table needs at least one row"),
    (rated("perzyna", exponent=0.2), "rate.reference_rate: missing; rate of plastic strain"),
    (rated("perzyna", reference_rate=1, exponent=2), "rate.exponent = 2: must be > 0 and <= 1"),
    (rated("johnson-cook", C=0), "rate.C = 0: must be > 0"),
    (RUBBER | {"prony": [[0.6, 1], [0.5, 2]]}, "prony: the shares sum up to 1.1: must be < 1"),
    (RUBBER | {"prony": [[0, 1]]}, "bodies.aluminium.prony.0.0 = 0: must be > 0 and < 1"),
    (RUBBER | {"prony": [[1.2, 1]]}, "bodies.aluminium.prony.0.0 = 1.2: must be > 0 and < 1"),
    (RUBBER | {"prony": [[0.2, 0]]}, "bodies.aluminium.prony.0.1 = 0: must be > 0 s"),
    (RUBBER | {"prony": [[0.2, "1 Hz"]]}, 'prony.0.1 = "1 Hz": "Hz" has the wrong dimension'),
    (RUBBER | {"prony": [[0.2]]}, "prony.0 = [0.2]: must be a pair [share, relaxation time]"),
    (RUBBER | {"prony": []}, "bodies.aluminium.prony = []: a table needs at least one row"),
    (RUBBER | {"moduli": "instantaneous"}, "moduli: needs prony: there are no branches"),
    (PRONY | {"moduli": "short"}, 'bodies.aluminium.moduli = "short": must be '),
    (RUBBER | {"shift": HOT}, "bodies.aluminium.shift: needs prony"),
    (PRONY | {"shift": HOT | {"energy": 0}}, "shift.energy = 0: must be > 0 J/mol"),
    (PRONY | {"shift": WLF | {"temperature": "-60 degC"}}, "shift.temperature: must be > 241.55 K"),
    (PRONY | {"shift": WLF | {"C2": "51 degC"}}, 'shift.C2 = "51 degC":'),
    (PRONY | {"shift": WLF | {"temperature": "-31 degC"}}, "by 1.48e+03 decades: more than 30"),
    (RUBBER | {"mullins": {"r": 1, "m": 1}}, "bodies.aluminium.mullins.r = 1: must be > 1"),
    (RUBBER | {"mullins": {"r": 2, "m": 0}}, "bodies.aluminium.mullins.m = 0: must be > 0 Pa"),
    (RUBBER | {"mullins": {"r": 2, "m": "1 m"}}, 'mullins.m = "1 m": "m" has the wrong dimension'),
    (RUBBER | {"mullins": {"r": 2}}, "bodies.aluminium.mullins.m: missing; strain energy"),
    (RUBBER | {"mullins": {"r": 2, "m": 1, "beta": -1}}, "mullins.beta = -1: must be >= 0"),
    (RUBBER | {"mullins": 2}, "bodies.aluminium.mullins = 2: must be a table"),
    (METAL | flows("linear", yield_stress=1) | {"mullins": {}}, 'key "mullins" in bodies.al'),
    (PRONY | {"nu": 0.4}, "give E and nu, or G and K; found G and K and nu"),
    (METAL | flows("linear", yield_stress=1) | {"prony": [[0.2, 1]]}, 'key "prony" in bodies.al'),
    (rated("cowper"), 'rate.law = "cowper": must be one of "johnson-cook", "perzyna"'),
    (branched(3), "bodies.aluminium.kinematic.0 = 3: must be an array"),
    (branched(["2 GPa"]), "bodies.aluminium.kinematic.0.1: missing entry"),
    (branched(["2 GPa", 50, 1]), "must have at most 2 entries"),
    (branched(["2 GPa", 50], [0, 1]), "bodies.aluminium.kinematic.1.0 = 0: must be > 0 Pa"),
    (branched(["2 m", 50]), 'kinematic.0.0 = "2 m": "m" has the wrong dimension'),
    (branched(["2 GPa", -1]), "bodies.aluminium.kinematic.0.1 = -1: must be >= 0"),
    (branched(*[["1 GPa", 50]] * 9), "must have at most 8 entries"),
    (branched(["100 GPa", 0]), "kinematic.0: c/max(b, 1) is 1e+11 Pa: must be <= 2.69e+10 Pa"),
    (YEOH | {"kinematic": [["1 GPa", 50]]}, 'key "kinematic" in bodies.aluminium does not go'),
    ({"material": "elastoplastic", "E": 1} | {"hardening": {"law": "linear", "yield_stress": 1}},
     "give E and nu, or G and K; found E"),
]  # fmt: skip


@pytest.mark.parametrize(("body", "expected"), MISTAKES, ids=[m[1][:40] for m in MISTAKES])
def test_a_mistake_gives_one_clear_line(body, expected, case_file):
    data = tomllib.loads(FILM_CASE)
    data["bodies"]["aluminium"] = body
    lines = check_case(case_file(toml_text(data)))
    assert len(lines) == 1, lines
    assert expected in lines[0]
    assert "\n" not in lines[0] and "pydantic" not in lines[0] and len(lines[0]) < 320


FACTORS = [  # by hand; of WLF the glass is at 20 degC
    (WLF, 10.0 ** (-17.4 * 20.0 / 71.6), False),
    (WLF | {"temperature": "18 degC"}, 10.0 ** (17.4 * 2.0 / 49.6), True),
    (WLF | {"temperature": "119 degC"}, 10.0 ** (-17.4 * 99.0 / 150.6), True),
    (HOT, math.exp(80e3 / 8.314462618 * (1.0 / 313.0 - 1.0 / 293.0)), False),
    (HOT | {"temperature": 283}, math.exp(80e3 / 8.314462618 * (1.0 / 283.0 - 1.0 / 293.0)), False),
]


@pytest.mark.parametrize(("shift", "factor", "far"), FACTORS)
def test_a_temperature_shifts_the_relaxation_times(shift, factor, far):
    case = read(case_with(**PRONY, shift=shift))
    times = [branch.time for branch in case.bodies["aluminium"].material_of().branches]
    assert times == pytest.approx([0.01 * factor, factor], rel=1e-8)
    notes = [n for n in notes_on_branches(case.bodies, case.stage) if ".shift: " in n]
    said, *more = notes
    assert f"relaxation times are {factor:.3g} times those of prony" in said
    assert len(more) == far and all("is extrapolated" in note for note in more)


# -- The materials library: entries, what a case makes of them, and what is written back -----------

METALS = [n for n, entry in entries().items() if entry.keys["material"] == "elastoplastic"]
MEASURED = ["AA6016-T4"]
REVERSED = ["AA5754-O-reversed"]
POLYURETHANES = [name for name in entries() if name.startswith("PU-")]


def case_with(**aluminium):
    data = tomllib.loads(FILM_CASE)
    data["bodies"]["aluminium"] = aluminium
    return data


def read(data):
    return Case.model_validate(data)


def leaves(table, before=""):
    for key, value in table.items():
        if isinstance(value, dict):
            yield from leaves(value, f"{before}{key}.")
        elif key not in ("law", "material"):
            yield f"{before}{key}"


@pytest.mark.parametrize("name", entries())
def test_an_entry_is_a_stable_material_whose_numbers_have_sources(name):
    entry = entries()[name]
    body = read(case_with(material=name)).bodies["aluminium"]
    material = body.material_of()
    assert material.shear_modulus > 0.0 and material.bulk_modulus > material.shear_modulus
    assert notes_on_materials({"aluminium": body}, {"aluminium": material}) == []
    assert set(entry.sources) == set(leaves(entry.keys))
    for source in entry.sources.values():
        assert re.search(r"\b(19|20)\d\d\b|Aluminum Association|Not measured", source), source
    assert entry.about and entry.range
    assert isinstance(material, ElastoPlastic) == (name in METALS)


def test_a_measured_curve_is_that_of_its_source():
    """Yields at K ε₀ⁿ = 129.9 MPa; the load maximum is at n − ε₀, as its range says."""
    [name] = MEASURED
    entry = entries()[name]
    law = read(case_with(material=name)).bodies["aluminium"].material_of().hardening
    assert law.stress(0.0) == pytest.approx(129.87e6, rel=1e-3)
    slope = (law.stress(0.2762) - law.stress(0.2760)) / 2e-4
    assert slope == pytest.approx(law.stress(0.2761), rel=1e-3)
    assert "plastic strain up to 0.28" in entry.range and not entry.strengths
    assert "10.1007/s12289-022-01672-w" in entry.sources["hardening.K"]


@pytest.mark.parametrize("name", [n for n in METALS if n not in MEASURED + REVERSED])
def test_hardening_is_made_from_the_strengths(name):
    """It yields at the proof stress; the nominal stress of a bar is largest at the strength."""
    entry = entries()[name]
    proof, tensile = (
        parse_quantity(entry.strengths[key], "Pa") for key in ("proof_stress", "tensile_strength")
    )
    law = read(case_with(material=name)).bodies["aluminium"].material_of().hardening
    assert law.stress(0.0) == pytest.approx(proof, rel=2e-3)
    strains = [i * 1e-4 for i in range(5000)]
    nominal = [float(law.stress(a)) * math.exp(-a) for a in strains]
    assert max(nominal) == pytest.approx(tensile, rel=1e-3)
    told = re.search(r"plastic strain up to (0\.\d\d)", entry.range)
    assert strains[nominal.index(max(nominal))] == pytest.approx(float(told[1]), abs=0.006)


@pytest.mark.parametrize("name", POLYURETHANES)
def test_moduli_by_hardness(name):
    """Kunz & Studer's relation as the source has it; G = E/3."""
    shore = float(re.search(r"\d+", name)[0])
    force, depth = 0.549 + 0.07516 * shore, 0.025e-3 * (100.0 - shore)
    young = 0.75 * force / (2.0 * 0.395e-3 * depth) * (2.6 - 0.02 * shore)
    body = read(case_with(material=name)).bodies["aluminium"]
    assert body.shear_modulus == pytest.approx(young / 3.0, rel=2e-3)


def test_a_metal_measured_in_reversed_shear_has_the_constants_of_its_source():
    """Shutov's table in this program's terms, and its tensile curve beside a measured one."""
    [name] = REVERSED
    metal = read(case_with(material=name)).bodies["aluminium"].material_of()
    bulk, shear = 68.63e9, 26.31e9
    assert (metal.bulk_modulus, metal.shear_modulus) == pytest.approx((bulk, shear), rel=1e-3)
    voce, branches = metal.hardening, metal.kinematic
    assert voce.saturation_stress == pytest.approx(31.5e6 + 1963e6 / 13.33, rel=1e-4)
    for own, (c, kappa) in zip(branches, ((115.5, 0.0885), (11500, 0.01676)), strict=True):
        assert own.modulus == pytest.approx(1.5e6 * c, rel=1e-4)
        assert own.recovery == pytest.approx(math.sqrt(1.5) * c * kappa, rel=1e-4)
    for alpha in (0.05, 0.1, 0.2):
        back = sum(k.modulus / k.recovery * -math.expm1(-k.recovery * alpha) for k in branches)
        tension = 292.14e6 - (292.14e6 - 102.75e6) * math.exp(-13.5 * alpha)
        assert 0.065 < 1.0 - (voce.stress(alpha) + back) / tension < 0.095


# Long-term modulus and branches, kPa, as the sources print them.
PRINTED = {
    "VHB-4910": (15.36, 26.06, 26.53, 10.83),
    "VHB-4910-slow": (13.7, 56.4, 31.5, 19.8),
    "NBR-visco": (400.0, 535.7, 76.20, 120.5, 21.3, 22.9),
}


@pytest.mark.parametrize("name", PRINTED)
def test_branches_are_those_of_their_source(name):
    long_term, *moduli = PRINTED[name]
    keys = entries()[name].keys
    G = parse_quantity(keys["G"], "Pa")
    assert G == pytest.approx(1e3 * sum(PRINTED[name]))
    shares = [float(share) for share, _ in keys["prony"]]
    assert [G * share for share in shares] == pytest.approx([1e3 * m for m in moduli], rel=1e-5)
    assert G * (1.0 - sum(shares)) == pytest.approx(1e3 * long_term, rel=1e-4)


def test_keys_of_the_table_come_first():
    keys = {"material": "AA1050-O", "density": "2.8 g/cm^3", "hardening": {"n": 0.3}}
    body = read(case_with(**keys)).bodies["aluminium"]
    assert (body.density, body.hardening.n, body.hardening.strain0) == (2800.0, 0.3, 0.002)
    assert (body.E, body.library, body.material) == (69e9, "AA1050-O", "elastoplastic")
    law = {"law": "linear", "yield_stress": 3e7}
    body = read(case_with(material="AA1050-O", hardening=law, G=26e9, K=70e9)).bodies["aluminium"]
    assert body.hardening.modulus == 0.0 and body.E is None and body.shear_modulus == 26e9


def test_a_pair_of_moduli_takes_the_place_of_the_other_pair():
    body = read(case_with(material="NR-60A", E="5 MPa", nu=0.49)).bodies["aluminium"]
    assert (body.E, body.nu, body.G, body.K) == (5e6, 0.49, None, None)


@pytest.mark.parametrize(
    "keys", [{}, {"E": "71 GPa"}, {"G": 26e9, "K": 7e10}, {"hardening": {"n": 0.3}}]
)
def test_a_resolved_case_has_the_numbers_and_reads_back(keys):
    case = read(case_with(material="AA6061-T6", **keys))
    written = tomllib.loads(resolved_toml(case))
    body = written["bodies"]["aluminium"]
    assert body["material"] == "elastoplastic" and body["library"] == "AA6061-T6"
    assert body["density"] == "2700.0 kg/m^3" and body["hardening"]["strain0"] == 0.002
    assert read(written) == case
    given = {"bodies.aluminium.material", "bodies.aluminium.library"}
    given |= {f"bodies.aluminium.{key}" for key in leaves(keys)}
    assert {key for key in given_keys(case) if key.startswith("bodies.alu")} == given


def test_a_sweep_over_materials_takes_each_with_its_own_numbers():
    data = case_with(material="AA1050-O", nu=0.3)
    data["sweep"] = {"key": "bodies.aluminium.material", "values": ["AA1050-O", "AA2024-T3"]}
    case = read(data)
    bodies = [part.bodies["aluminium"] for _, part in case.sweep_cases()]
    assert [body.density for body in bodies] == [2705.0, 2780.0]
    assert [body.hardening.n for body in bodies] == [0.2581, 0.1109]
    assert [body.nu for body in bodies] == [0.3, 0.3]
    assert [case.swept_value(part) for _, part in case.sweep_cases()] == ["AA1050-O", "AA2024-T3"]
    again = read(tomllib.loads(resolved_toml(case)))
    assert [part for _, part in again.sweep_cases()] == [part for _, part in case.sweep_cases()]


def test_a_case_of_a_library_that_is_no_more():
    """The numbers of a resolved case are enough."""
    body = {"material": "hencky", "library": "AA9999-O", "E": 7e10, "nu": 0.3}
    assert read(case_with(**body)).bodies["aluminium"].E == 7e10
