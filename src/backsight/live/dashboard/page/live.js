"use strict";
// The page of a run: curves from the history, values and lists from the frames that the server sends.

const by = (id) => document.getElementById(id);
const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const GROUPS = [
  ["Unknowns", (s, known) => s.kind === "state" && known.unknown.includes(s.name)],
  ["Outputs: measured and predicted", (s) => s.kind === "measured"],
  ["Forces", (s) => s.kind === "force"],
  ["Virtual sensors", (s) => s.kind === "virtual"],
  ["Other states", (s, known) => s.kind === "state" && !known.unknown.includes(s.name)],
  ["Inputs", (s) => s.kind === "input"],
  ["Innovations", (s) => s.kind === "nis"],
];
const SIGMAS = 2; // of the bands
const PAPER = 640; // pixels between the margins of A4 and of letter
// By the distance of marks [s]: what each says, and what is said below it where the year, the month, the day, ... is another.
const MARKS = [
  [31536000, "{YYYY}", null, null, null, null, null, null, 1],
  [86400, "{MM}-{DD}", "\n{YYYY}", null, null, null, null, null, 1],
  [60, "{HH}:{mm}", "\n{YYYY}-{MM}-{DD}", null, "\n{MM}-{DD}", null, null, null, 1],
  [1e-3, "{HH}:{mm}:{ss}", "\n{YYYY}-{MM}-{DD}", null, "\n{MM}-{DD}", null, null, null, 1],
];
let known, history = null, span = 60, charts = [], reload = 0, onPaper = false;

function element(tag, text = "", name = "") {
  const made = document.createElement(tag);
  made.textContent = text;
  if (name) made.className = name;
  return made;
}

function told(message) {
  by("told").textContent = message;
  by("told").hidden = !message;
}

async function ask(path, body) {
  const how = body === undefined ? {} : { method: "POST", body: JSON.stringify(body) };
  const answer = await fetch(path, how);
  const found = await answer.json().catch(() => ({ error: `the server answers ${answer.status}` }));
  if (found.error) throw new Error(found.error);
  return found;
}

const digits = (value, count = 5) => (value === null || value === undefined ? "–" : String(Number(value.toPrecision(count))));

// What a curve is drawn from: a line, a second line, and the ends of a band.
function columns(kind, name) {
  const series = history.series;
  const of = (k) => series[`${k}:${name}`];
  const own = of(kind);
  if (kind === "state" || kind === "virtual" || kind === "force") {
    const end = (sign) => own.last.map((v, i) => (v === null || own.std[i] === null ? null : v + sign * SIGMAS * own.std[i]));
    return [history.t, end(1), end(-1), own.last, own.last.map(() => null)];
  }
  const line = kind === "measured" ? of("predicted").last : own.last;
  const other = kind === "measured" ? own.last : own.last.map(() => null);
  return [history.t, own.high, own.low, line, other];
}

function chart(s) {
  const figure = element("figure");
  const caption = element("figcaption", s.name);
  const value = element("span", "", "value");
  value.dataset.key = `${s.kind}:${s.name}`;
  caption.append(value);
  const place = element("div");
  figure.append(caption, place);
  return { figure, place, value, ...s, plot: null };
}

function options(c) {
  const axis = { stroke: style("--muted"), grid: { stroke: style("--grid"), width: 1 }, ticks: { show: false }, font: "11px system-ui" };
  const dated = history.t.length > 0 && history.t[history.t.length - 1] > 1e8;
  return {
    width: onPaper ? PAPER : Math.max(200, c.place.clientWidth), height: dated ? 166 : 150, legend: { show: false }, cursor: { drag: { x: false, y: false } },
    scales: { x: { time: dated } },
    axes: [dated ? { ...axis, size: 44, space: 66, values: MARKS } : { ...axis, size: 28 }, { ...axis, size: 58, values: (_, ticks) => ticks.map((v) => digits(v, 6)) }],
    series: [
      {}, { width: 0, stroke: "transparent", points: { show: false } }, { width: 0, stroke: "transparent", points: { show: false } },
      { width: 1.5, stroke: style("--line"), points: { show: false } },
      { width: 1, stroke: style("--other"), points: { show: false } },
    ],
    bands: [{ series: [1, 2], fill: style("--band") }],
  };
}

// A chart that nobody sees costs nothing until it is seen.
const seen = new IntersectionObserver((changes) => {
  for (const change of changes) {
    const c = charts.find((one) => one.figure === change.target);
    if (c) c.visible = change.isIntersecting;
  }
  draw();
}, { rootMargin: "200px" });

function draw() {
  if (!history) return;
  drawMap();
  for (const c of charts.filter((one) => one.visible || onPaper)) {
    if (!c.plot) c.plot = new uPlot(options(c), columns(c.kind, c.name), c.place);
    else c.plot.setData(columns(c.kind, c.name));
  }
}

function redraw() {
  for (const c of charts) {
    if (c.plot) c.plot.destroy();
    c.plot = null;
  }
  draw();
}

async function load() {
  history = await ask(`history?span=${span}`);
  reload = performance.now() + 1000 * Math.max(1, history.period / 2);
  redraw();
}

// The force map: a row for each place, a column for each bucket, colour by the largest value in it.
function mapColours() {
  const parse = (name) => style(name).match(/\w\w/g).map((part) => parseInt(part, 16));
  const [low, middle, high] = ["--map-low", "--map-zero", "--map-high"].map(parse);
  return (share) => {
    const end = share < 0 ? low : high;
    const weight = Math.min(1, Math.abs(share));
    return end.map((v, i) => Math.round(middle[i] + weight * (v - middle[i])));
  };
}

function drawMap() {
  if (!known.map) return;
  const rows = known.map.names.map((name) => history.series[`${known.map.kind}:${name}`]);
  const count = history.t.length;
  const extreme = (s, i) => {
    const [low, high] = [s.low[i], s.high[i]];
    return low === null ? 0 : Math.abs(low) > Math.abs(high) ? low : high;
  };
  let largest = 0;
  for (const s of rows) for (let i = 0; i < count; i++) largest = Math.max(largest, Math.abs(extreme(s, i)));
  const canvas = by("map").querySelector("canvas");
  canvas.width = Math.max(1, count);
  canvas.height = rows.length;
  const context = canvas.getContext("2d");
  const image = context.createImageData(canvas.width, canvas.height);
  const colour = mapColours();
  rows.forEach((s, row) => {
    for (let i = 0; i < count; i++) {
      const at = 4 * ((rows.length - 1 - row) * canvas.width + i);
      image.data.set([...colour(largest ? extreme(s, i) / largest : 0), 255], at);
    }
  });
  context.putImageData(image, 0, 0);
  const end = `${digits(largest, 3)} ${known.map.unit}`.trim();
  by("map").querySelector(".value").textContent = `largest ${end}`;
  canvas.setAttribute("aria-label", `Forces over time by place, the largest is ${end}`);
}

function beginMap() {
  by("map").hidden = !known.map;
  if (!known.map) return;
  const { names, places } = known.map;
  const labelled = names.map((name, i) => (places[i] === null ? name : `${name}, ${digits(places[i], 4)} m`));
  by("map").querySelector("ol").replaceChildren(...labelled.reverse().map((text) => element("li", text)));
}

function append(fresh) {
  if (span > 60 || !history) return;
  const from = history.t.length ? history.t[history.t.length - 1] : -Infinity;
  const first = fresh.t.findIndex((t) => t > from);
  if (first < 0) return;
  history.t.push(...fresh.t.slice(first));
  const gone = Math.max(0, history.t.findIndex((t) => t >= history.t[history.t.length - 1] - span));
  history.t.splice(0, gone);
  for (const [key, series] of Object.entries(history.series))
    for (const what of Object.keys(series)) {
      series[what].push(...fresh.series[key][what].slice(first));
      series[what].splice(0, gone);
    }
  draw();
}

function values(frame) {
  const shown = Object.fromEntries(frame.states.map((s) => [`state:${s.name}`, s]));
  for (const c of charts) {
    const s = shown[`${c.kind}:${c.name}`];
    if (s) c.value.textContent = `${digits(s.value)}${s.std === null ? "" : ` ± ${digits(SIGMAS * s.std, 2)}`} ${c.unit}`;
    else if (frame.fresh) {
      const series = frame.fresh.series[`${c.kind}:${c.name}`];
      c.value.textContent = `${digits(series.last[series.last.length - 1])} ${c.unit}`;
    }
  }
}

// What can be clicked stays the same element: a press and its release may have a frame between them.
const entries = new Map();

function alarmEntry(name) {
  const entry = { item: element("li"), text: element("span"), button: element("button", "Acknowledge") };
  entry.button.type = "button";
  entry.button.onclick = () => ask("acknowledge", { name }).catch((e) => told(e.message));
  entry.item.append(entry.text, entry.button);
  by("alarms").querySelector("ul").append(entry.item);
  entries.set(name, entry);
  return entry;
}

function alarms(frame) {
  by("alarms").hidden = frame.alarms.length === 0;
  for (const a of frame.alarms) {
    const entry = entries.get(a.name) || alarmEntry(a.name);
    entry.text.textContent = `${a.name}: ${a.raised ? a.sentence : a.acknowledged ? "quiet" : `was raised: ${a.sentence}`}`;
    entry.item.className = a.raised ? "raised" : "";
    entry.button.hidden = a.acknowledged;
  }
}

function sources(frame) {
  by("sources").tBodies[0].replaceChildren(...frame.sources.map((s) => {
    const row = element("tr");
    const near = s.offset !== null && Math.abs(s.offset) < 3600; // else it counts from another zero
    const clock = [near ? `${digits(1e3 * s.offset, 3)} ms` : "", s.drift === null ? "" : `${digits(1e6 * s.drift, 3)} ppm`].filter(Boolean).join(", ");
    const lost = s.too_late + s.malformed + s.implausible + s.lost;
    row.append(element("td", s.name), element("td", s.silent ? "silent" : s.state, s.silent ? "wrong" : ""), element("td", `${digits(s.rate, 4)}/s`),
      element("td", s.late ? `${s.late}, up to ${digits(1e3 * s.lateness, 3)} ms` : "0"), element("td", String(s.gaps), s.gaps ? "wrong" : ""), element("td", String(lost), lost ? "wrong" : ""), element("td", clock));
    row.title = `${s.too_late} too late, ${s.malformed} malformed, ${s.implausible} with impossible times, ${s.lost} without room, ${s.duplicates} duplicates`;
    return row;
  }));
}

let savedBefore = "";

function saved(frame) {
  const now = JSON.stringify(frame.saved);
  if (now === savedBefore) return;
  savedBefore = now;
  by("saved").replaceChildren(...frame.saved.map((s) => {
    const item = element("li", `${s.name}: `);
    if (s.report) {
      const link = element("a", "report");
      link.href = s.report;
      link.target = "_blank";
      link.rel = "noopener";
      item.append(link);
    } else item.append(s.state);
    return item;
  }));
}

// Numbers that change faster than this cannot be read, and laying out the page costs more than curves.
const READ = 200; // ms
let texts = 0;

function show(frame) {
  if (frame.fresh) append(frame.fresh);
  if (performance.now() < texts) return;
  texts = performance.now() + READ;
  by("light").className = frame.verdict.light;
  by("sentence").textContent = frame.verdict.sentence;
  const stored = frame.stored === null ? "" : `, ${frame.stored} stored`;
  const latency = frame.latency[0] === null ? "" : `, latency ${digits(1e3 * frame.latency[0], 3)} ms`;
  by("facts").textContent = `${known.estimator}, ${digits(1 / known.dt, 6)} Hz: ${frame.samples} samples${stored}${latency}`;
  values(frame);
  alarms(frame);
  sources(frame);
  saved(frame);
  if (span > 60 && performance.now() > reload) {
    reload = Infinity;
    load().catch((e) => told(e.message));
  }
}

async function begin() {
  known = await ask("state");
  document.title = by("title").textContent = known.title;
  for (const [title, belongs] of GROUPS) {
    const chosen = known.series.filter((s) => belongs(s, known)).map(chart);
    if (!chosen.length) continue;
    const group = element("div", "", "charts");
    group.append(...chosen.map((c) => c.figure));
    by("curves").append(element("h2", title), group);
    charts.push(...chosen);
  }
  beginMap();
  for (const c of charts) seen.observe(c.figure);
  const frames = new EventSource("frames");
  frames.onopen = () => load().catch((e) => told(e.message)); // also what came while nobody listened
  frames.onmessage = (event) => { told(""); show(JSON.parse(event.data)); };
  frames.addEventListener("missed", () => load().catch((e) => told(e.message)));
  frames.addEventListener("ended", () => {
    frames.close();
    told("The run has ended.");
  });
  frames.onerror = () => told("The run does not answer; the page connects again by itself.");
}

for (const button of document.querySelectorAll("nav button"))
  button.onclick = () => {
    span = Number(button.dataset.span);
    for (const b of document.querySelectorAll("nav button")) b.setAttribute("aria-pressed", String(b === button));
    load().catch((e) => told(e.message));
  };
by("save").onsubmit = (event) => {
  event.preventDefault();
  ask("save", { minutes: Number(event.target.elements.minutes.value) }).catch((e) => told(e.message));
};
let width = document.body.clientWidth;
new ResizeObserver(() => {
  if (document.body.clientWidth !== width) redraw();
  width = document.body.clientWidth;
}).observe(document.body);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
// Paper has its own width and is always light.
function paper(now) {
  onPaper = now;
  document.documentElement.classList.toggle("on-paper", now);
  redraw();
}
addEventListener("beforeprint", () => paper(true));
addEventListener("afterprint", () => paper(false));
begin().catch((e) => told(e.message));
