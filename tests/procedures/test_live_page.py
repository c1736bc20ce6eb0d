"""The live page in a browser: what it draws and reads, and that its buttons work."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from selenium import webdriver
from selenium.common.exceptions import StaleElementReferenceException
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.support.ui import WebDriverWait

import palpate
from tests.benchmarks.live import OPTIONS
from tests.procedures.live import Served, served, with_a_run
from tests.procedures.test_live import HEADER, LONG
from tests.runs import NIGHTLY, made

pytestmark = pytest.mark.slow

PATIENCE = 40  # s
COLOURS = {"rigid": (0x1F, 0x4E, 0x9C), "total": (0xC1, 0x44, 0x0E)}


class Page:
    """A page in the browser."""

    def __init__(self, driver: Any) -> None:
        self.driver = driver

    def text(self, css: str) -> str:
        found: str = self.driver.find_element("css selector", css).text
        return found

    def js(self, script: str, *of: object) -> Any:
        return self.driver.execute_script(script, *of)

    def click(self, button: str) -> None:
        self.driver.find_element("id", button).click()

    def until(self, holds: Callable[[], object]) -> None:
        """Wait until something holds on the page."""
        WebDriverWait(self.driver, PATIENCE, 0.05, (StaleElementReferenceException,)).until(lambda _: holds())

    def readings(self) -> list[list[str]]:
        """The cells of the oscilloscope's table."""
        rows = (
            "return [...document.querySelectorAll('#readings tbody tr')].map(r => [...r.cells].map(c => c.textContent))"
        )
        found: list[list[str]] = self.js(rows)
        return found

    def drawn(self, css: str, colour: tuple[int, int, int]) -> int:
        """How many pixels of a canvas have about this colour."""
        script = """const c = document.querySelector(arguments[0] + ' canvas'), [r, g, b] = arguments[1];
            const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
            let n = 0;
            for (let i = 0; i < d.length; i += 4) {
                n += d[i + 3] > 128 && Math.hypot(d[i] - r, d[i + 1] - g, d[i + 2] - b) < 40;
            }
            return n;"""
        found: int = self.js(script, css, list(colour))
        return found


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    program, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if program is None or driver is None:
        why = "apt-get install chromium chromium-driver, which these tests need"
        if os.environ.get("PALPATE_BROWSER") == "required":
            pytest.fail(why)
        pytest.skip(why)
    options = webdriver.ChromeOptions()
    options.binary_location = program
    for each in (*OPTIONS, f"--user-data-dir={tmp_path_factory.mktemp('browser')}"):
        options.add_argument(each)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    with webdriver.Chrome(options=options, service=Service(driver)) as opened:
        yield opened


@pytest.fixture
def page(browser: Any) -> Iterator[Page]:
    """A page of which the browser has nothing to complain: no mistake, and nothing that its policy forbids."""
    browser.get_log("browser")
    yield Page(browser)
    complaints = [each["message"] for each in browser.get_log("browser") if each["level"] == "SEVERE"]
    assert [each for each in complaints if "net::ERR_" not in each and "status of 403" not in each] == []
    browser.get("about:blank")


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return with_a_run(tmp_path_factory.mktemp("store"))


@pytest.fixture
def live(store: Path) -> Iterator[Served]:
    with served(store, "live", "done") as found:
        yield found


def read_by_hand(run: palpate.Run, film: str, a: float, b: float) -> list[float]:
    """What cursors at parts a and b of a whole record read of the last point: A, B, B - A, peak to peak [mV]."""
    volts = 1e3 * run.waveform(3, film).astype(float)
    places = np.array([a, b]) * (len(volts) - 1)
    at = np.interp(places, np.arange(len(volts)), volts)
    between = volts[int(np.ceil(places[0])) : int(places[1]) + 1]
    return [at[0], at[1], at[1] - at[0], np.ptp(between)]


def test_waveforms_are_drawn_and_cursors_read_them_right(page: Page, live: Served, store: Path) -> None:
    run = palpate.read(store / "done")
    page.driver.get(live.address)
    page.until(lambda: page.text("#trace").startswith("point 3, as recorded · 250 samples at 250 Hz"))
    assert "no trigger" not in page.text("#trace")
    assert min(page.drawn("#screen", colour) for colour in COLOURS.values()) > 200
    page.js("$('base').value = '5'; $('base').dispatchEvent(new Event('input'))")  # the whole record
    page.until(lambda: page.text("#trace").endswith("no trigger"))
    assert page.text("#readings caption") == "B − A 498 ms (2.008 Hz); mV"  # half of 249 steps of 4 ms
    assert [row[0] for row in page.readings()] == ["rigid", "total"]
    for film, *cells in page.readings():
        assert [float(cell) for cell in cells] == pytest.approx(read_by_hand(run, film, 0.25, 0.75), rel=1e-3)
    over = page.driver.find_element("css selector", "#screen .u-over")
    width = over.size["width"]
    actions = webdriver.ActionChains(page.driver)
    actions.move_to_element_with_offset(over, round(-0.2 * width), 0).click_and_hold()
    actions.move_by_offset(round(0.15 * width), 0).release().perform()  # A goes from 0.3 to 0.45 of the screen
    span = float(page.text("#readings caption").split()[4 - 1])
    assert span == pytest.approx(0.3 * 996, abs=2 * 996 / width)
    for film, *cells in page.readings():
        assert float(cells[-1]) == pytest.approx(read_by_hand(run, film, 0.45, 0.75)[-1], rel=1e-3)


def test_the_trigger_is_where_the_film_crosses_the_level_that_was_typed(page: Page, live: Served) -> None:
    page.driver.get(live.address)
    page.until(lambda: page.text("#trace").startswith("point 3"))
    page.js("$('level').value = '1'; $('edge').value = '-1'; $('level').dispatchEvent(new Event('input'))")
    crossing = """const {t, rows} = scope.window, i = t.findIndex(each => each >= 0);
        return [rows[0][i - 1], rows[0][i],
            rows[0][i - 1] + (rows[0][i] - rows[0][i - 1]) * -t[i - 1] / (t[i] - t[i - 1])]"""
    page.until(lambda: page.js(crossing)[2] == pytest.approx(1.0, abs=1e-3))
    before, after, _ = page.js(crossing)
    assert before > 1.0 >= after


def test_films_are_frozen_and_the_run_is_paused_goes_on_and_stops_by_buttons_and_the_token(
    page: Page, tmp_path: Path
) -> None:
    with served(tmp_path, *LONG, "--live", "--out", str(tmp_path / "run")) as live:
        page.driver.get(live.address)  # without the token
        page.until(lambda: page.text("#status") == "running" and page.text("#simulated") == "SIMULATED")
        page.click("stop")
        page.until(lambda: page.text("#link").startswith("wrong token"))
        page.driver.get("about:blank")
        page.driver.get(f"{live.address}#{live.token}")
        page.until(lambda: page.text("#trace").startswith("sampled after bench time"))
        page.click("freeze")
        frozen, points = page.text("#trace"), page.js("return state.last")
        page.until(lambda: page.js("return state.last") > points + 20)
        assert page.text("#trace") == frozen
        page.click("freeze")
        page.until(lambda: page.text("#trace") != frozen)
        for button, status in (("pause", "paused"), ("pause", "running"), ("stop", "stopped")):
            page.click(button)
            shown = [status, status == "paused"]
            page.until(lambda shown=shown: [page.text("#status"), page.text("#pause") == "Go on"] == shown)  # type: ignore[misc]
        live.process.wait()
    assert palpate.read(tmp_path / "run").status == "stopped"


def test_a_page_finds_its_server_again_and_ten_pages_show_a_thousand_points(page: Page, tmp_path: Path) -> None:
    made(tmp_path / "many", HEADER, (({"x": n / 100, "x_u": 0.5, "valid": n != 7}, {}) for n in range(1000)))

    def shown() -> bool:
        told = page.text("#count") == "1000 of ? points, 1 not valid"
        return told and bool(page.js("return drawn.xs.length === 1000"))

    with served(tmp_path, "live", "many") as live:
        page.driver.get(live.address)
        page.until(shown)
        assert page.drawn("#plot", COLOURS["rigid"]) > 1000
    page.until(lambda: page.text("#link") != "")
    with served(tmp_path, "live", "many", "--port", str(live.port)) as live:
        page.until(lambda: page.text("#link") == "" and shown())
        first, *_ = page.driver.window_handles
        for number in range(9):  # a browser allows six connections to a name
            page.driver.switch_to.new_window("tab")
            page.driver.get(live.address.replace("127.0.0.1", "localhost") if number > 3 else live.address)
            page.until(shown)
        for handle in set(page.driver.window_handles) - {first}:
            page.driver.switch_to.window(handle)
            page.driver.close()
        page.driver.switch_to.window(first)


def test_the_page_of_a_campaign_says_which_step_it_is(page: Page, tmp_path: Path) -> None:
    file = tmp_path / "nightly.toml"
    file.write_text(NIGHTLY)
    with served(tmp_path, "campaign", str(file), "--live") as live:
        page.driver.get(live.address)
        page.until(lambda: page.text("#campaign small") == "nightly: step 2 of 3, films")
        assert [row.split()[0] for row in page.text("#campaign table").splitlines()] == ["cell", "films", "sweep"]
        page.until(lambda: page.text("#campaign small") == "nightly: all 3 steps are done")


def test_a_served_bench_has_no_points_but_devices_and_faults(page: Page, tmp_path: Path) -> None:
    with served(tmp_path, "serve", "ideal", "--live") as live:
        page.driver.get(live.address)
        page.until(lambda: page.text("#status") == "served" and page.text("#happened") == "Faults")
        assert page.text("#simulated") == "SIMULATED"
        assert "generator off" in page.text("#devices")
        assert page.text("#plotted") == ""


def test_names_of_others_are_text(page: Page, tmp_path: Path) -> None:
    name = "<script>document.title = 'taken'</script><img src=x onerror=\"document.title='taken'\">"
    header = {**HEADER, "procedure": name, "settings": {name: name}, "devices": {name: name}, "scene": {"name": name}}
    made(
        tmp_path / "named",
        header,
        [({"sample": name, name: 1.0, "y": 2.0, "y_u": 1.0}, {}), ({"sample": "b", "y": 2.0}, {})],
    )
    with served(tmp_path, "live", "named") as live:
        page.driver.get(live.address)
        page.until(lambda: name in page.text("#latest") and name in page.text("#devices"))
        assert page.text("#procedure") == name and page.text("#groups").startswith(f"● sample {name}")
        assert "taken" not in page.driver.title.replace(name, "")
        assert page.js("return document.querySelectorAll('img, body script:not([src])').length") == 0


def test_readings_of_many_films_are_shown_whole(page: Page, tmp_path: Path) -> None:
    wave = -0.00007629 * np.cos(np.arange(100) / 4)
    films = {f"rigid_{number}": (250.0, wave) for number in range(16)}
    made(tmp_path / "many", HEADER, [({"y": 2.0}, films)])
    with served(tmp_path, "live", "many") as live:
        page.driver.get(live.address)
        page.until(lambda: len(page.readings()) == 16)
        shown, needed = page.js("const r = document.getElementById('read'); return [r.clientWidth, r.scrollWidth]")
        assert needed <= shown
        lines = "const [a, b] = [...document.querySelectorAll('#latest th')].map(e => e.offsetHeight); return [a, b]"
        first, second = page.js(lines)
        assert first == second
