"use strict";
// The page of a run: reads the stream of docs/how-to/live.md and shows it. All text goes into the page as text.

const $ = id => document.getElementById(id);
const MOST_POINTS = 2048; // that are kept; of more, each second one is left out, again and again
const LATEST = 12, MOST_INCIDENTS = 200, MOST_GROUPS = 9;
const REDRAW = 100; // ms between two drawings of points and tables
const LATEST_TRACE = 1000; // ms between two looks for the stored waveforms of the latest point
const COVER = 2; // standard uncertainties on each side of a point

const digits = (value, n = 4) => value === null || value === undefined || Number.isNaN(value) ? "–"
  : typeof value !== "number" ? String(value)
    : Math.abs(value) >= 10 ** n ? value.toFixed(0) : String(Number(value.toPrecision(n)));
const clock = seconds => {
  const s = Math.max(0, Math.round(seconds)), two = n => String(Math.floor(n)).padStart(2, "0");
  return s >= 3600 ? `${Math.floor(s / 3600)}:${two(s / 60 % 60)}:${two(s % 60)}` : `${Math.floor(s / 60)}:${two(s % 60)}`;
};
const words = name => name.replaceAll("_", " ");
const percent = u => u === null || u === undefined ? "–" : `${digits(100 * u, 3)} %`;

function fill(body, rows, kind = "td") { // cells whose texts differ are written, and no others
  while (body.rows.length > rows.length) body.deleteRow(-1);
  rows.forEach((texts, r) => {
    const row = body.rows[r] || body.insertRow();
    while (row.cells.length > texts.length) row.deleteCell(-1);
    texts.forEach((text, c) => {
      const cell = row.cells[c] || row.appendChild(document.createElement(kind));
      if (cell.textContent === text) return;
      cell.textContent = text;
      cell.classList.toggle("n", /^[-+−–.\d][-+−–.\de±% ]*$/.test(text) || (kind === "th" && c > 0));
    });
  });
}

const state = {};

function restart() { // forget the run before
  Object.assign(state, { points: [], latest: [], every: 1, last: 0, invalid: 0, planned: null, incidents: [], count: 0,
    devices: {}, columns: [], promise: null, step: null, summary: null, status: "waiting for the run", scene: null,
    chosen: false, fresh: false, bench: null });
  $("verdict").hidden = $("beside").hidden = $("devices").hidden = true;
  fill($("incidents").querySelector("tbody"), []);
}

const scalar = value => value === null || ["number", "string", "boolean"].includes(typeof value);

const on = {
  page(told) {
    restart();
    $("campaign").hidden = true;
    state.stored = told.stored;
    state.hello = told;
    $("controls").hidden = !told.controls.length;
    $("pause").hidden = !told.controls.includes("pause");
    $("stop").hidden = !told.controls.includes("stop");
  },
  begun(told) {
    const hello = state.hello;
    restart();
    if (hello) Object.assign(state, { every: hello.every, last: hello.points, invalid: hello.invalid });
    state.hello = null; // a run that begins while the page is open begins with no points
    state.status = "running";
    state.scene = told.scene;
    scope.paced = told.scene === null; // such a bench takes the time of the wall
    $("procedure").textContent = told.procedure;
    $("run").textContent = [told.run, told.scene === null ? "" : `scene ${told.scene}`,
      told.seed === null ? "" : `seed ${told.seed}`, `started ${told.started}`].filter(Boolean).join(" · ");
    $("run").title = $("run").textContent;
    $("simulated").hidden = $("watermark").hidden = !told.simulated;
    document.title = `${told.procedure} – palpate live`;
  },
  about(told) {
    state.columns = told.columns;
    state.devices = Object.fromEntries(Object.entries(told.devices).map(([name, serial]) => [name, { serial, times: 0, last: 0 }]));
    state.incidents.toReversed().forEach(blame);
  },
  planned(told) { state.planned = told; },
  step(told) { state.step = told; },
  promise(told) { state.promise = told; },
  point(told) {
    const values = Object.fromEntries(Object.entries(told.values).filter(([, value]) => scalar(value)));
    if (told.id > state.last) { state.last = told.id; state.invalid += values.valid === false; }
    values.id = told.id;
    state.latest.unshift(values);
    state.latest.length = Math.min(state.latest.length, LATEST);
    if ((told.id - 1) % state.every === 0) state.points.push(values);
    if (state.points.length > MOST_POINTS) { state.points = state.points.filter((_, i) => i % 2 === 0); state.every *= 2; }
    state.fresh = true;
  },
  incident(told) {
    state.count++;
    state.incidents.unshift(told);
    state.incidents.length = Math.min(state.incidents.length, MOST_INCIDENTS);
    blame(told);
  },
  paused(told) { state.status = "paused"; on.incident({ ...told, of: "paused" }); },
  resumed(told) { state.status = "running"; on.incident({ ...told, of: "resumed" }); },
  ended(told) { state.status = told.status; state.summary = told.summary; showResult(told.summary); },
  verdict(told) {
    showResult(state.summary || {});
    $("outcome").textContent = `verdict: ${told.verdict}`;
    $("outcome").className = { pass: "good", fail: "bad" }[told.verdict] || "warn";
    fill($("verdict").querySelector("tbody"), told.verdicts.map(each => [`${each.quantity}: ${each.outcome}`, each.reason]));
  },
  campaign(told) {
    const { done, steps } = told, next = steps[done];
    $("campaign").hidden = false;
    $("campaign").querySelector("small").textContent = `${told.campaign}: ` + (next ? `step ${done + 1} of ${steps.length}, ${next.name}`
      + (next.person ? `; a person ${next.person}` : "") : `all ${steps.length} steps are done`);
    fill($("campaign").querySelector("tbody"), steps.map((each, i) => [each.name, each.procedure,
      i === done ? "now" : !each.due ? each.why : i > done ? "to come" : each.verdict || "done"]));
  },
  bench(told) { // a served one, which has no run
    state.bench = told;
    state.status = "served";
    $("procedure").textContent = told.bench;
    $("run").textContent = `scene ${told.scene} · seed ${told.seed}`;
    $("simulated").hidden = $("watermark").hidden = !told.simulated;
  },
  trace(told) { scope.show(told); },
};

function blame(incident) { // the device with whose name an incident's message begins
  const name = Object.keys(state.devices).find(each => incident.message.startsWith(`${each}:`));
  if (!name) return;
  const device = state.devices[name];
  device.times++;
  device.last = incident.bench_ns / 1e9;
}

function showResult(summary) {
  $("verdict").hidden = false;
  $("outcome").textContent = summary.error || `run ${state.status}`;
  $("outcome").className = summary.error ? "bad" : "";
  const budgets = (summary.budgets || []).map(each => each.budget ? { ...each.budget, ...each } : each);
  fill($("verdict").querySelector("tbody"), budgets.map(each =>
    [each.quantity, `${digits(each.value, 5)} ${each.unit === "1" ? "" : each.unit || ""}`, `u ${digits(each.u, 2)}`]));
}

// --- the stream ----------------------------------------------------------------------------------------

let source = null;
function listen() {
  source = new EventSource("events");
  source.onopen = () => { $("link").textContent = ""; };
  source.onmessage = message => {
    const told = JSON.parse(message.data);
    if (on[told.event]) on[told.event](told);
    state.dirty = true;
  };
  source.onerror = () => {
    const over = !/^(running|paus|waiting)/.test(state.status);
    $("link").textContent = over ? `the command has ended${state.bench ? "" : "; palpate live shows the run again"}`
      : "connection lost, trying again";
    source.close();
    setTimeout(listen, 500);
  };
}

// --- pause and stop ------------------------------------------------------------------------------------

$("token").value = decodeURIComponent(location.hash.slice(1));
$("token").hidden = location.hash.length > 1;
async function ask(action) {
  try {
    const answer = await fetch(action, { method: "POST", headers: { "X-Palpate-Token": $("token").value } });
    $("link").textContent = answer.ok ? "" : await answer.text();
    if (!answer.ok) $("token").hidden = false;
    else if (action === "pause" && state.status === "running") state.status = "pauses after this point";
    state.dirty = true;
  } catch (error) {
    $("link").textContent = `no answer: ${error.message}`;
  }
}
$("pause").addEventListener("click", () => ask("pause"));
$("stop").addEventListener("click", () => ask("stop"));

// --- the plot of points --------------------------------------------------------------------------------

let plot = null, drawn = { xs: [], ys: [], bars: [], points: [] };

function uOf(name, values) { // the column of the standard uncertainty of a column
  const said = state.columns.find(each => each.name === name);
  return [said && said.u, `${name}_u`, `${name.replace(/_[^_]*$/, "")}_u`].find(each => each && each !== name && each in values);
}

function groupOf(values) { // the column by which points are coloured
  return [...state.columns.map(each => each.name), "sample"].find(name => typeof values[name] === "string");
}

function choose() { // columns for the axes, by the first point
  const values = state.points[0];
  state.chosen = true;
  const listed = state.columns.map(each => each.name), numbers = Object.keys(values).filter(name =>
    (typeof values[name] === "number" || values[name] === null) && name !== "id" && !name.endsWith("_u"));
  numbers.sort((a, b) => (listed.indexOf(a) + 1 || 99) - (listed.indexOf(b) + 1 || 99));
  const shown = numbers.filter(name => listed.includes(name));
  const y = shown.findLast(name => uOf(name, values)) || numbers.find(name => uOf(name, values)) || numbers[0] || "id";
  const x = shown.find(name => name !== y && !uOf(name, values)) || "id";
  $("y").replaceChildren(...[...numbers, "id"].map(name => new Option(name, name, false, name === y)));
  $("x").replaceChildren(...["id", ...numbers].map(name => new Option(name === "id" ? "number" : name, name, false, name === x)));
}

function build() {
  if (plot) plot.destroy();
  const hidden = { paths: () => null, points: { show: false } };
  const font = { font: "11px sans-serif", labelFont: "11px sans-serif", labelSize: 16 };
  plot = new uPlot({
    ...sizeOf($("plot")), legend: { show: false },
    cursor: { drag: { x: false, y: false }, points: { show: false } },
    scales: { x: { time: false, range: wide }, y: { range: wide } },
    series: [{}, hidden, hidden, hidden], axes: [{ label: words($("x").selectedOptions[0].textContent), size: 28, ...font },
      { label: words($("y").value), size: 56, ...font }],
    hooks: { draw: [drawPoints] },
  }, [[0], [null], [null], [null]], $("plot"));
  plot.over.addEventListener("mousemove", event => { const point = nearest(event); if (point) tellNear(point); });
  plot.over.addEventListener("click", event => { const point = nearest(event); if (point) showStored(point.id, true); });
}

const wide = (u, low, high) => {
  if (low === null || low === undefined) return [0, 1];
  const margin = 0.05 * (high - low) || Math.abs(0.05 * high) || 1;
  return [low - margin, high + margin];
};

function showPoints() {
  if (!state.points.length) return;
  if (!state.chosen) { choose(); build(); }
  const x = $("x").value, y = $("y").value, u = uOf(y, state.points[0]);
  const group = groupOf(state.points[0]);
  const rows = state.points.filter(each => typeof each[x] === "number" && typeof each[y] === "number").sort((a, b) => a[x] - b[x]);
  const names = [...new Set(state.points.map(each => each[group]))];
  const bar = each => u && typeof each[u] === "number" ? COVER * each[u] : 0;
  drawn = { points: rows, xs: rows.map(each => each[x]), ys: rows.map(each => each[y]), bars: rows.map(bar),
    colours: rows.map(each => COLOURS[names.length <= MOST_GROUPS ? names.indexOf(each[group]) : 0]) };
  plot.setData([drawn.xs, drawn.ys, drawn.ys.map((v, i) => v - drawn.bars[i]), drawn.ys.map((v, i) => v + drawn.bars[i])]);
  $("bars").textContent = (u ? `bars ± ${COVER} u` : "without uncertainty")
    + (state.every > 1 ? ` · 1 of ${state.every} points is shown` : "")
    + (state.invalid ? " · × is not valid" : "");
  $("groups").replaceChildren(...(group && names.length > 1 && names.length <= MOST_GROUPS ? names : []).map((name, i) => {
    const label = document.createElement("span");
    label.style.color = COLOURS[i % COLOURS.length];
    label.textContent = `● ${group} ${name}`;
    return label;
  }));
}

function drawPoints(u) {
  const ctx = u.ctx, size = 3 * devicePixelRatio;
  ctx.save();
  ctx.beginPath();
  ctx.rect(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height);
  ctx.clip();
  ctx.lineWidth = devicePixelRatio;
  drawn.xs.forEach((x, i) => {
    const px = u.valToPos(x, "x", true), at = value => u.valToPos(value, "y", true), py = at(drawn.ys[i]), bar = drawn.bars[i];
    ctx.strokeStyle = ctx.fillStyle = drawn.colours[i];
    ctx.beginPath();
    if (bar) {
      const [top, bottom] = [at(drawn.ys[i] + bar), at(drawn.ys[i] - bar)];
      for (const line of [[px, top, px, bottom], [px - size, top, px + size, top], [px - size, bottom, px + size, bottom]]) {
        ctx.moveTo(line[0], line[1]);
        ctx.lineTo(line[2], line[3]);
      }
    }
    if (drawn.points[i].valid === false) {
      for (const s of [-1, 1]) { ctx.moveTo(px - size, py - s * size); ctx.lineTo(px + size, py + s * size); }
    } else {
      ctx.fillRect(px - size / 2, py - size / 2, size, size);
    }
    ctx.stroke();
  });
  ctx.restore();
}

function nearest(event) {
  const box = plot.over.getBoundingClientRect(), [mx, my] = [event.clientX - box.left, event.clientY - box.top];
  let best = null, least = 30 ** 2;
  drawn.xs.forEach((x, i) => {
    const far = (plot.valToPos(x, "x") - mx) ** 2 + (plot.valToPos(drawn.ys[i], "y") - my) ** 2;
    if (far < least) { least = far; best = i; }
  });
  return drawn.points[best];
}

function tellNear(point) {
  const y = $("y").value, u = uOf(y, point), x = $("x").value;
  $("near").textContent = `point ${point.id}${x === "id" ? "" : `: ${x} ${digits(point[x])}`}: ${y} ${digits(point[y], 5)}`
    + (u ? ` ± ${digits(COVER * point[u], 2)}` : "") + (state.stored ? " · click shows its waveforms" : "");
}

let asked = null;
async function showStored(id, freeze) { // the stored waveforms of a point
  if (!state.stored) return;
  asked = id;
  try {
    const answer = await fetch(`trace?point=${id}`);
    const told = answer.ok ? await answer.json() : null;
    if (told) { if (freeze) scope.freeze(true); scope.show(told); }
    else $("trace").textContent = answer.ok ? `no waveforms are stored with point ${id}` : await answer.text();
  } catch { asked = null; /* the stream tells that the connection is lost */ }
}

// --- tables and what is written above them -------------------------------------------------------------

function showAll() {
  if (!state.dirty) return;
  state.dirty = false;
  const { step, promise, planned } = state, whole = (step && step.points) || (planned && planned.points) || 0;
  $("status").textContent = state.status;
  $("status").className = { complete: "good", running: "", served: "", paused: "warn" }[state.status]
    ?? (/^(pauses|waiting)/.test(state.status) ? "warn" : "bad");
  $("pause").textContent = state.status === "paused" ? "Go on" : "Pause";
  $("pause").disabled = $("stop").disabled = !/^(running|paus)/.test(state.status);
  $("bar").max = whole || 1;
  $("bar").value = whole ? Math.min(state.last, whole) : 0;
  $("count").textContent = `${state.last} of ${whole || "?"} points` + (state.invalid ? `, ${state.invalid} not valid` : "");
  $("what").textContent = step && /^(running|paus)/.test(state.status) ? `now: ${step.what}` : "";
  $("left").textContent = promise ? `${clock(promise.seconds)} left${state.scene === null ? "" : " (bench time)"}` : "";
  const reached = state.summary ? state.summary.achieved_u : promise && promise.u;
  const known = (planned && planned.u) || reached;
  $("u").textContent = known ? `u ${percent(reached)}, planned ${percent(planned && planned.u)}` : "";
  if (state.fresh) {
    state.fresh = false;
    showPoints();
    const values = state.latest[0], y = $("y").value, u = uOf(y, values);
    const columns = [...new Set(["id", groupOf(values), $("x").value, y, ...state.columns.map(each => each.name)])]
      .filter(name => name in values && !state.columns.some(each => each.u === name)).slice(0, 6);
    const bar = each => u && each[u] !== null ? ` ± ${digits(COVER * each[u], 2)}` : "";
    const cell = (each, name) => digits(each[name]) + (name === y ? bar(each) : "");
    const head = name => name === "id" ? "no." : words(name) + (name === y && u ? ` ± ${COVER} u` : "");
    fill($("latest").querySelector("thead"), [columns.map(head)], "th");
    fill($("latest").querySelector("tbody"), state.latest.map(each => columns.map(name => cell(each, name))));
    $("load").textContent = "load_measured_N" in values ? `load at point ${values.id}: ${digits(values.load_measured_N)} `
      + `± ${digits(COVER * values.load_measured_u, 2)} N (${COVER} u), peak to peak` : "";
    [...$("latest").querySelector("tbody").rows].forEach((row, i) => row.classList.toggle("bad", state.latest[i].valid === false));
    const beside = Object.keys(values).filter(name => name.startsWith("beside_") && !name.endsWith("_u"));
    $("beside").hidden = !beside.length;
    fill($("beside").querySelector("tbody"), beside.map(name => [words(name.slice(7)), digits(values[name]),
      values[`${name}_u`] === undefined ? "" : `u ${digits(values[`${name}_u`])}`]));
  }
  document.body.classList.toggle("bench", state.bench !== null);
  $("happened").textContent = state.bench ? "Faults" : "Incidents";
  const incidents = state.bench ? state.bench.faults.map(each => [each])
    : state.incidents.map(each => [`${(each.bench_ns / 1e9).toFixed(1)} s`, each.of, each.message]);
  const devices = state.bench ? state.bench.devices : Object.entries(state.devices).map(([name, each]) =>
    [name, each.serial || "", each.times ? `${each.times}×, last at ${each.last.toFixed(1)} s` : "ok"]);
  $("incident_count").textContent = state.count || incidents.length || "none";
  fill($("incidents").querySelector("tbody"), incidents);
  $("devices").hidden = !devices.length;
  fill($("devices").querySelector("tbody"), devices);
}

const scope = new Oscilloscope();
restart();
for (const name of ["x", "y"]) {
  $(name).addEventListener("input", () => { build(); state.fresh = state.dirty = true; });
}
$("x").append(new Option("number", "id"));
build();
new ResizeObserver(() => plot.setSize(sizeOf($("plot")))).observe($("plot"));
setInterval(showAll, REDRAW);
(async function () {
  for (;;) {
    if (state.last && !scope.frozen && asked !== state.last) await showStored(state.last, false);
    await new Promise(after => setTimeout(after, LATEST_TRACE));
  }
})();
listen();
