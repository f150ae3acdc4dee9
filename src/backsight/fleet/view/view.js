"use strict";
(async () => {
  const bytes = Uint8Array.from(atob(document.getElementById("rows").textContent), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  const { columns, axes, judged, store, off } = JSON.parse(await new Response(stream).text());
  const get = (id) => document.getElementById(id);
  const column = Object.fromEntries(columns.map((c) => [c.name, c]));
  const shown = columns.filter((c) => c.kind !== "hidden" && c.values.some((v) => v !== "" && v !== null));
  const n = columns.length ? columns[0].values.length : 0;
  const PER_PAGE = 50, SERIES = 6, CATEGORIES = 12;
  const BINS = Math.max(8, Math.min(60, Math.round(2 * Math.cbrt(n)))); // the rule of Rice

  // Numbers to compare and to draw by: dates are milliseconds, infinity is a number.
  const infinite = { "∞": Infinity, "-∞": -Infinity };
  for (const c of columns) {
    if (c.kind === "number") c.numbers = c.values.map((v) => (v === null ? NaN : (infinite[v] ?? v)));
    if (c.kind === "date") c.numbers = c.values.map((v) => Date.parse(v));
    if (c.kind === "text") {
      const words = [...new Set(c.values)].sort();
      if (words.length > 1 && words.length <= CATEGORIES) {
        c.words = words;
        const place = new Map(words.map((w, k) => [w, k]));
        c.numbers = c.values.map((v) => place.get(v));
      }
    }
  }
  const text = (c, k) => (c.values[k] === null ? "" : c.kind === "number" ? short(c.numbers[k]) : c.values[k]);
  const short = (v) => {
    if (!Number.isFinite(v)) return v > 0 ? "∞" : v < 0 ? "-∞" : "";
    const plain = v === 0 || (Math.abs(v) >= 1e-3 && Math.abs(v) < 1e7);
    return plain ? String(Number(v.toPrecision(6))) : v.toExponential(3).replace(/\.?0+e/, "e").replace("e+", "e");
  };
  const named = (c) => (c.unit ? `${c.name} [${c.unit}]` : c.name);

  // What the reader chose.
  const sort = { name: "outlying" in column ? "outlying" : "recording", down: true };
  let rows = [], page = 0, chosen = null;

  const OPERATORS = {
    "<": (a, b) => a < b, "<=": (a, b) => a <= b, ">": (a, b) => a > b, ">=": (a, b) => a >= b,
    "=": (a, b) => a === b, "!=": (a, b) => a !== b,
  };
  // Words that a row must hold, and conditions on columns, between commas.
  function conditions(asked) {
    return asked.split(",").map((s) => s.trim()).filter(Boolean).map((part) => {
      const found = part.match(/^(.+?)\s*(<=|>=|!=|<|>|=)\s*(.*)$/);
      if (!found) {
        const word = part.toLowerCase();
        return (k) => shown.some((c) => c.kind !== "number" && c.values[k].toLowerCase().includes(word));
      }
      const [, name, sign, value] = found;
      const c = column[name];
      if (!c) throw new Error(`there is no column “${name}”`);
      const compare = OPERATORS[sign];
      if (c.kind === "number" && value !== "") {
        const number = infinite[value] ?? Number(value);
        if (Number.isNaN(number)) throw new Error(`“${value}” is not a number`);
        return (k) => compare(c.numbers[k], number);
      }
      return (k) => compare(c.values[k] ?? "", value);
    });
  }

  function choose() {
    get("complaint").textContent = "";
    try {
      const all = conditions(get("filter").value);
      rows = Array.from({ length: n }, (_, k) => k).filter((k) => all.every((holds) => holds(k)));
    } catch (error) {
      get("complaint").textContent = error.message;
      return;
    }
    arrange();
    draw();
  }

  function arrange() {
    const c = column[sort.name], sign = sort.down ? -1 : 1;
    const by = c.kind === "number" || c.kind === "date" ? c.numbers : c.values;
    const empty = (v) => v === "" || Number.isNaN(v);
    rows.sort((a, b) => {
      const [x, y] = [by[a], by[b]];
      if (empty(x) || empty(y)) return empty(x) - empty(y) || a - b; // what is empty comes last
      return (x < y ? -sign : x > y ? sign : 0) || a - b;
    });
    page = 0;
    list();
  }

  const made = (kind, about = {}, ...inside) => {
    const element = Object.assign(document.createElement(kind), about);
    element.append(...inside);
    return element;
  };

  function list() {
    const pages = Math.max(1, Math.ceil(rows.length / PER_PAGE));
    const head = shown.map((c) => {
      const cell = made("th", { className: c.kind, tabIndex: 0, scope: "col" }, c.name);
      if (c.unit) cell.append(made("small", {}, c.unit));
      if (c.name === sort.name) cell.setAttribute("aria-sort", sort.down ? "descending" : "ascending");
      const act = () => {
        sort.down = c.name === sort.name ? !sort.down : c.name === "outlying";
        sort.name = c.name;
        arrange();
      };
      cell.addEventListener("click", act);
      cell.addEventListener("keydown", (e) => e.key === "Enter" && act());
      return cell;
    });
    document.querySelector("#table thead").replaceChildren(made("tr", {}, ...head));
    const body = rows.slice(page * PER_PAGE, (page + 1) * PER_PAGE).map((k) => {
      const cells = shown.map((c) => {
        const bad = c.name === "failure" || (c.name === "outlying" && c.numbers[k] > off);
        const value = text(c, k);
        return made("td", { className: `${c.kind}${bad ? " bad" : ""}`, title: value }, value);
      });
      const row = made("tr", { tabIndex: 0 }, ...cells);
      row.setAttribute("aria-selected", String(k === chosen));
      row.addEventListener("click", () => tell(k));
      row.addEventListener("keydown", (e) => e.key === "Enter" && tell(k));
      return row;
    });
    document.querySelector("#table tbody").replaceChildren(...body);
    get("count").textContent = rows.length === n ? `${n} rows` : `${rows.length} of ${n} rows`;
    get("place").textContent = `${page + 1} / ${pages}`;
    get("before").disabled = page === 0;
    get("after").disabled = page + 1 >= pages;
  }

  // All of one row, and how to get its report.
  function tell(k) {
    chosen = k;
    const command = `backsight report ${store} --item ${column.item.values[k]} --out ${column.item.values[k]}.html`;
    const values = shown.flatMap((c) => (text(c, k) === "" ? [] : [made("div", {}, made("dt", {}, named(c)), made("dd", {}, text(c, k)))]));
    const copy = made("button", { type: "button" }, "copy");
    copy.addEventListener("click", () => navigator.clipboard.writeText(command).then(() => (copy.textContent = "copied")));
    get("one").replaceChildren(
      made("h2", {}, column.recording.values[k]), made("dl", {}, ...values),
      made("small", {}, "The report of this recording: "), copy, made("pre", {}, command),
    );
    get("one").hidden = false;
    list();
    draw();
  }

  // Drawings: SVG whose colours are CSS, so that themes and paper need nothing from here.
  const NS = "http://www.w3.org/2000/svg";
  const shape = (kind, about, inside = "") => {
    const element = document.createElementNS(NS, kind);
    for (const [name, value] of Object.entries(about)) element.setAttribute(name, value);
    element.textContent = inside;
    return element;
  };
  const quantile = (sorted, share) => sorted[Math.min(sorted.length - 1, Math.floor(share * sorted.length))];
  const median = (values) => quantile([...values].sort((a, b) => a - b), 0.5);

  // Most of the values, so that one wild row does not press all others into a line.
  function span(values) {
    const sorted = values.filter(Number.isFinite).sort((a, b) => a - b);
    if (!sorted.length) return [0, 1];
    const [low, high] = [quantile(sorted, 0.005), quantile(sorted, 0.995)];
    const middle = quantile(sorted, 0.75) - quantile(sorted, 0.25) || high - low;
    const ends = [Math.max(sorted[0], low - 3 * middle), Math.min(sorted.at(-1), high + 3 * middle)];
    const room = 0.04 * (ends[1] - ends[0]) || Math.abs(ends[0]) * 0.01 || 1;
    return [ends[0] - room, ends[1] + room];
  }
  function ticks([low, high], count) {
    const raw = (high - low) / count, power = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= raw);
    const found = [];
    for (let v = Math.ceil(low / step) * step; v <= high; v += step) found.push(Number(v.toPrecision(12)));
    return found;
  }
  const day = (v) => new Date(v).toISOString().slice(0, 10);

  function frame(svg, x, y, labels, upright) {
    const { width, height } = svg.getBoundingClientRect();
    const box = { left: 58, right: 8, top: 8, bottom: 26 };
    const px = (v) => box.left + ((v - x[0]) / (x[1] - x[0])) * (width - box.left - box.right);
    const py = (v) => height - box.bottom - ((v - y[0]) / (y[1] - y[0])) * (height - box.top - box.bottom);
    svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    const parts = [];
    for (const v of ticks(y, 5)) {
      parts.push(shape("line", { class: "line", x1: box.left, x2: width - box.right, y1: py(v), y2: py(v) }));
      parts.push(shape("text", { x: box.left - 6, y: py(v) + 4, "text-anchor": "end" }, upright(v)));
    }
    for (const [v, label] of labels(Math.max(2, Math.floor(width / 110))))
      parts.push(shape("text", { x: px(v), y: height - 8, "text-anchor": "middle" }, label));
    parts.push(shape("path", { class: "axis", d: `M${box.left} ${box.top}V${height - box.bottom}H${width - box.right}` }));
    svg.replaceChildren(...parts);
    return { px, py, inside: (v, w) => v >= x[0] && v <= x[1] && w >= y[0] && w <= y[1] };
  }

  // One colour for every group, as far as there are colours.
  function grouped() {
    const c = column[get("groups").value];
    if (!c) return [["", rows]];
    const groups = new Map();
    for (const k of rows) {
      const name = text(c, k);
      groups.set(name, [...(groups.get(name) ?? [])].length ? groups.get(name) : []);
      groups.get(name).push(k);
    }
    const sorted = [...groups].sort((a, b) => b[1].length - a[1].length);
    const rest = sorted.slice(SERIES - 1).flatMap(([, members]) => members);
    return sorted.length <= SERIES ? sorted.sort((a, b) => (a[0] < b[0] ? -1 : 1)) : [...sorted.slice(0, SERIES - 1), ["others", rest]];
  }
  const colour = (k) => `var(--series-${k})`;

  let points = null;
  function draw() {
    const q = column[get("quantity").value], x = column[get("over").value];
    if (!q) return;
    const groups = grouped();
    get("legend").replaceChildren(...(groups.length < 2 ? [] : groups.map(([name], k) => {
      const dot = made("i");
      dot.style.background = colour(k);
      return made("span", {}, dot, name || "(empty)");
    })));
    trend(q, x, groups);
    distribution(q, groups);
  }

  function trend(q, x, groups) {
    const at = (k) => (x ? x.numbers[k] + (x.words ? jitter(k) : 0) : k);
    const xs = rows.map(at);
    const wide = x?.words ? [-0.5, x.words.length - 0.5] : span(xs), high = span(rows.map((k) => q.numbers[k]));
    const labels = (count) => x?.words ? x.words.map((w, k) => [k, w || "(empty)"]) : ticks(wide, count).map((v) => [v, x?.kind === "date" ? day(v) : short(v)]);
    const plot = frame(get("trend"), wide, high, labels, short);
    let outside = 0;
    groups.forEach(([, members], number) => {
      const dots = [], known = [];
      for (const k of members) {
        const [v, w] = [at(k), q.numbers[k]];
        if (Number.isNaN(v) || Number.isNaN(w)) continue;
        if (plot.inside(v, w)) dots.push(`M${plot.px(v).toFixed(1)} ${plot.py(w).toFixed(1)}h0`);
        else outside += 1;
        known.push(k);
      }
      get("trend").append(shape("path", { class: "dots", stroke: colour(number), d: dots.join("") }));
      const line = middle(x, q, known).map(([v, w]) => `${plot.px(v).toFixed(1)} ${plot.py(w).toFixed(1)}`);
      if (line.length > 1) get("trend").append(shape("path", { class: "middle", stroke: colour(number), d: `M${line.join("L")}` }));
    });
    if (chosen !== null && plot.inside(at(chosen), q.numbers[chosen]))
      get("trend").append(shape("circle", { class: "mark", r: 7, cx: plot.px(at(chosen)), cy: plot.py(q.numbers[chosen]) }));
    points = { plot, at, q };
    const notes = [];
    const rank = x && !x.words ? correlation(x.numbers, q.numbers, rows) : NaN;
    if (Number.isFinite(rank)) notes.push(`rank correlation ${rank.toFixed(2)}`);
    if (outside) notes.push(`${outside} outside the picture`);
    get("trend-caption").replaceChildren(`${named(q)} over ${x ? named(x) : "the order of the rows"}`, made("small", {}, notes.join(", ")));
  }
  const jitter = (k) => 0.5 * (((k * 0.6180339887) % 1) - 0.5);

  // Medians of as many rows each.
  function middle(x, q, members) {
    if (!x || members.length < 20) return [];
    if (x.words) return [];
    const sorted = [...members].sort((a, b) => x.numbers[a] - x.numbers[b]);
    const size = Math.max(5, Math.ceil(sorted.length / 24)), found = [];
    for (let k = 0; k + size <= sorted.length; k += size) {
      const part = sorted.slice(k, k + size);
      found.push([median(part.map((i) => x.numbers[i])), median(part.map((i) => q.numbers[i]))]);
    }
    return found;
  }

  function ranks(values) {
    const order = values.map((_, k) => k).sort((a, b) => values[a] - values[b]), found = [];
    for (let k = 0; k < order.length; ) {
      let end = k; // equal values share their rank
      while (end + 1 < order.length && values[order[end + 1]] === values[order[k]]) end += 1;
      for (let i = k; i <= end; i += 1) found[order[i]] = (k + end) / 2;
      k = end + 1;
    }
    return found;
  }
  function correlation(a, b, members) {
    const both = members.filter((k) => Number.isFinite(a[k]) && Number.isFinite(b[k]));
    if (both.length < 8) return NaN;
    const [x, y] = [ranks(both.map((k) => a[k])), ranks(both.map((k) => b[k]))];
    const mean = (both.length - 1) / 2;
    let xy = 0, xx = 0, yy = 0;
    x.forEach((v, k) => { xy += (v - mean) * (y[k] - mean); xx += (v - mean) ** 2; yy += (y[k] - mean) ** 2; });
    return xy / Math.sqrt(xx * yy);
  }

  function distribution(q, groups) {
    const wide = span(rows.map((k) => q.numbers[k]));
    const counts = groups.map(([, members]) => {
      const bins = new Array(BINS).fill(0);
      for (const k of members) {
        const bin = Math.floor(((q.numbers[k] - wide[0]) / (wide[1] - wide[0])) * BINS);
        if (bin >= 0 && bin < BINS) bins[bin] += 1;
      }
      return bins;
    });
    const most = Math.max(1, ...counts.flat());
    const plot = frame(get("bars"), wide, [0, 1.05 * most], (count) => ticks(wide, count).map((v) => [v, q.kind === "date" ? day(v) : short(v)]), short);
    const width = (wide[1] - wide[0]) / BINS;
    counts.forEach((bins, number) => {
      let path = `M${plot.px(wide[0])} ${plot.py(0)}`;
      bins.forEach((count, k) => { path += `V${plot.py(count).toFixed(1)}H${plot.px(wide[0] + (k + 1) * width).toFixed(1)}`; });
      get("bars").append(shape("path", { class: "bars", stroke: colour(number), fill: `var(--series-${number}-band)`, d: `${path}V${plot.py(0)}` }));
    });
    const values = rows.map((k) => q.numbers[k]).filter(Number.isFinite).sort((a, b) => a - b);
    const said = values.length ? `median ${short(quantile(values, 0.5))}, 90 % between ${short(quantile(values, 0.05))} and ${short(quantile(values, 0.95))}` : "";
    get("bars-caption").replaceChildren(`Rows by ${named(q)}`, made("small", {}, said));
  }

  get("trend").addEventListener("click", (event) => {
    if (!points) return;
    const edge = get("trend").getBoundingClientRect();
    const [x, y] = [event.clientX - edge.left, event.clientY - edge.top];
    let best = null, nearest = 20 ** 2; // pixels
    for (const k of rows) {
      const distance = (points.plot.px(points.at(k)) - x) ** 2 + (points.plot.py(points.q.numbers[k]) - y) ** 2;
      if (distance < nearest) [best, nearest] = [k, distance];
    }
    if (best !== null) tell(best);
  });

  // What can be chosen, and what goes with what most.
  const own = new Set(["samples", "dt", "log_likelihood", "nis_ratio", "outlying", "item"]);
  const estimated = columns.filter((c) => c.kind === "number" && (judged.includes(c.name) || c.name.endsWith("_std") || c.name in { nis_ratio: 1, log_likelihood: 1, outlying: 1 }));
  const others = columns.filter((c) => c.numbers && !estimated.includes(c) && !own.has(c.name) && c.name !== "outlying_in");
  const states = columns.filter((c) => c.kind === "number" && !estimated.includes(c) && !axes.includes(c.name) && `${c.name}_std` in column);
  const metadata = others.filter((c) => !states.includes(c));
  const option = (c) => made("option", { value: c.name }, named(c));
  get("quantity").append(...[...estimated, ...states, ...columns.filter((c) => c.kind === "number" && own.has(c.name) && !estimated.includes(c))].map(option));
  get("over").append(...[...metadata, ...estimated].filter((c) => c.kind !== "text" || c.words).map(option), made("option", { value: "" }, "order of the rows"));
  get("groups").append(made("option", { value: "" }, "none"), ...[...axes.map((a) => column[a]), ...metadata].filter((c) => c && new Set(c.values).size > 1).map(option));
  const several = axes.map((a) => column[a]).filter((c) => c && new Set(c.values).size > 1);
  if (several.length) get("groups").value = several[0].name;

  const every = Array.from({ length: Math.min(n, 5000) }, (_, k) => Math.floor((k * n) / Math.min(n, 5000)));
  const pairs = judged.flatMap((name) => metadata.filter((c) => !c.words && !axes.includes(c.name) && column[name].numbers).map((c) => [name, c.name, correlation(c.numbers, column[name].numbers, every)]))
    .filter(([, , r]) => Math.abs(r) >= 0.3).sort((a, b) => Math.abs(b[2]) - Math.abs(a[2])).slice(0, 6);
  if (pairs.length) {
    get("pairs").append("Moves with: ", ...pairs.map(([q, x, r]) => {
      const button = made("button", { type: "button" }, `${q} over ${x} (${r.toFixed(2)})`);
      button.addEventListener("click", () => { get("quantity").value = q; get("over").value = x; draw(); });
      return button;
    }));
    [get("quantity").value, get("over").value] = pairs[0];
  }

  const quoted = (value) => (/[",\n]/.test(value) ? `"${value.replaceAll('"', '""')}"` : value);
  get("save").addEventListener("click", () => {
    const lines = [columns.map((c) => quoted(c.name)), ...rows.map((k) => columns.map((c) => quoted(String(c.values[k] ?? ""))))];
    const file = new Blob([lines.map((l) => l.join(",")).join("\n") + "\n"], { type: "text/csv" });
    const link = made("a", { href: URL.createObjectURL(file), download: "rows.csv" });
    link.click();
    URL.revokeObjectURL(link.href);
  });
  let waiting = 0;
  get("filter").addEventListener("input", () => { clearTimeout(waiting); waiting = setTimeout(choose, 150); });
  get("choose").addEventListener("submit", (event) => event.preventDefault());
  for (const id of ["quantity", "over", "groups"]) get(id).addEventListener("change", draw);
  get("before").addEventListener("click", () => { page -= 1; list(); });
  get("after").addEventListener("click", () => { page += 1; list(); });
  new ResizeObserver(draw).observe(document.querySelector(".plots"));
  choose();
})();
