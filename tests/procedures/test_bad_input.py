"""What cannot be is refused with one clear message and an exit status, and leaves nothing behind."""

from __future__ import annotations

import importlib
import itertools
import os
import re
import resource
import shlex
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from palpate import Run
from palpate.extend import BenchDescription, Identity
from palpate.instrument.calibration.files import write_calibration
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.procedures.virtual.served_bench import Person
from palpate.simulators.bench import SimulatedBench
from palpate.simulators.scenes.heads import shipped
from tests.conftest import Install, hasty
from tests.drivers.benches import altered
from tests.instrument.test_map_files import TRANSMITTER
from tests.procedures.conftest import IDEAL_SCENE, Benches, Palpate, outputs, refused

SWEEP = ("sweep", "loads")
SMALL = (*SWEEP, "--samples", "1", "--loads", "2 N, 3 N")
NO_TEXT = os.fsdecode(b"\xff")
LONG = 300 * "x"


# --- texts ---------------------------------------------------------------------------------------------

# Of each command: what is given to it, and a part of the one message.
REFUSED = {
    "sweep loads": [
        ("--loads ''", "'' is not a quantity"),
        ("--loads 2", "'2' has no unit where N belongs; write for example '3 N'"),
        ("--loads '24 kPa'", "'24 kPa' is in kPa where N belongs"),
        ("--loads 'nan N'", "'nan N'"),
        ("--loads '1e400 N'", "'1e400 N' is not finite"),
        ("--loads '-1 N'", "load -1 N peak to peak is not above zero"),
        ("--loads '2 N,1 N'", "must not decrease"),
        ("--loads '1 N,,2 N'", "'' is not a quantity"),
        ("--loads '1.5 N:4 N'", "give first:last:step"),
        ("--loads '4 N:1 N:1 N'", "last >= first and step > 0"),
        ("--loads '1 N:1e308 N:1e-300 N'", "more than 1000 loads"),
        ("--loads '1e9 N'", "above the bench's force limit of 10 N; loads up to 9.09 N are possible"),
        ("--loads '\udcff'", "is not a quantity"),
        ("--samples ''", "unknown sample ''; valid: 1, 2, 3, 4, 5, 6"),
        ("--samples 7", "unknown sample '7'"),
        ("--samples 1-", "sample range '1-' lacks an end; write for example '1-3'"),
        ("--samples 3-1", "runs backwards; write '1-3'"),
        ("--samples 1,1", "named twice"),
        ("--samples '\udcff'", "unknown sample"),
        ("--dwell 1", "'1' has no unit where s belongs"),
        ("--dwell '0 s'", "dwell 0 s is not above 0 and at most 3600 s"),
        ("--dwell '2 h'", "dwell 7200 s is not above 0 and at most 3600 s"),
        ("--dwell '99 ms'", "dwell 99 ms is below one cycle of 10 Hz; dwell 100 ms or longer"),
        ("--tolerance '0.01 %'", "gain scatter binds, and a run has 10,000 load sets at most"),
        ("--tolerance '-1 %'", "--tolerance: '-1 %' is not above 0"),
        ("--tolerance 5", "--tolerance: '5' is 500 %, above the 50 % that are allowed; give a share such as"),
        ("--tolerance nan", "--tolerance: 'nan' is no share; give a share such as '5 %' or 0.05"),
        ("--frequency '10 N'", "'10 N' is in N where Hz belongs"),
        ("--frequency '1 kHz'", "outside 0.5 to 100 Hz"),
        ("--frequency '10.0004 Hz'", "between the exciter's steps of 0.001 Hz; take 10 Hz"),
        ("--model colum", "unknown model 'colum' (did you mean 'column'?)"),
        ("--scene thesis_singel", "unknown scene 'thesis_singel' (did you mean 'thesis_single'?)"),
        ("--scene '\udcff'", "unknown scene"),
        ("--scene ''", "unknown scene ''"),
        ("--loads '2 N, 8 N'", "load 8 N lies outside the 1.373 to 7.257 N"),
        ("--loads '1 N' --dry-run", "load 1 N lies outside the 1.373 to 7.257 N"),
    ],
    "sweep position": [
        ("--positions '12 mm'", "1 position cannot make a sweep; give 2 or more"),
        ("--positions '12 mm, 6 mm'", "positions 12 mm, 6 mm must be increasing and distinct"),
        ("--positions '0 mm:26 mm:2 mm'", "position 26 mm is off the sensor, which reaches from 0 to 24 mm"),
        ("--positions '1 N, 2 N'", "'1 N' is in N where m belongs"),
        ("--scene thesis_single", "point loads are known for design 'common_base'"),
        ("--sample 9", "unknown sample '9'"),
        ("--dwell '50 ms'", "below one cycle"),
        ("--load '9.5 N'", "above the bench's force limit"),
        ("--tolerance '1 mm'", "--tolerance 1 mm is outside 0.01 mm to 0.6 mm; leave it out: more than one"),
        ("--tolerance '0 mm'", "--tolerance 0 mm is outside 0.01 mm to 0.6 mm; give one inside, such as '0.2 mm'"),
        ("--tolerance '5 %'", "where m belongs"),
        ("--time '2 min'", "one load set at each of 13 positions takes"),
        ("--time '0 s'", "--time 0 s is not above 0"),
        ("--time '300 h'", "holds more than 10000 load sets at each of 13 positions, the most of a run"),
        ("--dwell '1 s' --time '1 h'", "--dwell and --time: the time determines the dwell; give only one of them"),
    ],
    "sweep frequency": [
        ("--frequencies '1 Hz, 2 Hz'", "2 frequencies; give 3 to 200 to find a corner"),
        ("--frequencies '1 Hz:2 Hz:2'", "a count of 3 to 200"),
        ("--frequencies '3 Hz, 2 Hz, 5 Hz'", "they must increase"),
        ("--frequencies '0.01 Hz, 1 Hz, 2 Hz'", "frequency 0.01 Hz is outside 0.1 to 100 Hz"),
        ("--frequencies '1 Hz, 9 Hz, 1 kHz'", "frequency 1000 Hz is outside 0.1 to 100 Hz"),
        ("--frequencies '1.00049 Hz, 2 Hz, 3 Hz'", "lies between the exciter's steps"),
        ("--dwell '2 h'", "dwell 7200 s is not above 0 and at most 3600 s"),
        ("--dwell '-1 s'", "dwell -1 s is not above 0"),
        ("--load '0 N'", "load 0 N peak to peak is not above zero"),
        ("--load '9.5 N'", "above the bench's force limit of 10 N"),
        ("--sample 7", "unknown sample '7'"),
    ],
    "sweep temperature": [
        ("--temperatures '0 K, 5 K'", "make 2 different changes; 3 to 50 give a slope"),
        ("--temperatures '0 K, 5 K, 10 K, 15 K'", "make 2 different changes"),
        ("--temperatures '0 K, 20 K, 70 K'", "temperature 70 K relative to the start is outside -20 to 40 K"),
        ("--temperatures '0, 5, 15'", "'0' has no unit where K belongs"),
        ("--soak '-1 s'", "soak -1 s is outside 0 to 86400 s"),
        ("--dwell '50 ms'", "dwell 50 ms is below one cycle of 10 Hz"),
        ("--frequency '1 kHz'", "frequency 1000 Hz is outside 0.5 to 100 Hz"),
        ("--load '9.5 N'", "above the bench's force limit of 10 N"),
    ],
    "calibrate load-cell": [
        ("--loads '140 gf, 240 gf'", "2 loads cannot give a curve of degree 1 and its uncertainty; use at least 3"),
        ("--loads '1 N, 2 N, 3 N' --degree 2", "3 loads cannot give a curve of degree 2"),
        ("--loads '0 gf:300 gf:100 gf'", "load 0 N is not above 0 and at most 10 N"),
        ("--loads '1 N, 2 N, 2 N'", "none may repeat"),
        ("--loads '1 N, 2 N, 30 N'", "load 30 N is not above 0 and at most 10 N, the bench's force limit"),
        ("--runs 0", "0 runs give no reading"),
        ("--positions 0,120,0", "must be distinct, from 0 to below 360 degrees"),
        ("--positions 0,north", "'north' is not a quantity"),
        ("--valid-days 800", "validity of 800 days is outside 1 to 791"),
        ("--loads '300 gf:1000 gf:100 gf' --runs 2 --positions 0,120 --class 3", "unknown class of ISO 376 '3'"),
        ("--class 1", "--class 1: ISO 376 asks for 8 loads, not 7; ISO 376 asks for repeatability and reprod"),
        (
            "--loads '600 gf:1000 gf:50 gf' --runs 2 --positions 0,120 --class 1",
            "asks for loads down to 50% of the greatest",
        ),
        (
            "--loads '300 gf:1000 gf:100 gf' --runs 2 --positions 0,120 --class 1 --tolerance 1%",
            "--tolerance and --class",
        ),
    ],
    "calibrate films": [
        ("--loads '2 N, 3 N'", "2 loads cannot show linearity and scatter; use at least 3"),
        ("--loads '0.5 N, 2 N, 3 N'", "load 0.5 N lies outside the 1.373 to 7.257 N that the load cell"),
        ("--loads '2 N, 3 N, 30 N'", "force limit of 10 N"),
        ("--frequencies '10 Hz, 10 Hz'", "each only once"),
        ("--frequencies '500 Hz'", "frequency 500 Hz is outside"),
        ("--dwell '0.05 s'", "dwell 50 ms is below one cycle of 10 Hz"),
        ("--valid-days 0", "validity of 0 days is outside 1 to 791"),
    ],
    "characterise": [
        ("--sample 9", "unknown sample '9'"),
        ("--loads '2 N, 3 N'", "2 loads cannot give a line with its scatter; give 3 or more"),
        ("--loads '2 N, 3 N, 30 N'", "above the bench's force limit of 10 N"),
        ("--drift-time '2 s'", "drift time 2 s is outside 3 s, 3 dwells, to 86400 s"),
        ("--frequency '200 Hz'", "frequency 200 Hz is outside 0.5 to 100 Hz"),
        ("--tolerance '1 %'", "load cell leaves ± 1.1 %"),
        ("--tolerance '1 mm'", "is no share"),
        ("--tolerance '60 %'", "above the 50 % that are allowed"),
        ("--time '440 s'", "one round of 7 loads and what follows take 452 s"),
        ("--time '0 s'", "--time 0 s is not above 0"),
        ("--loads '1 N, 2 N, 3 N'", "load 1 N lies outside the 1.373 to 7.257 N"),
    ],
    "softness": [
        ("", "--samples or --modulus is missing: name the objects that the simulated bench touches"),
        ("--samples 1 --modulus '1 kPa'", "either samples or moduli of unknown objects, not both"),
        ("--samples 8", "unknown sample '8'"),
        ("--samples 1 --model colum", "unknown model 'colum'"),
        ("--samples 1 --loads '30 N'", "above the bench's force limit of 10 N"),
        ("--samples 1 --dwell '0 s'", "dwell 0 s is not above 0"),
        ("--samples 1 --thickness '3 mm' --modulus '1 kPa'", "not both"),
        ("--modulus '1 kPa' --thickness '0 mm'", "--thickness: '0 mm' is not above 0"),
        ("--modulus '50 kPa, 50 kPa'", "give at least one, and each only once"),
        ("--samples 1 --risk 5%", "one object has no order; name two or more"),
        ("--samples 1,2 --risk 1e-7", "--risk 1e-07 is outside 1e-06 to 0.5"),
        ("--samples 1,2 --risk 5% --sets 0", "--sets 0 is outside 1 to 100"),
        ("--samples 1,2 --sets 3", "--sets is for --risk"),
        ("--samples 3,5 --risk 0.1% --sets 2", "gain scatter leaves a risk of 2 % that 3 and 5"),
        ("--samples 3,5 --risk 0.1% --sets 2", "best now  --risk '2.1 %'\n  or        --sets 12"),
        (
            "--modulus '60 kPa, 1 GPa'",
            "ratios from model 'experiment': modulus 1 GPa of sample '1 GPa' is outside the measured",
        ),
        ("--samples 1 --loads '8 N'", "there where a command has --extrapolate"),
    ],
    "test modulus": [
        ("--sample 9", "unknown sample '9'"),
        ("--sample 1 --strain 0", "strain 0 is outside 0 to 0.6; give one inside, such as 30 %"),
        ("--sample 1 --strain '70 %'", "strain 0.7 is outside 0 to 0.6"),
        ("--sample 1 --strain '1 N'", "'1 N' is in N where a plain number belongs"),
        ("--sample 1 --steps 2", "steps 2 is outside 3 to 100, which give a line with its uncertainty"),
    ],
    "measure modulus --sample 4": [
        ("", "--tolerance or --time is missing"),
        ("--time '1.1 min'", "s on the bench; 1.1 min is too short"),
        ("--time '2 min' --mounting-freedom 3", "--mounting-freedom says how well --mounting-scatter is known"),
        ("--time '2 min' --mounting-scatter '1 %' --mounting-freedom 0", "--mounting-freedom 0 is below 1"),
        ("--time '2 min' --mounting-scatter '-1 %'", "--mounting-scatter -1 % is outside 0 to 50 %"),
        ("--time '0 s'", "--time 0 s is not above 0"),
        ("--tolerance '5 %' --scene array_16", "validation error of 'surface' is not known"),
        ("--tolerance '60 %'", "above the 50 % that are allowed"),
        (
            "--tolerance '3 %' --relative-to-model --mountings 1 --mounting-scatter '5 %'",
            "or        leave the number of mountings to the plan, without --mountings",
        ),
        ("--time '2 min' --mountings 0", "--mountings 0 is outside 1 to 100"),
        ("--time '2 min' --mounting-scatter 2", "--mounting-scatter 200 % is outside 0 to 50 %"),
        ("--time '2 min' --mounting-scatter nan", "'nan' is not a quantity; write for example '1 %'"),
        ("--time '2 min' --modulus '-1 kPa'", "--modulus: '-1 kPa' is not above 0 and finite"),
        ("--time '2 min' --thickness '-5 mm'", "--thickness: '-5 mm' is not above 0 and finite"),
        ("--time '2 min' --thickness '5 mm'", "--thickness is that of an unknown object, and a sample has its"),
        ("--time '2 min' --modulus '50 kPa'", "--sample and --modulus: give either"),
        ("--time '2 min' --model nothing", "nothing"),
        ("--time '2 min' --load '9.5 N'", "force limit"),
    ],
    "measure": [
        ("sweep-loads --dwell '1 s' --tolerance '3 %' --dry-run", "--dwell and --tolerance: the tolerance determines"),
        ("calibrate-load-cell --degree 3 --dry-run", "--degree: unknown degree '3'; valid: 1, 2, auto"),
        ("calibrate-model --reference 'A: 48 kPa' --dry-run", "--reference: 'A: 48 kPa' lacks the unit or the"),
        ("sweep-loads --samples '1, 1' --dry-run", "--samples: sample '1' is named twice in '1, 1'"),
        ("sweep-loads --loads '3 N, 2 N' --dry-run", "loads 3 N, 2 N must not decrease"),
        ("calibrate-films --loads '2 N, 2 N, 3 N' --dry-run", "2 loads cannot show linearity and scatter"),
        ("characterise --loads '3 N, 2 N, 4 N' --dry-run", "loads 3 N, 2 N, 4 N must be increasing"),
        ("softness --samples 1 --loads '3 N, 2 N' --dry-run", "loads 3 N, 2 N must not decrease"),
        (
            "sweep-frequency --frequencies '2 Hz, 1 Hz, 3 Hz' --dry-run",
            "frequencies '2 Hz, 1 Hz, 3 Hz': they must increase",
        ),
        (
            "sweep-position --scene thesis_common_base --positions '9 mm, 6 mm' --dry-run",
            "positions 9 mm, 6 mm must be increasing",
        ),
    ],
    "accuracy": [
        ("--tolerance '200 %'", "above the 50 % that are allowed"),
        ("--sample 99", "99"),
        ("--modulus '100 GPa' --scene poor_seating", "tells no more than a bound"),
        ("--modulus '5 MPa'", "modulus 5 MPa of sample '5 MPa' is outside the measured"),
        ("--model beam_printed", "it cannot be told how thick an object is"),
        ("--mounting-scatter '-1 %'", "--mounting-scatter -1 % is outside 0 to 50 %"),
        ("--mounting-scatter '1 %' --mounting-freedom 0", "--mounting-freedom 0 is below 1"),
        ("--sample 4 --modulus '50 kPa'", "--sample and --modulus: give either"),
        ("--absolute --relative-to-model", "--absolute and --relative-to-model"),
    ],
    "scene plot ideal": [
        ("--sample 9", "unknown sample '9'"),
        ("--load 3", "'3' has no unit where N belongs"),
        ("--load '0 N'", "load 0 N is not above 0 and finite"),
        ("--frequency '-1 Hz'", "frequency -1 Hz is not above 0 and finite"),
    ],
    "scene explain ideal": [
        ("--mark 0", "--mark: '0' is not above 0"),
        ("--load '1e-300 N'", "load 1e-300 N is outside 1e-06 to 1e+06 N; give one inside"),
        ("--frequency '1e-300 Hz'", "1e-300 Hz is outside 1e-06 to 1e+06 Hz; give one inside"),
        ("--mark 5", "--mark: '5' is 500 %, above the 50 %"),
        ("--mark -1e-3", "--mark: '-1e-3' is not above 0"),
        ("--mark nan", "--mark: 'nan' is no share; give a share such as '5 %' or 0.05"),
        ("--mark '1 N'", "--mark: '1 N' is no share"),
        ("--dwell '0 s'", "dwell 0 s is not above 0 and finite"),
        ("--dwell '1e5 s'", "100000 s is outside 1e-06 to 3600 s; give one inside"),
        ("--dwell 1", "'1' has no unit where s belongs"),
        ("--sample 9", "unknown sample '9'"),
    ],
    "measure modulus": [
        (
            "--modulus '1 Pa' --time '2 min'",
            "such limit; give a scene with another model, such as --scene poor_seating",
        ),
    ],
    "model validation": [
        ("--design singel", "unknown design with experiments 'singel' (did you mean 'single'?)"),
        ("--design array", "unknown design with experiments 'array'"),
        ("--design single --store", "--design: not with --store"),
    ],
    "accuracy numerics": [
        ("--design singel", "unknown design with prices 'singel' (did you mean 'single'?)"),
    ],
    "model surfaces": [
        ("--design arrays", "unknown design with a surface 'arrays'"),
    ],
}


@pytest.mark.parametrize(
    ("words", "message"), [(f"{command} {more}", told) for command, rows in REFUSED.items() for more, told in rows]
)
def test_what_cannot_be_asked_is_one_error_before_a_bench_is_opened_and_leaves_nothing(
    palpate: Palpate, benches: Benches, words: str, message: str
) -> None:
    assert message in refused(palpate(*shlex.split(words)), benches)


@pytest.mark.parametrize(
    ("words", "status", "message"),
    [
        (("model", "modulus", "--force-ratio", "x"), 2, "'x' is not a quantity; write for example '0.3'"),
        (("test", "modulus", "--sample", "1", "--strain", "x"), 2, "quantity; write for example '30 %'"),
        (("sweep", "frequency", "--frequencies", "1 Hz:9 Hz:x"), 2, "quantity; write for example '16'"),
        (("calibrate", "load-cell", "--positions", "x"), 2, "--positions: 'x' is not a quantity; write for example '1"),
        *(((*SWEEP, *words), 2, "Error: ") for words in (
            ("--seed", "-1"), ("--seed", "x"), ("--sample", "1"), ("--out", ""), ("--bench", ""), ("extra",)
        )),
        *((words, 1, "File name too long") for words in (
            (*SWEEP, "--out", LONG), (*SWEEP, "--scene", LONG), ("runs", "show", LONG), ("runs", "list", "--out", LONG),
            ("runs", "export", LONG, "--to", "csv"),
        )),
        *(
            (("runs", *command, name), 2, "unknown run")
            for command in (("show",), ("export", "--to", "csv")) for name in ("none", "", NO_TEXT)
        ),
        *(
            ((*SWEEP, "--bench", "lab.toml", *option), 2, f"{option[0]}: only for a simulated bench")
            for option in (("--scene", "thesis_single"), ("--seed", "1"), ("--model", "beam"))
        ),
        (
            ("measure", "modulus", "--sample", "4", "--tolerance", "5 %", "--load", "1 uN"), 1,
            "load 1 µN peak to peak is below 2 steps of the load indicator; ask for 194 mN or more",
        ),
        (("runs", "list", "--out", "nowhere"), 2, "nowhere is no folder; name one that holds runs with --out"),
    ],
)  # fmt: skip
def test_a_command_that_cannot_be_is_refused_and_leaves_nothing(
    palpate: Palpate, lab: str, words: tuple[str, ...], status: int, message: str
) -> None:
    said = palpate(*words)
    assert (said.status, said.out, message in said.err) == (status, "", True), said.err
    assert "Traceback" not in said.err
    assert [path.name for path in Path().iterdir()] == [lab]


# --- files ---------------------------------------------------------------------------------------------


MAKERS = '[device.cell]\nkind = "flintec-dad-141"\nspan = 10.306\n'


@pytest.mark.parametrize("option", ["--scene", "--bench"])
@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "cannot be read: No such file"),
        (b"name = ", "is not TOML"),
        (b"\xff\xfe", "is not text in UTF-8, as TOML must be, but in UTF-16; save it in UTF-8"),
        (
            'name = "a"\nat = "3 µm"'.encode("latin-1"),
            "is not text in UTF-8, as TOML must be, (line 2 has the byte 0xB5)",
        ),
        (b"", "name: is missing"),
    ],
)
def test_a_missing_or_malformed_file_is_refused(
    palpate: Palpate, option: str, content: bytes | None, message: str
) -> None:
    if content is not None:
        Path("my.toml").write_bytes(content)
    said = palpate(*SWEEP, option, "my.toml")
    assert (said.status, f"my.toml: {message}" in said.complaint) == (2, True), said.err
    assert not Path("runs").exists()


@pytest.mark.parametrize(
    ("command", "content"),
    [
        ((*SMALL, "--dry-run", "--scene"), IDEAL_SCENE),
        (("contracts", "check"), TRANSMITTER),
        (("scene", "check"), IDEAL_SCENE),
    ],
)
def test_a_file_with_a_byte_order_mark_is_read_as_without(
    command: tuple[str, ...], content: str, palpate: Palpate
) -> None:
    Path("my.toml").write_text(content, encoding="utf-8")
    plain = palpate(*command, "my.toml")
    assert plain.status == 0, plain.err
    Path("my.toml").write_text(content.replace("\n", "\r\n"), encoding="utf-8-sig", newline="")
    marked = palpate(*command, "my.toml")
    assert (marked.status, marked.out, marked.err) == (plain.status, plain.out, plain.err)


READERS = (("sweep", "loads", "--scene"), *(("scene", command) for command in ("check", "explain", "show", "plot")))
WRONG = [
    ("bitz = 12", "bitz: unknown key (did you mean 'bits'?)"),
    ("bits = 40", "bits: 40 is too large; give at most 16"),
    ("[effects.charge_amplifier]\ntime_constant = 1", "time_constant: 1 needs a unit"),
    ("[effects.charge_amplifier]\ntime_constant = '1 N'", "'1 N' is in N where s belongs"),
    ("[effects.charge_amplifier]\ntime_constant = '0 s'", "time_constant: 0.0 is too small; give at least 1 ns"),
    ("[effects.chargeamplifier]", "unknown effect (did you mean 'charge_amplifier'?)"),
    ("[rigs]", "rigs: unknown key (did you mean 'rig'?)"),
    ('[rig]\nforce_constant = "nan N/A"', "rig.force_constant"),
    (
        f'{MAKERS}inventory = "LAB-1"',
        "device.cell: inventory: a simulated bench gives its devices links, addresses and labels itself; leave",
    ),
    (f"{MAKERS}unit = 3", "device.cell: unit: a simulated bench gives its devices links, addresses and labels"),
    (f"{MAKERS}spam = 3", "spam: unknown key (did you mean 'span'?); valid: bandwidth, filter, gage_factor, kind,"),
    (f'{MAKERS}role = "bogus"', "device.cell: role: 'bogus' is not known; valid: 'source', "),
    (f'{MAKERS}role = "bias"', "device.cell: unknown role of a flintec-dad-141 'bias'; valid: load_indicator"),
    ("[effects.mains_hum]\namplitud = '1 mV'", "amplitud: unknown key (did you mean 'amplitude'?)"),
    ('[effects.mains_hum]\nfrequency = "50 V"', "frequency: '50 V' is in V where Hz belongs"),
    ('[effects.charge_amplifier]\ntime_constant = "-1 s"', "time_constant"),
    ('[effects.amplifier_clip]\nrail = "-5 V"', "rail"),
    ('[effects.viscoelastic]\ng = [1.5]\ntau = ["1 s"]', "g.0"),
    ('[effects.white_noise]\ndensity = "nan V/√Hz"', "density: 'nan V/√Hz' is not a quantity"),
    ('[effects.white_noise]\ndensity = "1e999 V/√Hz"', "density: '1e999 V/√Hz' is not finite"),
    ("[effects.charge_amplifier]\n[effects.voltage_amplifier]", "exclude each other; leave one out"),
    ('[effects.jitter]\nwhen = "off"', "effects.jitter.when: 'off' is neither 'on' nor 'auto'"),
    (f"{MAKERS}optional = 3", "device.cell: optional: 3 is neither true nor false"),
]


@pytest.mark.parametrize(("wrong", "command"), [*zip(WRONG, itertools.cycle(READERS))])
def test_a_scene_that_cannot_be_is_one_message_before_anything_starts(
    wrong: tuple[str, str], command: tuple[str, ...], palpate: Palpate, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("palpate.simulators.rig.Rig.__init__", lambda *_: pytest.fail("a rig was built"))
    Path("my.toml").write_text(f"{IDEAL_SCENE}{wrong[0]}\n", encoding="utf-8")
    said = palpate(*command, "my.toml")
    assert (said.status, wrong[1] in said.complaint) == (2, True), said.err
    assert said.complaint.startswith("my.toml: ") and "\n" not in said.complaint
    assert not Path("runs").exists()


@pytest.mark.parametrize("command", ["show", "check", "plot"])
@pytest.mark.parametrize(
    ("scene", "message"),
    [
        ("thesis_singel", "unknown scene 'thesis_singel' (did you mean 'thesis_single'?)"),
        ("absent.toml", "absent.toml: cannot be read: No such file or directory"),
        ("nodes.toml", "nodes.toml: nodes: 1 cannot take the 17 films of design 'array_16'"),
        ("model.toml", "nothing was measured with design 'array_16'"),
    ],
)
def test_a_scene_that_does_not_exist_or_cannot_be_simulated_is_one_clear_error(
    scene: str, message: str, command: str, palpate: Palpate
) -> None:
    design = IDEAL_SCENE.replace("single", "array_16")
    Path("model.toml").write_text(design)
    Path("nodes.toml").write_text(design.replace("[effects", 'model = "column"\nnodes = 1\n[effects', 1))
    spoken = palpate("scene", command, scene)
    shown = (scene, command) == ("model.toml", "show")  # nothing is asked of the model
    assert (spoken.status, message in spoken.err) == ((0, False) if shown else (2, True))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("watchdog =", "watchdg =", "watchdg: unknown key (did you mean 'watchdog'?)"),
        ('force_limit = "10.0 N"', "force_limit = 10.0", "force_limit: 10.0 needs a unit"),
        ('force_limit = "10.0 N"', 'force_limit = "10 kPa"', "force_limit: '10 kPa' is in kPa where N belongs"),
        ('force_limit = "10.0 N"', 'force_limit = "-1 N"', "force_limit: "),
        ("baudrate = 4000000", "baudrate = 1", "link.line: baudrate: 1 is too small; give at least 300"),
        ("unit = 1", "unit = 300", "unit: "),
    ],
)
def test_a_wrong_key_of_a_bench_file_is_named(palpate: Palpate, lab: str, old: str, new: str, message: str) -> None:
    text = Path(lab).read_text(encoding="utf-8")
    assert old in text
    Path(lab).write_text(text.replace(old, new), encoding="utf-8")
    said = palpate(*SWEEP, "--bench", lab)
    assert (said.status, message in said.complaint) == (2, True), said.err
    assert not Path("runs").exists()


# --- files of another kind: one line, not a list of all their keys --------------------------------------

BENCH = """name = "lab"
force_limit = "10 N"
[link.line]
kind = "modbus-rtu"
port = "/dev/none"
"""


@pytest.fixture
def files(palpate: Palpate) -> None:
    Path("bench.toml").write_text(BENCH, encoding="utf-8")
    Path("scene.toml").write_bytes(shipped()["thesis_single"].read_bytes())
    Path("study.toml").write_bytes((Path(__file__).parents[1] / "examples" / "study.toml").read_bytes())
    write_calibration(Path("cell.toml"), THESIS_LOAD_CELL)


@pytest.mark.usefixtures("files")
@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ("calibrate", "accept", "bench.toml"),
            "bench.toml: is no calibration of a load cell: it has force_limit, link, name,",
        ),
        (("calibrate", "accept", "scene.toml"), "scene.toml: is no calibration of a load cell: it has design, "),
        (("sweep", "loads", "--bench", "scene.toml"), "scene.toml: is no bench: it has "),
        (("sweep", "loads", "--bench", "cell.toml"), "cell.toml: is no bench: it has astm_e74, "),
        (
            ("sweep", "loads", "--scene", "bench.toml"),
            "bench.toml: is no scene: it has force_limit, link, and it l",
        ),
        (("sweep", "loads", "--scene", "study.toml"), "study.toml: is no scene: it has axes, "),
        (("study", "bench.toml"), "bench.toml: is no study: it has force_limit, link, and it lacks axes; give"),
        (("study", "cell.toml"), "cell.toml: is no study: it has astm_e74, "),
        (("runs", "show", "bench.toml"), "bench.toml is a file, and no run; give the folder of a run"),
    ],
)
def test_a_file_of_another_kind_is_named_as_such(palpate: Palpate, words: tuple[str, ...], message: str) -> None:
    said = palpate(*words)
    assert said.status == 2
    assert said.complaint.startswith(message)
    assert len(said.complaint.splitlines()) == 1


# --- A bench, a disk or a package that cannot ends a command with one clear message, outputs of --------


SHORT = (*SWEEP, "--samples", "1", "--loads", "2 N, 3 N", "--dwell", "0.2 s")


def bench_file(description: BenchDescription) -> str:
    Path("lab.toml").write_text(hasty(description).to_toml(), encoding="utf-8")
    return "lab.toml"


# --- devices -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("form", "name", "update", "message"),
    [
        ("link", "shaker_amplifier", {"port": None}, "nothing answers at 127.0.0.1:"),
        ("link", "line", {"port": "/dev/ttyNONE"}, "there is no serial port /dev/ttyNONE"),
        ("device", "strain_indicator", {"unit": 9}, "unit 9: no valid answer"),
        ("device", "sensor_node_1", {"node": 9}, "sensor node 9 at virtual:"),
        (
            "link",
            "can",
            {"interface": "socketcan", "channel": "can_none"},
            "CAN bus socketcan:can_none cannot be opened",
        ),
    ],
)
def test_an_absent_device_is_named(
    palpate: Palpate,
    lab: str,
    sim: SimulatedBench,
    closed_port: int,
    form: str,
    name: str,
    update: dict[str, Any],
    message: str,
) -> None:
    update = {key: closed_port if value is None else value for key, value in update.items()}
    said = palpate(*SWEEP, "--bench", bench_file(altered(sim.description, **{form: {name: update}})))
    assert said.status == 1
    assert message in said.complaint
    assert not Path("runs").exists()


@pytest.mark.parametrize(
    ("device", "setting", "value", "message"),
    [
        ("generator", "", 0.0, "identifies itself as Acme G-9 1.0, the contract is for Palpate SG-1 1.0"),
        ("amplifier", "probe", 0x56781234, "word-order probe reads 0x56781234, should read 0x12345678"),
        ("node", "product", 1.0, "sensor node 1 at virtual:"),
        ("node", "probe", 0x78563412, "byte-order probe reads 0x78563412"),
    ],
)
def test_a_device_of_another_identity_or_word_order_is_refused(
    palpate: Palpate, benches: Benches, device: str, setting: str, value: float, message: str
) -> None:
    def doctor(sim: SimulatedBench) -> None:
        if setting:
            {"amplifier": sim.amplifier, "node": sim.nodes[0]}[device].settings[setting] = float(value)
        else:
            stranger = replace(sim.generator.contract, identity=Identity("Acme", "G-9", "1.0"))
            sim.generator.contract = stranger  # type: ignore[misc]

    benches.doctor = doctor  # type: ignore[method-assign]
    said = palpate(*SWEEP)
    assert (said.status, message in said.complaint) == (1, True)
    assert not Path("runs").exists()


@pytest.mark.parametrize(
    ("fault", "message", "left_on"),
    [
        pytest.param("line silence", "strain indicator at ", (False, False), marks=pytest.mark.slow),  # time-outs
        ("signal_generator connection_refused", "signal generator at ", (False, True)),
        ("shaker_amplifier connection_refused", "shaker amplifier at ", (False, False)),  # its watchdog sees to it
        pytest.param("can bus_off", "sensor node 1 at ", (False, False), marks=pytest.mark.slow),
    ],
)
def test_a_device_cut_off_in_the_middle_ends_the_run_with_the_other_outputs_off(
    palpate: Palpate, benches: Benches, on_progress: Any, fault: str, message: str, left_on: tuple[bool, bool]
) -> None:
    """An output that cannot be reached is left to the amplifier's watchdog, and that is said."""

    def shorten(sim: SimulatedBench) -> None:
        sim.description = hasty(sim.description)

    def progress(done: int, _total: int, what: str) -> None:
        if (done, what) == (1, "sample 1, 3 N"):
            Person(benches[0]).do(f"fault {fault}")

    benches.doctor = shorten  # type: ignore[method-assign]
    on_progress(progress)
    said = palpate(*SHORT, "--out", "day", "--json")
    assert (said.status, said.complaint.startswith(message)) == (1, True), said.err
    assert f"points already taken are kept in {Path('day').absolute()}" in said.err
    assert outputs(benches[0])[:2] == left_on
    assert ("outputs could not all be switched off" in said.err) is ("refused" in fault)
    run = Run.open(Path("day"))
    assert (run.status, [p["load_N"] for p in run.points()]) == ("failed", [2.0])


# --- the disk ------------------------------------------------------------------------------------------


def test_a_second_run_in_the_same_folder_or_one_among_other_files_is_refused(
    palpate: Palpate, benches: Benches
) -> None:
    Path("mine").mkdir()
    Path("mine/bench.toml").write_text("precious")
    assert palpate(*SHORT, "--out", "day", "--quiet").status == 0
    before = {path: path.read_bytes() for folder in ("day", "mine") for path in Path(folder).iterdir()}
    for command in (SWEEP, ("calibrate", "load-cell")):
        for out, why in (("day", "day already holds a run; choose another --out"), ("mine", "mine holds other files")):
            said = palpate(*command, "--out", out)
            assert (said.status, said.complaint.startswith(why)) == (2, True)
    assert {path: path.read_bytes() for folder in ("day", "mine") for path in Path(folder).iterdir()} == before
    assert len(benches) == 1


@contextmanager
def no_file_above(size: int) -> Iterator[None]:
    """A disk that is full after `size` bytes of a file."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_disk_that_is_full_from_the_start_leaves_nothing(palpate: Palpate) -> None:
    with no_file_above(1000):
        said = palpate(*SHORT)
    assert said.status == 1
    assert "cannot write" in said.complaint
    assert not Path("runs").exists()


# --- a defect in the code of an installed package is one message; the run keeps the traceback ---------

slow = pytest.mark.slow
RELAXATION = (Path(__file__).parents[1] / "examples" / "relaxation.py").read_text(encoding="utf-8")
FAILING = f"""{RELAXATION}
FAILS = [""]

def fails(hook):
    if FAILS[0] == hook:
        return {{}}["gone"]

class FailingWork(Holding):
    def take(self, step):
        FAILS[0] += "!"  # the second point fails
        fails("take!!")
        return super().take(step)

@dataclass(frozen=True)
class Failing(Relaxation):
    name = "failing"
    def check(self, target):
        fails("check")
    def plan(self, target):
        fails("plan")
        return super().plan(target)
    def begin(self, plan, lab, record):
        fails("begin")
        return FailingWork(lab, self.sample, self.force)
    def evaluate(self, points, plan, lab):
        FAILS[0] = FAILS[0].rstrip("!")
        fails("evaluate")
        return super().evaluate(points, plan, lab)
"""
OVEN = """
from palpate.drivers.devices.modbus_device import ModbusDevice
from palpate.instrument.bench.kinds import DeviceKind
from palpate.instrument.contracts.contract import Contract, Identity, probe
from palpate.simulators.wire.device import SimulatedDevice
CONTRACT = Contract("bad-oven", "oven", "modbus", Identity("Acme", "BO", "1.0"), (probe(0),))
KIND = DeviceKind(CONTRACT, ("modbus-tcp",), "acme_bad:Driver", "acme_bad:Simulated")
class Driver(ModbusDevice):
    contract = CONTRACT
    def connect(self):
        raise OSError("no such thing")
class Simulated(SimulatedDevice):
    contract = CONTRACT
"""
MEASURE = ("measure", "failing", "--scene", "ideal", "--readings", "2", "--out", "run", "--quiet")


@pytest.mark.parametrize(
    ("hook", "function", "points"),
    [
        pytest.param("check", "Failing.check", None, marks=slow),
        pytest.param("plan", "Failing.plan", None, marks=slow),
        pytest.param("begin", "Failing.begin", 0, marks=slow),
        ("take", "FailingWork.take", 1),
        pytest.param("evaluate", "Failing.evaluate", 2, marks=slow),
    ],
)
def test_a_defect_of_a_procedure_names_package_and_hook_and_its_run_keeps_traceback_and_points(
    install: Install, palpate: Palpate, hook: str, function: str, points: int | None
) -> None:
    install("acme", "palpate.procedures", {"failing": "acme_failing:Failing"}, acme_failing=FAILING)
    importlib.import_module("acme_failing").FAILS[0] = hook
    said = palpate(*MEASURE)
    message, *notes = said.complaint.splitlines()
    assert re.fullmatch(
        rf"acme 1.2: {function} failed: KeyError: 'gone' \(acme_failing.py, line \d+\); mend that package", message
    )
    assert (said.status, bool(notes), Path("run").exists()) == (1, points is not None, points is not None)
    if points is not None:
        run = Run.open(Path("run"))
        assert notes[0].startswith("the traceback is kept in ")
        assert (run.status, len(run.points())) == ("failed", points)
        (kept,) = [each["message"] for each in run.events() if each["kind"] == "traceback"]
        assert kept.startswith("Traceback (most recent call last):") and kept.endswith("KeyError: 'gone'\n")


@slow
def test_a_defect_of_a_driver_names_its_package(install: Install, palpate: Palpate, tmp_path: Path) -> None:
    install("acme", "palpate.devices", {"bad-oven": "acme_bad:KIND"}, acme_bad=OVEN)
    (tmp_path / "bad.toml").write_text(IDEAL_SCENE + '[device.oven]\nkind = "bad-oven"\n', encoding="utf-8")
    said = palpate("sweep", "loads", "--scene", "bad.toml", "--samples", "1", "--loads", "2 N", "--quiet")
    assert (said.status, said.complaint) == (
        1,
        "acme 1.2: Driver.connect failed: OSError: no such thing (acme_bad.py, line 11); mend that package",
    )


@slow
def test_a_defect_of_ours_shows_its_traceback_and_the_run_keeps_it(
    palpate: Palpate, monkeypatch: pytest.MonkeyPatch
) -> None:
    from palpate.procedures.measurements.loads import LoadSweep

    monkeypatch.setattr(LoadSweep, "evaluate", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError) as raised:
        palpate("sweep", "loads", "--scene", "ideal", "--samples", "1", "--loads", "2 N", "--out", "run", "--quiet")
    assert raised.value.__notes__[0].startswith("the traceback is kept in ")
    assert [each["kind"] for each in Run.open(Path("run")).events()][-2:] == ["traceback", "failed"]
