// The workbench: what is chosen lives here, what it means is the server's to say.
import { columnTable, element, gallery, noiseFields, quantityTable, runItem, timeFields } from "./parts.js";

const at = (id) => document.getElementById(id);
const state = { recording: null, names: {}, machines: {}, methods: [], text: "", runs: [] };
let choices = null;
let edited = false; // the problem file was changed by hand, or one was opened
let right = false; // the last check found nothing wrong
let asked = 0; // the newest check: answers to older ones come too late
let suggested = 0; // the newest suggestion, and whether its answer is still to come:
let open = false; // what is chosen meanwhile must not be lost to it
let shown = null;
const ticked = new Set();

async function ask(path, body, method = body === undefined ? "GET" : "POST") {
  const options = body === undefined ? {} : { body: body instanceof Blob ? body : JSON.stringify(body) };
  const answer = await fetch(path, { method, ...options }).catch(() => null);
  if (!answer) return say("The workbench has ended: start it again with backsight open.");
  const found = await answer.json().catch(() => ({ error: `the workbench answers ${answer.status}` }));
  if (!answer.ok) return say(found.error);
  say("");
  return found;
}

function say(text) {
  at("told").textContent = text;
  return null;
}

// A form that is made anew keeps the field that has the focus, by its label.
function put(id, ...inner) {
  const place = at(id);
  const focus = place.contains(document.activeElement) ? document.activeElement.getAttribute("aria-label") : null;
  place.replaceChildren(...inner);
  if (focus) [...place.querySelectorAll("[aria-label]")].find((e) => e.getAttribute("aria-label") === focus)?.focus();
}

function draw() {
  const ready = state.recording !== null;
  at("recording").classList.toggle("taken", ready);
  at("recording").hidden = Boolean(state.text) && !ready;
  at("machine").hidden = !ready;
  at("known").hidden = !choices;
  at("running").hidden = !choices && !edited;
  at("methods").hidden = !choices;
  at("forget").hidden = !(edited && choices);
  if (ready) {
    put("columns", ...columnTable(state, choices, assign), ...timeFields(state, choices, (part) => update(part)));
    put("gallery", ...gallery(state.machines, choices?.machine, choose));
  }
  if (choices) {
    at("equations").hidden = choices.machine !== "equations";
    if (document.activeElement !== at("own")) at("own").value = choices.equations;
    put("quantities", ...quantityTable(state, choices, (name, q) => update({ quantities: { ...choices.quantities, [name]: q } })));
    put("noise", ...noiseFields(state, choices, (name, v) => update({ noise: { ...choices.noise, [name]: v } })));
    const boxes = state.methods.map((m) =>
      element("label", {}, element("input", { type: "checkbox", "aria-label": m, checked: choices.methods.includes(m), onchange: (e) => method(m, e.target.checked) }), ` ${m}`),
    );
    put("methods", element("legend", {}, "Estimators"), ...boxes);
  }
}

const choose = (machine) => suggest({ machine });

function update(part) {
  choices = { ...choices, ...part };
  if (open) return complete(); // the answer that is on its way knows nothing of this
  edited = false;
  draw();
  check();
}

const method = (name, on) =>
  update({ methods: state.methods.filter((m) => (m === name ? on : choices.methods.includes(m))) });

// A column has one role, and a role one column.
async function assign(column, role) {
  for (const kind of ["inputs", "outputs"])
    choices[kind] = Object.fromEntries(
      Object.entries(choices[kind]).filter(([signal, c]) => c !== column && `${kind}:${signal}` !== role),
    );
  const [kind, signal] = role.split(/:(.*)/s);
  if (kind) choices[kind][signal] = column;
  await complete();
}

const complete = () => suggest(choices);

async function suggest(wish) {
  const mine = ++suggested;
  open = true;
  const found = await ask("suggest", wish);
  if (mine !== suggested) return;
  open = false;
  if (found) choices = found;
  if (!choices) return;
  edited = false;
  draw();
  check();
}

async function check() {
  const mine = ++asked;
  at("run").disabled = true;
  const found = await ask("check", edited ? { text: at("text").value } : choices);
  if (mine !== asked || !found) return;
  right = !found.error;
  if (!edited) at("text").value = found.text;
  at("checked").className = right ? "right" : "wrong";
  at("checked").textContent = right ? "Everything that is needed is there." : found.error;
  at("run").disabled = !right || state.runs.some((r) => r.state === "running");
}

function later(act, milliseconds = 350) {
  let timer = 0;
  return () => {
    clearTimeout(timer);
    timer = setTimeout(act, milliseconds);
  };
}

async function run() {
  const found = await ask("runs", { text: at("text").value });
  if (found) follow(found);
}

async function follow(runs) {
  while (true) {
    state.runs = runs;
    list();
    if (!runs.some((r) => r.state === "running")) break;
    await new Promise((done) => setTimeout(done, 300));
    runs = await ask("runs");
    if (!runs) return;
  }
  at("run").disabled = !right;
  const last = runs.at(-1);
  if (last?.report && last.report !== shown) show(last.report);
}

function list() {
  at("results").hidden = !state.runs.length;
  document.querySelector("main").classList.toggle("done", state.runs.length > 0);
  if (state.runs.some((r) => r.state === "running")) at("run").disabled = true;
  const items = state.runs.map((r) =>
    runItem(r, {
      show: () => show(r.report),
      stop: () => ask(`runs/${r.number}/stop`, {}),
      ticked: ticked.has(r.number),
      tick: (on) => {
        if (on) ticked.add(r.number);
        else ticked.delete(r.number);
        at("compare").disabled = ticked.size < 2;
      },
    }),
  );
  put("runs", ...items.reverse());
  at("compare").hidden = state.runs.filter((r) => r.state === "done").length < 2;
  at("compare").disabled = ticked.size < 2;
}

function show(report) {
  shown = report;
  at("report").hidden = false;
  at("report").src = report;
}

async function take(file) {
  say(`Reading ${file.name} …`);
  const found = await ask(`recording?name=${encodeURIComponent(file.name)}`, file, "PUT");
  if (!found) return;
  choices = null;
  suggested++;
  open = false;
  edited = false;
  Object.assign(state, found);
  draw();
}

at("file").addEventListener("change", (event) => event.target.files[0] && take(event.target.files[0]));
for (const [kind, over] of [["dragover", true], ["dragleave", false], ["drop", false]])
  document.addEventListener(kind, (event) => {
    event.preventDefault();
    document.body.classList.toggle("over", over);
    if (kind === "drop" && event.dataTransfer.files[0]) take(event.dataTransfer.files[0]);
  });
const equationsChanged = later(complete);
at("own").addEventListener("input", () => {
  choices.equations = at("own").value;
  equationsChanged();
});
const textChanged = later(check);
at("text").addEventListener("input", () => {
  edited = true;
  at("forget").hidden = !choices;
  textChanged();
});
at("forget").addEventListener("click", () => update({}));
at("run").addEventListener("click", run);
at("compare").addEventListener("click", async () => {
  const found = await ask("compare", { runs: [...ticked].sort((a, b) => a - b) });
  if (found) show(found.report);
});

const begin = await ask("state");
if (begin) {
  Object.assign(state, begin);
  if (state.text) {
    edited = true;
    at("text").value = state.text;
    at("problem").open = true;
    check();
  }
  draw();
  if (state.runs.length) follow(state.runs);
}
