"""Studies of tests: a grid, and draws."""

from __future__ import annotations

from palpate.instrument.config import parse
from palpate.procedures.study.description import Study, StudyFile, study_of

GRID = """
name = "grid"
loads = "1 N, 2 N"

[axes]
scene = ["near", "far"]
seed = "1-3"
sample = ["1", "2"]
"""
RANDOM = """
name = "random"
random = { cells = 40, seed = 5 }

[axes]
seed = "1-1000"
modulus = { low = "10 kPa", high = "1000 kPa", scale = "log" }
effects.white_noise.density = { low = "1 µV/√Hz", high = "2 µV/√Hz" }
effects.glue_clamping.factor = { low = 0.25, high = 0.5 }
model = ["column", "beam"]
"""


def study_from(text: str) -> Study:
    return study_of(parse(text.encode(), StudyFile, "study.toml"), "study.toml")
