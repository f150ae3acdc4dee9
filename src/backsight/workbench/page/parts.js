// Elements of the page: every one is made anew from what is chosen.
import { drawings, trace } from "./drawings.js";

export function element(tag, attributes = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) made.addEventListener(name.slice(2), value);
    else if (name in made && name !== "list") made[name] = value;
    else made.setAttribute(name, value);
  }
  made.append(...children.filter((child) => child !== null && child !== ""));
  return made;
}

const picture = (svg) => {
  const made = document.createElement("template");
  made.innerHTML = svg; // drawn by us, from numbers
  return made.content;
};

const short = (value) => (value === null ? "" : Number(value.toPrecision(5)).toString());

const table = (heads, rows) =>
  element(
    "div",
    { className: "scroll", tabIndex: 0 },
    element(
      "table",
      {},
      element("thead", {}, element("tr", {}, ...heads.map((h) => element("th", { scope: "col" }, h)))),
      element("tbody", {}, ...rows),
    ),
  );

// On a phone, where the heads of the columns are not there, cells say what they are.
const said = (label, inner) => element("td", inner ? { "data-label": label } : { className: "empty" }, inner);

// Another guess is as doubtful as the first one was, by its size.
function scaled(q, value) {
  const by = Math.abs(value / q.value);
  if (!Number.isFinite(by) || by === 0) return { value };
  const round = (v) => (v === null ? null : Number((v * by).toPrecision(6)));
  return { value, sigma: round(q.sigma), lower: round(q.lower) };
}

const cell = (...inner) => element("td", {}, ...inner);

// A number that is being typed is read when it is left or Enter is pressed; what is none is marked.
function numberField(label, value, change, { empty = null } = {}) {
  return element("input", {
    type: "text",
    inputMode: "decimal",
    "aria-label": label,
    value: value === null || value === undefined ? "" : Math.abs(value) < 1e-4 && value !== 0 ? value.toExponential() : String(value),
    onchange: (event) => {
      const typed = event.target.value.trim().replace(/^([-+]?\d*),(\d+)/, "$1.$2");
      const number = typed === "" ? empty : Number(typed);
      const wrong = typed === "" ? empty === null && value !== null : !Number.isFinite(number);
      event.target.setAttribute("aria-invalid", wrong);
      if (!wrong) change(number);
    },
  });
}

const roleOf = (name, choices) => {
  for (const kind of ["inputs", "outputs"])
    for (const [signal, column] of Object.entries(choices?.[kind] ?? {}))
      if (column === name) return `${kind}:${signal}`;
  return "";
};

function roles(machine, own, column) {
  if (!machine)
    return [["", "not used"], [`inputs:${own}`, `input ${own}`], [`outputs:${own}`, `output ${own}`]];
  const slots = (kind, word) =>
    machine[kind].map((s) => [`${kind}:${s.name}`, `${word}: ${s.meaning} [${s.unit}]`]);
  return [["", "not used"], ...slots("inputs", "input"), ...slots("outputs", "output")];
}

export function columnTable(state, choices, assign) {
  const { signals, clock, sure, dt } = state.recording;
  const machine = state.machines[choices?.machine];
  const rows = signals.map((c) => {
    const missing = c.missing ? `${c.missing} missing` : "";
    const select = element(
      "select",
      { "aria-label": `${c.name} is`, disabled: !choices, onchange: (e) => assign(c.name, e.target.value) },
      ...roles(machine, state.names[c.name]).map(([value, text]) => element("option", { value }, text)),
    );
    select.value = roleOf(c.name, choices);
    const remarks = [missing, ...c.remarks].filter(Boolean).map((r) => element("small", { className: "wrong" }, r));
    return element(
      "tr",
      {},
      cell(c.name, c.unit ? ` [${c.unit}]` : "", ...remarks),
      cell(picture(trace(c))),
      element("td", { className: "number" }, c.low === null ? "" : `${short(c.low)} … ${short(c.high)}`),
      cell(select),
    );
  });
  const rate = dt ? `every ${short(dt)} s` : "";
  const time = clock === null ? "no column looks like time" : `time ${clock && `"${clock}"`} ${rate}${sure ? "" : " (by its numbers)"}`;
  const facts = [`${state.recording.name}: ${signals[0]?.samples ?? 0} samples, ${time}`, ...state.recording.remarks];
  return [
    ...facts.map((f) => element("p", { className: "remark" }, f)),
    table(["column", "samples", "range", "is"], rows),
  ];
}

export function timeFields(state, choices, change) {
  if (state.recording.sure || !choices) return [];
  const names = ["", ...state.recording.signals.map((c) => c.name)];
  const select = element(
    "select",
    { "aria-label": "column of time", onchange: (e) => change({ time: e.target.value || null }) },
    ...names.map((n) => element("option", { value: n }, n || "none: by the period")),
  );
  select.value = choices.time ?? "";
  return [
    element("p", {}, "Time [s] is column ", select, " or the sampling period [s] is ",
      numberField("sampling period [s]", choices.dt, (dt) => change({ dt, time: null }))),
  ];
}

export function gallery(machines, chosen, choose) {
  const own = { title: "Equations as text", about: "Any other machine: write its equations." };
  return Object.entries({ ...machines, equations: own }).map(([key, m]) =>
    element(
      "label",
      {},
      element("input", { type: "radio", name: "machine", value: key, checked: key === chosen, onchange: () => choose(key) }),
      picture(drawings[key] ?? ""),
      element("strong", {}, m.title),
      element("small", {}, m.about),
    ),
  );
}

export function quantityTable(state, choices, change) {
  const machine = state.machines[choices.machine];
  const rows = Object.entries(choices.quantities).map(([name, q]) => {
    const set = (part) => change(name, { ...q, ...part });
    const known = element(
      "select",
      {
        "aria-label": `${name} is`,
        onchange: (e) => {
          const word = e.target.value;
          const sigma = word === "known" ? null : (q.sigma ?? (0.3 * Math.abs(q.value) || 1));
          set({ sigma, change: word === "wanders" ? q.change || 0.1 * sigma : 0 });
        },
      },
      element("option", { value: "known" }, "known"),
      element("option", { value: "constant" }, "unknown, constant"),
      element("option", { value: "wanders" }, "unknown, changes"),
    );
    known.value = q.sigma === null ? "known" : q.change ? "wanders" : "constant";
    const unit = machine
      ? (q.unit && `[${q.unit}]`)
      : element("input", { type: "text", "aria-label": `unit of ${name}`, value: q.unit, onchange: (e) => set({ unit: e.target.value.trim() }) });
    return element(
      "tr",
      {},
      cell(element("strong", {}, name), " ", unit, element("small", {}, machine?.meanings[name] ?? "")),
      cell(known),
      said("value or guess", numberField(`value of ${name}`, q.value, (value) => set(scaled(q, value)))),
      said("may be wrong by ±", q.sigma === null ? "" : numberField(`${name}: may be wrong by`, q.sigma, (sigma) => set({ sigma }))),
      said("changes in 1 s by", q.change ? numberField(`${name}: changes within a second by`, q.change, (change) => set({ change })) : ""),
    );
  });
  if (!rows.length) return [];
  return [table(["quantity", "is", "value or guess", "may be wrong by ±", "changes in 1 s by"], rows)];
}

export function noiseFields(state, choices, change) {
  const slots = state.machines[choices.machine]?.outputs ?? [];
  const unitOf = (name) =>
    slots.find((s) => s.name === name)?.unit ??
    state.recording.signals.find((c) => c.name === choices.outputs[name])?.unit ?? "";
  const fields = Object.entries(choices.noise).map(([name, value]) =>
    element("tr", {}, cell(`noise of ${name} [${unitOf(name) || "1"}]`), cell(numberField(`noise of ${name}`, value, (v) => change(name, v))),
      cell(element("small", {}, "standard deviation, as the samples show it; better from the data sheet"))),
  );
  return fields.length ? [table(["sensor", "±", "from"], fields)] : [];
}

export function runItem(run, { show, stop, tick, ticked }) {
  const busy = run.state === "running";
  const save = (name, text) => element("a", { href: `runs/${run.number}/${name}`, download: "" }, text);
  const head = [
    run.state === "done" ? element("input", { type: "checkbox", "aria-label": `compare run ${run.number}`, checked: ticked, onchange: (e) => tick(e.target.checked) }) : null,
    element("strong", {}, `Run ${run.number}`),
    busy ? element("progress", { max: 1, value: run.share, "aria-label": run.doing }) : null,
    busy ? element("span", {}, run.doing) : element("span", {}, run.state === "done" ? `${run.seconds} s` : run.state),
    busy ? element("button", { type: "button", onclick: stop }, "Stop") : null,
    run.report ? element("button", { type: "button", onclick: show }, "Show report") : null,
    run.report ? element("a", { href: run.report, target: "_blank", rel: "noopener" }, "in a tab of its own") : null,
    run.report ? save("report.html", "save report") : null,
    save("problem.toml", "save problem file"),
    run.state === "done" ? save("estimates.nc", "save estimates") : null,
  ];
  const said = run.said.length && !run.report ? element("ul", {}, ...run.said.map((s) => element("li", {}, s))) : null;
  return element("li", {}, element("div", { className: "head" }, ...head.filter(Boolean)),
    run.error ? element("p", { className: "error" }, run.error) : null, said);
}
