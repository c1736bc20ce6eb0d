"""Tables 4.1, 4.2, A2.1 and A2.2: one sensor under objects of rising modulus, on both rings."""

from __future__ import annotations

from collections.abc import Sequence

from palpate.instrument.thesis import read_table
from palpate.procedures.reproduce.chapter4.films import voltage_sentence
from palpate.procedures.reproduce.chapter4.prediction import prediction_sentences
from palpate.procedures.reproduce.curves import BASE, TOOTH, CurveCase, Curves, ring_of
from palpate.procedures.reproduce.judging.criterion import odds_sentence
from palpate.procedures.reproduce.judging.rows import Comparison, column_of, fit_sentence

MODELS = ("axisymmetric", "solid")
GOAL = 0.012  # for the set that was identified from A2.1 and A2.3 together


def cases(parameters: Sequence[str], ring: float) -> dict[tuple[str, str], CurveCase]:
    """Cases that the tables for a ring [Pa] need, by parameter set and model."""
    return {(name, model): CurveCase("single", model, name, ring) for name in parameters for model in MODELS}


def compare(number: str, parameters: Sequence[str], curves: Curves) -> Comparison:
    """One of the four tables. Under 1 N the tooth's force equals the force ratio."""
    table = read_table(number)
    moduli = table.keys()
    by = {key: curves.of(case) for key, case in cases(parameters, ring_of(table)).items()}
    ratio = {key: curve.force_ratio(moduli) for key, curve in by.items()}
    tooth = {key: curve.voltage(TOOTH, moduli) for key, curve in by.items()}
    base = {key: curve.voltage(BASE, moduli) for key, curve in by.items()}
    columns = [column_of(table, "force_rigid_N", ratio, GOAL)]
    sensor = next(iter(by.values())).sensor
    if "stress_rigid_Pa" in table.columns:
        stress = {key: values / sensor.tooth.area for key, values in ratio.items()}
        columns.append(column_of(table, "stress_rigid_Pa", stress))
    columns += [column_of(table, "voltage_pvdf2_V", tooth), column_of(table, "voltage_pvdf1_V", base)]
    comparison = Comparison(table, tuple(columns), ())
    force = abs(table.values("force_rigid_N"))
    over_tooth = {f"{name} set ({model})": tooth[name, model] / ratio[name, model] for name, model in ratio}
    over_base = {f"{name} set ({model})": values for (name, model), values in base.items()}
    said = [
        fit_sentence(comparison, "force_rigid_N"),
        odds_sentence(table, "single"),
        *prediction_sentences(comparison, "force_rigid_N", film="voltage_pvdf2_V"),
        voltage_sentence(table, "voltage_pvdf2_V", force, sensor, TOOTH, over_tooth),
        voltage_sentence(table, "voltage_pvdf1_V", abs(table.values("force_total_N")), sensor, BASE, over_base),
    ]
    return Comparison(table, comparison.columns, tuple(said))
