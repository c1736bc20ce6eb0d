"""A bench that is served faster than the wall, and swept from another process."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.procedures.conftest import Palpate

PALPATE = (sys.executable, "-c", "from palpate.procedures.commands import main; main()")
SPEED, HASTE = 10, 5
# The client's wall goes faster too, so that this takes seconds; the bench is SPEED / HASTE times as fast as it.
CLIENT = (
    sys.executable,
    "-c",
    f"""
from palpate.procedures.commands import main
from palpate.procedures.lab import open as session

class Hasty(session.WallClock):
    def now_ns(self):
        return {HASTE} * super().now_ns()

    def wait(self, duration):
        super().wait(duration / {HASTE})

session.WallClock = Hasty
main()
""",
)
SWEEP = ("sweep", "loads", "--samples", "1", "--loads", "2 N", "--dwell", "0.5 s", "--json")


@pytest.mark.slow
def test_a_sweep_from_another_process_on_a_fast_bench_gives_the_ratio_of_an_own_bench(
    palpate: Palpate, tmp_path: Path
) -> None:
    bench = tmp_path / "bench.toml"
    serve = ("serve", "thesis_single", "--seed", "5", "--samples", "1", "--speed", str(SPEED), "--out", str(bench))
    environment = {**os.environ, "PALPATE_STORE": str(tmp_path / "served")}
    with subprocess.Popen(
        [*PALPATE, *serve, "--json"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as server:
        assert server.stdout is not None
        while (said := server.stdout.readline()) not in ("}\n", ""):
            pass
        assert said, "it is not served"
        patient = bench.read_text().replace('watchdog = "2.0 s"', 'watchdog = "60 s"')  # on a machine with much to do
        bench.write_text(patient)
        command = [*CLIENT, *SWEEP, "--bench", str(bench)]
        done = subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False, env=environment
        )
        server.communicate("quit\n")
    assert (done.returncode, server.returncode) == (0, 0), done.stderr
    (served,), (own,) = json.loads(done.stdout)["samples"], palpate(*SWEEP, "--seed", "6").object["samples"]
    apart = 3 * math.hypot(served["force_ratio_u"], own["force_ratio_u"])
    assert served["force_ratio"] == pytest.approx(own["force_ratio"], abs=apart)
    assert served["valid_points"] == 1
