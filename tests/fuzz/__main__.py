"""Hostile input for every decoder: `python -m tests.fuzz --inputs 10_000_000 --seed 1`.

Good inputs are mutated; the same seed gives the same inputs. With `--guided` libFuzzer (atheris) mutates them instead
and keeps what reaches new code. A finding is printed and kept in the corpus, which the tests replay.
"""

from __future__ import annotations

import argparse
import faulthandler
import logging
import resource
import signal
import subprocess
import sys
import time
from random import Random

import click

from tests.fuzz.target import CORPUS, TARGETS, keep, mutate, target

LARGEST_MEMORY = 4 << 30  # bytes; an input that takes more is a finding
LONGEST = 60  # s of processor time for a thousand inputs; the process ends with a traceback
STUCK = 3600  # s by the wall, on a machine however busy: something waits
THOUSAND = 1000


def fuzz(name: str, inputs: int, seed: int) -> int:
    """Feed `inputs` mutations to a decoder; returns how many findings there were, at most one of a kind."""
    decoder = target(name)
    seeds = [*decoder.seeds, *(path.read_bytes() for path in sorted(CORPUS.glob(f"{name}-*")))]
    random = Random(f"{seed} {name}")
    accepted = 0
    findings: dict[str, bytes] = {}
    wall, start = time.monotonic(), time.process_time()
    for number in range(inputs):
        if number % THOUSAND == 0:
            signal.setitimer(signal.ITIMER_PROF, LONGEST)
            faulthandler.dump_traceback_later(STUCK, exit=True)
        data = mutate(random, seeds, decoder.words)
        try:
            accepted += decoder.accepts(data)
        except Exception as error:
            kind = f"{type(error).__name__}: {error}"
            if type(error).__name__ not in {k.split(":")[0] for k in findings}:
                findings[kind] = data
                click.echo(f"  {name}: {kind[:300]}: kept as {keep(name, data)}")
    signal.setitimer(signal.ITIMER_PROF, 0)
    faulthandler.cancel_dump_traceback_later()
    click.echo(
        f"{name:24}{inputs:>12,}{accepted:>12,}{len(findings):>10}"
        f"{time.process_time() - start:>12.1f}{time.monotonic() - wall:>10.1f}",
    )
    return len(findings)


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--inputs", type=int, default=100_000, help="over all decoders")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--decoder", choices=TARGETS, action="append", help="only this one; may be repeated")
    parser.add_argument("--guided", action="store_true", help="guided by coverage; needs atheris (the group fuzz)")
    given = parser.parse_args()
    logging.disable(logging.CRITICAL)
    faulthandler.register(signal.SIGPROF, chain=True)
    resource.setrlimit(resource.RLIMIT_AS, (LARGEST_MEMORY, LARGEST_MEMORY))
    names = given.decoder or list(TARGETS)
    shares = sum(TARGETS[name][1] for name in names)
    click.echo(f"seed {given.seed}\n{'decoder':24}{'inputs':>12}{'accepted':>12}{'findings':>10}{'CPU s':>12}{'s':>10}")
    findings = 0
    for name in names:
        inputs = -(-given.inputs * TARGETS[name][1] // shares)
        if given.guided:
            command = [sys.executable, "-m", "tests.fuzz.guided", name, f"-runs={inputs}", f"-seed={given.seed}"]
            findings += subprocess.run(command, check=False).returncode != 0
        else:
            findings += fuzz(name, inputs, given.seed)
    click.echo(f"{findings} findings")
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
