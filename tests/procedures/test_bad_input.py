"""What cannot be is refused with one clear message and an exit status, and leaves nothing behind."""

from __future__ import annotations

import itertools
import os
from pathlib import Path

import pytest

from palpate.instrument.calibration.files import write_calibration
from palpate.instrument.calibration.load_cell import THESIS_LOAD_CELL
from palpate.simulators.scenes.heads import shipped
from tests.instrument.test_map_files import TRANSMITTER
from tests.procedures.conftest import IDEAL_SCENE, Palpate

SWEEP = ("sweep", "loads")
SMALL = (*SWEEP, "--samples", "1", "--loads", "2 N, 3 N")
NO_TEXT = os.fsdecode(b"\xff")
LONG = 300 * "x"


# --- texts ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("option", "text", "message"),
    [
        ("--loads", "", "'' is not a quantity"),
        ("--loads", "2", "'2' has no unit where N belongs; write for example '3 N'"),
        ("--loads", "24 kPa", "'24 kPa' is in kPa where N belongs"),
        ("--loads", "nan N", "'nan N'"),
        ("--loads", "1e400 N", "'1e400 N' is not finite"),
        ("--loads", "-1 N", "load -1 N peak to peak is not above zero"),
        ("--loads", "2 N,1 N", "must not decrease"),
        ("--loads", "1 N,,2 N", "'' is not a quantity"),
        ("--loads", "1.5 N:4 N", "give first:last:step"),
        ("--loads", "4 N:1 N:1 N", "last >= first and step > 0"),
        ("--loads", "1 N:1e308 N:1e-300 N", "more than 1000 loads"),
        ("--loads", "1e9 N", "above the bench's force limit of 10 N; loads up to 9.09 N are possible"),
        ("--loads", NO_TEXT, "is not a quantity"),
        ("--samples", "", "unknown sample ''; valid: 1, 2, 3, 4, 5, 6"),
        ("--samples", "7", "unknown sample '7'"),
        ("--samples", "1-", "sample range '1-' lacks an end; write for example '1-3'"),
        ("--samples", "3-1", "runs backwards; write '1-3'"),
        ("--samples", "1,1", "named twice"),
        ("--samples", NO_TEXT, "unknown sample"),
        ("--dwell", "1", "'1' has no unit where s belongs"),
        ("--dwell", "0 s", "dwell 0 s is not above 0 and at most 3600 s"),
        ("--dwell", "2 h", "dwell 7200 s is not above 0 and at most 3600 s"),
        ("--dwell", "99 ms", "dwell 99 ms is below one cycle of 10 Hz; dwell 100 ms or longer"),
        ("--tolerance", "0.01 %", "gain scatter binds, and a run has 10,000 load sets at most"),
        ("--tolerance", "-1 %", "--tolerance: '-1 %' is not above 0"),
        ("--tolerance", "5", "--tolerance: '5' is 500 %, above the 50 % that are allowed; give a share such as"),
        ("--tolerance", "nan", "--tolerance: 'nan' is no share; give a share such as '5 %' or 0.05"),
        ("--frequency", "10 N", "'10 N' is in N where Hz belongs"),
        ("--frequency", "1 kHz", "outside 0.5 to 100 Hz"),
        ("--frequency", "10.0004 Hz", "between the exciter's steps of 0.001 Hz; take 10 Hz"),
        ("--model", "colum", "unknown model 'colum' (did you mean 'column'?)"),
        ("--scene", "thesis_singel", "unknown scene 'thesis_singel' (did you mean 'thesis_single'?)"),
        ("--scene", NO_TEXT, "unknown scene"),
        ("--scene", "", "unknown scene ''"),
    ],
)
def test_a_bad_text_is_refused(palpate: Palpate, option: str, text: str, message: str) -> None:
    said = palpate(*SWEEP, option, text)
    assert (said.status, message in said.complaint) == (2, True), said.err
    assert not Path("runs").exists()


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
