"""What is frozen: lines for the command line by name, each list done in an empty folder of its own.

`old/` is copied into the folder of a cell whose lines name it.
"""

from __future__ import annotations

Lines = tuple[str, ...]

SCENES = (
    "everything",
    "humid_body",
    "ideal",
    "long_drift",
    "noisy_lab",
    "overdriven",
    "thesis_common_base",
    "thesis_different_base",
    "thesis_single",
    "unknown_curve",
    "array_16",  # last: with its five nodes it takes longest
)
# With the smallest settings that reach every part of a procedure.
PROCEDURES = {
    "sweep loads": "--samples 1,2 --loads '2 N, 3 N' --budget",
    "sweep position": "--positions '6 mm, 14 mm'",
    "sweep frequency": "--frequencies '2 Hz, 10 Hz, 20 Hz'",
    "sweep temperature": "--temperatures '0 K, 5 K, 15 K' --soak '1 min'",
    "calibrate load-cell": "--loads '140 gf:740 gf:200 gf' --runs 2 --positions 0,120 --creep --budget",
    "calibrate films": "--loads '2 N, 3 N, 4 N' --budget",
    "test modulus": "--sample 1 --steps 4 --extrapolate --budget",
    "softness": "--samples 1,2 --loads '2 N, 3 N' --budget",
    "characterise": "--loads '2 N, 2.5 N, 3 N' --drift-time '10 s' --budget",
    "measure modulus": "--sample 4 --mountings 1 --load '2 N' --time '2 min' --relative-to-model --budget",
    "calibrate model": "--reference 'A: 48 kPa ± 2 %' --reference 'B: 90 kPa ± 3 %' --loads '2 N, 3 N' --budget",
}
SLOW_SCENES = ("array_16",)  # an object's modulus takes the meshes of sixteen teeth, which take minutes
OBJECTS = ("measure modulus", "calibrate model")
# What is planned for a target: statuses and names are frozen, since plans may become better ones.
TARGETS = (
    "sweep loads --samples 1,2 --loads '2 N' --tolerance '2.5 %'",
    "sweep position --scene thesis_common_base --positions '6 mm, 14 mm' --load '4 N' --tolerance '0.3 mm'",
    "sweep position --scene thesis_common_base --positions '6 mm, 14 mm' --time '4 min'",
    "calibrate load-cell --tolerance '0.3 %'",
    "calibrate load-cell --class 1 --loads '300 gf:1000 gf:100 gf'",
    "calibrate films --tolerance '4 %' --loads '2 N, 3 N, 4 N'",
    "characterise --tolerance '2 %' --drift-time '10 s'",
    "characterise --time '6 min' --drift-time '10 s'",
    "softness --samples 1,2 --risk '5 %' --loads '2 N'",
    "measure modulus --sample 4 --tolerance '5 %' --relative-to-model",
    "measure modulus --modulus '60 kPa' --time '2 min'",
    "measure modulus --sample 4 --tolerance '2 %' --mounting-scatter '1 %' --relative-to-model",
)
# Each is refused before anything is sent: a target that nothing reaches, and a value that cannot be meant.
REFUSED = (
    "sweep loads --samples 1 --loads '2 N' --tolerance '0.001 %'",
    "sweep loads --samples 1 --loads '40 N'",
    "sweep loads --samples 99",
    "sweep loads --samples 1 --frequency '400 Hz'",
    "sweep position --tolerance '1 nm'",
    "sweep position --time '1 s'",
    "sweep position --positions '60 mm'",
    "sweep frequency --frequencies '0 Hz'",
    "sweep temperature --temperatures '400 K'",
    "calibrate load-cell --tolerance '0.01 %'",
    "calibrate load-cell --class 00",
    "calibrate load-cell --loads '100 gf'",
    "calibrate films --tolerance '0.01 %'",
    "calibrate films --loads '2 N'",
    "calibrate model --reference 'A: 48 kPa'",
    "test modulus --sample 99",
    "test modulus --sample 1 --strain '200 %'",
    "softness --samples 1 --risk '5 %'",
    "softness --samples 1,2 --risk '0 %'",
    "characterise --tolerance '0.01 %'",
    "characterise --loads '2 N'",
    "measure modulus --sample 4 --tolerance '0.01 %' --relative-to-model",
    "measure modulus --sample 4 --tolerance '60 %'",
    "measure modulus --sample 4 --time '1 s'",
    "measure modulus --sample 4",
    "model ratio --sensed-modulus '-3 kPa'",
    "model ratio --sensed-modulus '30 kPa' --tolerance 1e-12",
    "model modulus --force-ratio 1.5",
    "accuracy front --sample 99",
    "scene explain nowhere",
    "runs show nowhere",
    "study nowhere.toml",
)
PRINTED = ("thesis_single", "thesis_common_base", "noisy_lab")  # scenes for which the printed tables are frozen
PLANNED = ("sweep loads", "sweep position", "sweep frequency", "sweep temperature")
NO_EXPERIMENT = {"array_16": " --model column"}  # softness: the thesis measured no array, and its solid takes minutes

SMALL_SWEEP = "sweep loads --samples 1 --loads '2 N' --out run --json"
RATIO = "--sensed-modulus '30 kPa, 100 kPa' --json"
OTHERS: dict[str, Lines] = {
    "accuracy": ("accuracy --json",),
    "accuracy numerics": ("accuracy numerics --json",),
    "bus": (
        f"{SMALL_SWEEP} --log log.pcapng",
        "bus show log.pcapng --json",
        "bus replay log.pcapng --out again --json",
    ),
    "contracts export": ("contracts export --to maps --json",),
    "model validation": ("model validation --json",),
    "model surfaces": ("model surfaces --json",),
    "model ratio": tuple(
        f"model ratio --design {design} --model {model} {RATIO}"
        for design, model in (
            ("single", "column"),
            ("single", "column_fitted"),
            ("single", "beam"),
            ("single", "beam_exact"),
            ("single", "beam_printed"),
            ("single", "experiment"),
            ("single", "surface"),
            ("single_round", "axisymmetric"),
            ("common_base", "auto"),
            ("different_base", "surface"),
            ("array", "surface"),
        )
    ),
    "model ratio solid": (f"model ratio --design single --model solid --tolerance 2e-2 {RATIO}",),
    "model modulus": ("model modulus --force-ratio '0.31, 0.99' --json",),
    "model shear": ("model shear --json",),
    "model plot": ("model plot --sensed-modulus '24 kPa, 100 kPa' --out plot.png --json",),
    "reproduce": ("reproduce --out page --json",),
    "reproduce models": ("reproduce models --out page --json",),
    "runs": (
        SMALL_SWEEP,
        "runs list --out . --json",
        "runs check run --json",
        "runs repair run --out mended --json",
        "runs show mended --json",
        "runs export run --json",
    ),
    "scene list": ("scene list --json",),
    "scene plot": ("scene plot overdriven --out plot.png --json",),
    "study": ("study old/study.toml --workers 1 --out study --json",),
}


def _cells() -> dict[str, Lines]:
    cells: dict[str, Lines] = {}
    for scene in SCENES:
        for procedure, options in PROCEDURES.items():
            if scene in SLOW_SCENES and procedure in OBJECTS:
                continue
            own = NO_EXPERIMENT.get(scene, "") if procedure == "softness" else ""
            cells[f"run {scene} {procedure}"] = (
                f"{procedure} --scene {scene} {options}{own} --out run --log log.pcapng --json",
                "runs show run --json",
                "bus show log.pcapng --json",
            )
        cells[f"scene {scene}"] = (
            f"scene show {scene} --json",
            f"scene check {scene} --json",
            f"scene explain {scene} --json",
            f"scene explain {scene} --steady --sample 1 --load '2 N' --json",
        )
    for scene in PRINTED:
        for procedure, options in PROCEDURES.items():
            done = f"{procedure} --scene {scene} {options}"
            cells[f"printed {scene} {procedure}"] = (f"{done} --dry-run", f"{done} --out run", "runs show run")
    cells |= {f"target {line}": (f"{line} --dry-run --json", f"{line} --out run --json") for line in TARGETS}
    cells["refused"] = REFUSED
    for procedure in PLANNED:
        cells[f"dry-run {procedure}"] = (f"{procedure} --dry-run --json",)
    cells |= OTHERS
    cells["old scene with automatic effects"] = (
        "scene show old/automatic.toml --json",
        "scene explain old/automatic.toml --json",
        "scene explain old/automatic.toml --steady --json",
    )
    cells["old bench files"] = tuple(
        f"sweep loads --dry-run --bench old/{name}.toml --json" for name in ("bench", "bench-changer", "bench-least")
    )
    cells["old run of record format 4"] = (
        "runs check old/run-4 --json",
        "runs show old/run-4 --json",
        "runs export old/run-4 --json",
        "runs resume old/run-4 --json",
        "runs show old/run-4 --json",
    )
    cells["old bus log"] = ("bus replay old/log.pcapng --out again --json", "runs show again --json")
    return cells


CELLS = _cells()
