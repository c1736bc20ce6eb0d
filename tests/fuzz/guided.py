"""One decoder under libFuzzer, which keeps what reaches new code; started by `python -m tests.fuzz --guided`."""

from __future__ import annotations

import logging
import sys
import tempfile
from pathlib import Path

import atheris

from tests.fuzz.target import CORPUS, LONGEST, keep, target

CODE = ["instrument", "drivers", "simulators", "procedures", "pymodbus", "canopen"]
LARGEST_MEMORY = 4096  # MiB


def main(name: str, *options: str) -> None:
    logging.disable(logging.CRITICAL)
    with atheris.instrument_imports(include=CODE):
        decoder = target(name)

    def test_one_input(data: bytes) -> None:
        try:
            decoder.accepts(data)
        except Exception:
            keep(name, data)
            raise

    with tempfile.TemporaryDirectory() as found:
        for number, seed in enumerate(decoder.seeds):
            Path(found, f"seed-{number}").write_bytes(seed)
        for path in CORPUS.glob(f"{name}-*"):
            Path(found, path.name).write_bytes(path.read_bytes())
        limits = [
            f"-max_len={LONGEST}",
            f"-rss_limit_mb={LARGEST_MEMORY}",
            "-timeout=60",
            "-verbosity=0",
            "-print_final_stats=1",
        ]
        atheris.Setup([name, *limits, *options, found], test_one_input)
        atheris.Fuzz()


if __name__ == "__main__":
    main(*sys.argv[1:])
