"use strict";
// The oscilloscope: shows the last trace from its trigger on, and reads it between two cursors.
// The voltages are those that the bench acquired, in V; the screen shows mV over ms after the trigger.

const COLOURS = ["#1f4e9c", "#c1440e", "#1b7f3b", "#7a3b9c", "#0f8a8a", "#a0740a", "#c2185b", "#555555", "#5d8a00"];
const BEFORE = 0.1; // part of the screen before the trigger
const USUAL = 125; // samples on the screen with the time base "auto", or half the trace if that is shorter
const sizeOf = place => ({ width: Math.max(200, place.clientWidth), height: Math.max(80, place.clientHeight) });
const HYSTERESIS = 0.1; // of peak to peak

class Oscilloscope {
  constructor() {
    this.trace = null; // {rate, films, rows (of Float32Array, V), begun (bench time in s), point, arrived (ms)}
    this.paced = false; // whether a trace is played at the pace at which it was acquired
    this.frozen = false;
    this.hidden = new Set();
    this.cursors = [0.25, 0.75]; // as parts of the screen
    this.window = null; // what is on the screen: {t (ms), rows (mV)}
    this.draws = 0;
    this.changed = true;
    for (const [text, seconds] of [["auto", 0], ["1 ms", .001], ["2 ms", .002], ["5 ms", .005], ["10 ms", .01],
      ["20 ms", .02], ["50 ms", .05], ["0.1 s", .1], ["0.2 s", .2], ["0.5 s", .5], ["1 s", 1], ["5 s", 5]]) {
      $("base").append(new Option(seconds ? `${text}/div` : text, seconds));
    }
    for (const name of ["base", "trigger", "edge", "level", "scale"]) {
      $(name).addEventListener("input", () => { this.changed = true; if (name === "scale") this.build(); });
    }
    $("freeze").addEventListener("click", () => this.freeze(!this.frozen));
    $("readings").addEventListener("click", event => this.toggle(event.target.closest("tr")));
    new ResizeObserver(() => this.resize()).observe($("screen"));
    const frame = () => { this.frame(); requestAnimationFrame(frame); };
    requestAnimationFrame(frame);
  }

  show(told) { // a message of a trace
    if (this.frozen && told.point === undefined) return;
    const bytes = Uint8Array.from(atob(told.voltage), c => c.charCodeAt(0));
    const all = new Float32Array(bytes.buffer);
    const rows = told.films.map((_, i) => all.subarray(i * told.samples, (i + 1) * told.samples));
    const before = this.trace;
    this.trace = { rate: told.rate, films: told.films, rows, samples: told.samples, of: told.of, begun: told.bench_ns / 1e9,
      point: told.point, arrived: performance.now() };
    if (!before || before.films.join("\n") !== told.films.join("\n")) { this.window = null; this.build(); }
    this.changed = true;
  }

  freeze(frozen) {
    this.frozen = frozen;
    $("freeze").textContent = frozen ? "Run" : "Freeze";
    $("freeze").setAttribute("aria-pressed", frozen);
  }

  toggle(row) {
    if (!row || row.dataset.film === undefined) return;
    const film = Number(row.dataset.film);
    if (!this.hidden.delete(film)) this.hidden.add(film);
    this.plot.setSeries(film + 1, { show: !this.hidden.has(film) });
    this.changed = true;
  }

  build() { // anew, with a line for each film
    if (!this.trace) return;
    if (this.plot) this.plot.destroy();
    const films = this.trace.films, chosen = $("trigger").value;
    $("trigger").replaceChildren(...films.map((film, i) => new Option(film, i)));
    $("trigger").value = films[chosen] ? chosen : Math.max(0, films.indexOf("load")); // without one, the first film
    const own = $("scale").value === "own", scale = i => own ? `mV${i}` : "mV";
    const font = { font: "11px sans-serif", labelFont: "11px sans-serif", labelSize: 16 };
    const within = i => (u, splits) => splits.map(v => // numbers and lines of a film are in its lane
      !own || (!this.hidden.has(i) && v >= u.series[i + 1].min && v <= u.series[i + 1].max) ? v : null);
    const axis = (i, size) => ({ scale: scale(i), size, filter: within(i), grid: { filter: within(i) },
      ticks: { filter: within(i) }, space: own ? 16 : 30, ...font, ...(own ? { stroke: COLOURS[i % COLOURS.length] } : {}) });
    const scales = { x: { time: false, range: (u, low, high) => [low, high] } };
    for (const i of films.keys()) {
      scales[scale(i)] = own ? { range: (u, low, high) => this.lane(i, low, high) } : { auto: true };
    }
    this.plot = new uPlot({
      ...sizeOf($("screen")), scales, legend: { show: false }, cursor: { show: false },
      series: [{}, ...films.map((film, i) => ({ label: film, scale: scale(i), stroke: COLOURS[i % COLOURS.length],
        width: 1.2, points: { show: false }, show: !this.hidden.has(i) }))],
      axes: [{ label: "ms after the trigger", size: 28, ...font },
        // all in the place of the first one: the others, which come before it, take none
        ...films.slice(1).map((_, i) => axis(i + 1, 0)).filter(() => own), { ...axis(0, 46), label: "mV" }],
      hooks: { draw: [u => this.mark(u)] },
    }, this.window ? [this.window.t, ...this.window.rows] : [[0]].concat(films.map(() => [null])), $("screen"));
    this.plot.over.addEventListener("mousedown", event => this.drag(event));
  }

  lane(film, low, high) { // range of a scale that shows a film in its lane, below the films before it
    if (low === null || low === undefined) return [0, 1];
    const shown = this.trace.films.map((_, i) => i).filter(i => !this.hidden.has(i)), place = Math.max(0, shown.indexOf(film));
    const height = 1.15 * ((high - low) || Math.abs(high) || 1), middle = (low + high) / 2;
    return [middle - height * (shown.length - place - 0.5), middle + height * (place + 0.5)];
  }

  resize() {
    if (this.plot) this.plot.setSize(sizeOf($("screen")));
  }

  drag(event) { // the nearer cursor follows the mouse until its button is released
    if (!this.window) return;
    const box = this.plot.over.getBoundingClientRect();
    const place = e => Math.min(1, Math.max(0, (e.clientX - box.left) / box.width));
    const [a, b] = this.cursors.map(each => Math.abs(each - place(event)));
    const move = e => { this.cursors[a <= b ? 0 : 1] = place(e); this.plot.redraw(false); this.read(); };
    const end = () => { removeEventListener("mousemove", move); removeEventListener("mouseup", end); };
    addEventListener("mousemove", move);
    addEventListener("mouseup", end);
    move(event);
  }

  frame() {
    const trace = this.trace;
    if (!trace || document.hidden) return;
    const playing = this.paced && !this.frozen && trace.point === undefined && !trace.played;
    if (!playing && !this.changed) return;
    let head = trace.samples;
    if (playing) head = Math.min(head, Math.floor((performance.now() - trace.arrived) / 1000 * trace.rate));
    if (playing && head === trace.samples) trace.played = true;
    const wanted = Number($("base").value) ? Math.round(Number($("base").value) * 10 * trace.rate)
      : Math.min(USUAL, Math.floor(trace.samples / 2));
    const shown = Math.max(2, Math.min(wanted, trace.samples));
    if (head < shown) { if (!this.window) this.changed = true; return; }
    this.draw(trace, head, shown);
    this.changed = false;
  }

  draw(trace, head, shown) {
    const crossing = this.crossing(trace.rows[Number($("trigger").value)], head, shown);
    const first = Math.max(0, Math.min(head - shown, Math.ceil(crossing - BEFORE * shown)));
    const step = 1000 / trace.rate, t = new Float64Array(shown);
    for (let i = 0; i < shown; i++) t[i] = (first + i - crossing) * step;
    const rows = trace.rows.map(row => {
      const part = new Array(shown);
      for (let i = 0; i < shown; i++) part[i] = Number.isFinite(row[first + i]) ? 1000 * row[first + i] : null;
      return part;
    });
    this.window = { t, rows };
    this.plot.setData([t, ...rows]);
    this.draws++;
    this.read();
    $("trace").textContent = (trace.point === undefined ? `sampled after bench time ${trace.begun.toFixed(3)} s, not recorded`
      : `point ${trace.point}, as recorded`) + ` · ${trace.of > trace.samples ? "the last " : ""}${trace.samples}`
      + `${trace.of > trace.samples ? ` of ${trace.of}` : ""} samples at ${Number(trace.rate.toPrecision(6))} Hz`
      + (this.triggered ? "" : " · no trigger");
  }

  // The last place, in samples, at which the row crosses the level and after which the screen can be filled.
  crossing(row, head, shown) {
    let low = Infinity, high = -Infinity;
    for (let i = 0; i < head; i++) { if (row[i] < low) low = row[i]; if (row[i] > high) high = row[i]; }
    const typed = $("level").value.trim(), edge = Number($("edge").value);
    const level = typed === "" || !Number.isFinite(Number(typed)) ? (low + high) / 2 : Number(typed) / 1000;
    const away = edge * level - HYSTERESIS * (high - low);
    const latest = head - Math.floor((1 - BEFORE) * shown), earliest = Math.floor(BEFORE * shown);
    this.triggered = true;
    for (let i = Math.min(latest, head - 1); i > earliest; i--) {
      if (!(edge * row[i - 1] < edge * level && edge * row[i] >= edge * level)) continue;
      for (let j = i - 1; j >= 0 && edge * row[j] < edge * level; j--) {
        if (edge * row[j] <= away) return i - 1 + (level - row[i - 1]) / (row[i] - row[i - 1]);
      }
    }
    this.triggered = false;
    return Math.max(0, head - shown);
  }

  times() { // of the cursors [ms]
    const { t } = this.window;
    return this.cursors.map(part => t[0] + part * (t[t.length - 1] - t[0]));
  }

  mark(u) { // trigger and cursors
    if (!this.window) return;
    const line = (at, colour, name) => {
      const x = Math.round(u.valToPos(at, "x", true)) + 0.5;
      u.ctx.strokeStyle = u.ctx.fillStyle = colour;
      u.ctx.beginPath();
      u.ctx.moveTo(x, u.bbox.top);
      u.ctx.lineTo(x, u.bbox.top + u.bbox.height);
      u.ctx.stroke();
      u.ctx.fillText(name, x + 6, u.bbox.top + 10);
    };
    u.ctx.save();
    u.ctx.lineWidth = 1;
    u.ctx.font = "11px sans-serif";
    if (this.triggered) line(0, "#bbb", "T");
    this.times().forEach((at, i) => line(at, "#222", "AB"[i]));
    u.ctx.restore();
  }

  read() { // what the cursors read of each film
    const [a, b] = this.times(), { t, rows } = this.window, step = t[1] - t[0];
    const at = (row, time) => {
      const place = Math.min(row.length - 1, Math.max(0, (time - t[0]) / step)), i = Math.min(row.length - 2, Math.floor(place));
      return row[i] === null || row[i + 1] === null ? NaN : row[i] + (place - i) * (row[i + 1] - row[i]);
    };
    const from = Math.ceil((Math.min(a, b) - t[0]) / step - 1e-9), to = Math.floor((Math.max(a, b) - t[0]) / step + 1e-9);
    const found = rows.map(row => {
      let low = Infinity, high = -Infinity;
      for (let i = from; i <= to; i++) if (row[i] !== null) { low = Math.min(low, row[i]); high = Math.max(high, row[i]); }
      return [at(row, a), at(row, b), high - low];
    });
    const span = Math.abs(b - a);
    $("readings").caption.textContent = `B − A ${digits(b - a)} ms (${digits(1000 / span)} Hz); mV`;
    fill($("readings").tHead, [["film", "A", "B", "B − A", "p–p"]], "th");
    fill($("readings").tBodies[0], found.map(([va, vb, pp], i) =>
      [this.trace.films[i], digits(va), digits(vb), digits(vb - va), digits(pp)]));
    [...$("readings").tBodies[0].rows].forEach((row, i) => {
      row.dataset.film = i;
      row.classList.toggle("off", this.hidden.has(i));
      row.cells[0].style.color = COLOURS[i % COLOURS.length];
    });
  }
}
