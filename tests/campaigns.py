"""A campaign of three steps that need each other, written in another order."""

NIGHTLY = """
name = "nightly"
scene = "noisy_lab"

[step.sweep]
procedure = "sweep-loads"
needs = ["films"]
settings = { samples = "1,2", loads = ["2 N", "3 N"], dwell = "0.5 s" }

[step.films]
procedure = "calibrate-films"
needs = ["cell"]
due = "7 d"
settings = { loads = "1.5 N, 2 N, 3 N, 4 N", dwell = "0.5 s" }

[step.cell]
procedure = "calibrate-load-cell"
due = "30 d"
"""
