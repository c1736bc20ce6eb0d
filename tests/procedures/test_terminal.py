"""What comes from outside does nothing to a terminal, and what is no log or too little of a system is said."""

from __future__ import annotations

import errno
import os
import resource
import unicodedata
from pathlib import Path
from unittest.mock import Mock

import pytest
from rich.text import Text

from palpate.drivers.links.modbus import ModbusLink
from palpate.drivers.logs.bus_log import Link, Packet, PcapngWriter
from palpate.instrument.bench.links import TcpLink
from palpate.instrument.errors import LinkError
from palpate.procedures.console.terminal import clean, console
from tests.procedures.conftest import IDEAL_SCENE, Palpate

EVIL = "evil\x1b[31m\x07\x08\r\x9b2J\u202e"
SHOWN = "evil␛[31m␇␈␍\ufffd2J\ufffd"
SCENE = IDEAL_SCENE.replace('"ideal"', '"' + "".join(f"\\u{ord(c):04x}" for c in EVIL) + '"')
SMALL = ("sweep", "loads", "--samples", "1", "--loads", "2 N", "--dwell", "0.1 s")


def harmless(text: str) -> bool:
    return all(character.isprintable() or character in "\n\t\ufffd" for character in text)


def test_whatever_a_text_holds_of_controls_only_tab_and_line_feed_reach_the_terminal() -> None:
    every = [chr(code) for code in range(0x3000)]
    cleaned = [clean(character) for character in every]
    controls = {c for c in every if unicodedata.category(c) in ("Cc", "Zl", "Zp")}
    assert set(cleaned) & controls == {"\t", "\n"}
    assert not {c for c in cleaned if unicodedata.bidirectional(c) in ("LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI")}
    assert all(len(shown) == 1 for shown in cleaned)
    assert all(shown == c for shown, c in zip(cleaned, every, strict=True) if c.isprintable())


def test_names_of_scenes_runs_and_files_reach_the_terminal_as_pictures(palpate: Palpate, tmp_path: Path) -> None:
    (tmp_path / f"{EVIL}.toml").write_text(SCENE)
    for command in (
        ("scene", "show", f"{EVIL}.toml"),
        ("scene", "check", f"{EVIL}.toml"),
        ("scene", "show", f"no {EVIL}"),
        ("runs", "show", f"no {EVIL}"),
        ("bus", "show", f"{EVIL}.pcapng"),
        (f"no {EVIL}",),
        ("scene", "show", f"{EVIL}.toml", EVIL),
        (*SMALL, "--samples", EVIL),
    ):
        said = palpate(*command)
        assert harmless(said.out + said.err), command
        assert "Traceback" not in said.err
    assert "evil␛[31m" in palpate("scene", "show", f"{EVIL}.toml").out


@pytest.mark.slow
def test_a_run_of_such_a_scene_in_such_a_folder_is_shown_in_pictures(palpate: Palpate, tmp_path: Path) -> None:
    (tmp_path / f"{EVIL}.toml").write_text(SCENE)
    for command in (
        (*SMALL, "--scene", f"{EVIL}.toml", "--out", EVIL),
        ("scene", "explain", f"{EVIL}.toml"),
        ("runs", "show", EVIL),
        ("runs", "list", "--out", "."),
        ("runs", "check", EVIL),
        ("runs", "export", EVIL, "--to", "csv"),
    ):
        said = palpate(*command)
        assert said.status == 0, said.err
        assert harmless(said.out + said.err), command
        assert "evil" in said.out


def test_what_a_bus_log_says_of_its_devices_reaches_the_terminal_as_pictures(palpate: Palpate) -> None:
    with Path("log.pcapng").open("wb") as file:
        log = PcapngWriter(file)
        log.write(Packet(1, EVIL, Link.LINE, False, bytes.fromhex("01 03 02 00 01 79 84")))
        log.end()
    said = palpate("bus", "show", "log.pcapng")
    assert (said.status, SHOWN in said.out, harmless(said.out)) == (0, True, True)


def test_colours_of_our_own_are_kept(capsys: pytest.CaptureFixture[str]) -> None:
    console(force_terminal=True, color_system="standard").print(Text(EVIL, "bold red"))
    assert capsys.readouterr().out.startswith("\x1b[1;31mevil␛[31m")


# --- files that are none, and too few of them ------------------------------------------------------------


@pytest.mark.parametrize("command", ["show", "replay"])
@pytest.mark.parametrize("name", ["/", ".", "/dev/null", "folder.blf", "pipe.pcapng", "pipe.asc"])
def test_what_is_no_bus_log_is_one_message(palpate: Palpate, command: str, name: str) -> None:
    Path("folder.blf").mkdir()
    for pipe in ("pipe.pcapng", "pipe.asc"):
        os.mkfifo(pipe)
    said = palpate("bus", command, name).refusal
    assert f"{name}: is no file, so no bus log" in said or f"{name}: no bus log" in said


def test_too_few_open_files_are_refused_before_anything_is_begun(
    palpate: Palpate, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(resource, "getrlimit", lambda _what: (12, 4096))
    told = "only 12 files may be open at once, but a bench can need 128; run ulimit -n 128 first"
    assert palpate(*SMALL).complaint == told
    assert not Path("runs").exists()


def test_a_link_that_fails_for_want_of_files_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    link = ModbusLink.tcp(TcpLink(host="127.0.0.1", port=9))
    monkeypatch.setattr(link.client, "connect", lambda: False)
    monkeypatch.setattr(os, "open", Mock(side_effect=OSError(errno.EMFILE, os.strerror(errno.EMFILE))))
    with pytest.raises(LinkError, match=r"cannot be opened: Too many open files in this program; .* ulimit -n"):
        link.open()
