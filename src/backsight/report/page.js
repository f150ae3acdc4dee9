"use strict";
(async () => {
  const unpacked = async (id) => {
    const bytes = Uint8Array.from(atob(document.getElementById(id).textContent), (c) => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Response(stream).text();
  };
  if (!globalThis.Plotly) {
    const library = document.createElement("script");
    library.textContent = await unpacked("plotly");
    document.head.append(library);
  }
  const { template, span, figures } = JSON.parse(await unpacked("figures"));

  // Numbers of samples become times; the largest number is a gap.
  const kinds = { u2: Uint16Array, u4: Uint32Array };
  const times = ({ start, step, places }) => {
    const Kind = kinds[places.dtype];
    const raw = Uint8Array.from(atob(places.bdata), (c) => c.charCodeAt(0));
    const gap = 2 ** (8 * Kind.BYTES_PER_ELEMENT) - 1;
    return Float64Array.from(new Kind(raw.buffer), (k) => (k === gap ? NaN : start + step * k));
  };
  for (const { traces } of figures)
    for (const trace of traces) if (trace.x?.places) trace.x = times(trace.x);

  // What zooming in brings out is unpacked when somebody zooms in.
  let details = null;
  const unpackedDetails = async () => (details ??= JSON.parse(await unpacked("details")));
  const numbers = ({ dtype, bdata, low, unit }) => {
    const raw = Uint8Array.from(atob(bdata), (c) => c.charCodeAt(0)).buffer;
    if (dtype === "f4") return new Float32Array(raw);
    // Differences modulo 2**16: all low bytes, then all high ones.
    const bytes = new Uint8Array(raw);
    const n = bytes.length / 2;
    let code = 0;
    return Float64Array.from({ length: n }, (_, k) => {
      code = (code + bytes[k] + 256 * bytes[n + k]) & 65535;
      return code === 65535 ? NaN : low + unit * code;
    });
  };
  const column = (detail, k) => ((detail.numbers ??= [])[k] ??= numbers(detail.values[k]));

  // Samples from one to another; of every few, the smallest and the largest if there are many.
  function stretch(detail, from, to, most) {
    const values = column(detail, 0);
    const first = Math.max(0, Math.floor((from - detail.start) / detail.step) - 1);
    const last = Math.min(values.length - 1, Math.ceil((to - detail.start) / detail.step) + 1);
    const every = Math.max(1, Math.ceil((2 * (last - first + 1)) / most));
    return { first, last, every, at: (k) => detail.start + k * detail.step };
  }
  function detailedLine(detail, from, to, most) {
    const { first, last, every, at } = stretch(detail, from, to, most);
    const values = column(detail, 0);
    const gaps = new Set(detail.gaps);
    const [x, y] = [[], []];
    for (let k = first; k <= last; k += every) {
      let [low, high] = [-1, -1];
      for (let i = k; i < Math.min(k + every, last + 1); i++) {
        if (gaps.has(i)) { x.push(at(i)); y.push(NaN); }
        if (Number.isNaN(values[i])) continue;
        if (low < 0 || values[i] < values[low]) low = i;
        if (high < 0 || values[i] > values[high]) high = i;
      }
      const kept = low < 0 ? [] : low === high ? [low] : [Math.min(low, high), Math.max(low, high)];
      for (const i of kept) { x.push(at(i)); y.push(values[i]); }
    }
    return { x, y };
  }
  function detailedBand(detail, from, to, most) {
    const { first, last, every, at } = stretch(detail, from, to, most);
    const [lower, upper] = [column(detail, 0), column(detail, 1)];
    const [x, y] = [[], []];
    let piece = [];
    const close = () => {
      if (!piece.length) return;
      const back = [...piece].reverse();
      x.push(...piece.map((p) => p[0]), ...back.map((p) => p[0]), NaN);
      y.push(...piece.map((p) => p[2]), ...back.map((p) => p[1]), NaN);
      piece = [];
    };
    for (let k = first; k <= last; k += every) {
      let [low, high] = [Infinity, -Infinity];
      for (let i = k; i < Math.min(k + every, last + 1); i++) {
        if (lower[i] < low) low = lower[i];
        if (upper[i] > high) high = upper[i];
      }
      if (low === Infinity || high === -Infinity) close();
      else piece.push([at(k), low, high]);
    }
    close();
    return { x, y };
  }
  function detailed(trace, from, to, most) {
    const detail = details[trace.detail];
    if (detail.kind === "band") return detailedBand(detail, from, to, most);
    const { x, y } = detailedLine(detail, from, to, most);
    if (detail.kind === "line")
      return { x, y, customdata: undefined, hovertemplate: "%{y:.5~g}" };
    return { x: [...x, NaN, ...x], y: [...y, NaN, ...y.map((v) => -v)] };
  }
  const closer = () => range && range[1] - range[0] < 0.7 * (span[1] - span[0]);

  const places = [...document.querySelectorAll("figure")];
  const drawn = new Set();
  const hidden = new Set();
  const touch = matchMedia("(pointer: coarse)").matches;
  const config = {
    displaylogo: false,
    displayModeBar: touch ? false : "hover",
    modeBarButtons: [["toImage", "zoom2d", "pan2d", "resetScale2d"]],
    showSendToCloud: false, // the measurements stay on this machine
    plotlyServerURL: "",
    showTips: false,
    doubleClick: touch ? false : "reset+autosize", // a tap would count as two clicks
  };
  let range = span; // of the time axis, common to all plots; null is whatever each has
  let dragmode = touch ? false : "zoom"; // a finger scrolls the page until told otherwise
  let linking = false;
  let width; // of every plot on paper [px]; on a screen it is that of its place

  // Colours are names of CSS variables; everything else passes through.
  const css = getComputedStyle(document.documentElement);
  const coloured = (value, key = "") => {
    if (ArrayBuffer.isView(value)) return value;
    if (Array.isArray(value)) return value.map((v) => coloured(v, key));
    if (value && typeof value === "object")
      return Object.fromEntries(Object.entries(value).map(([k, v]) => [k, coloured(v, k)]));
    const named = typeof value === "string" && /color(scale)?$/.test(key) && value.startsWith("--");
    return named ? css.getPropertyValue(value).trim() : value;
  };

  function draw(place) {
    const first = !drawn.has(place);
    const { traces, layout, over } = coloured(figures[places.indexOf(place)]);
    const near = details?.length && closer();
    const data = traces.map((t) => ({
      ...t,
      ...(near && t.detail !== undefined ? detailed(t, ...range, 4000) : {}),
      visible: !hidden.has(t.legendgroup),
    }));
    const xaxis = { ...layout.xaxis };
    if (range && over === "time") xaxis.range = [...range];
    // uirevision keeps what the reader zoomed when colours or visibility change.
    const view = { ...layout, xaxis, dragmode, width, template: coloured(template), uirevision: "kept" };
    drawn.add(place);
    Plotly.react(place, data, view, config);
    if (first && over === "time") place.on("plotly_relayout", (change) => follow(place, change));
  }

  const redraw = () => drawn.forEach(draw);

  function link(change, except) {
    linking = true;
    const timely = (place) => figures[places.indexOf(place)].over === "time";
    const others = [...drawn].filter((place) => place !== except && timely(place));
    Promise.all(others.map((place) => Plotly.relayout(place, change))).finally(() => {
      linking = false;
    });
  }

  function follow(place, change) {
    if (linking) return;
    const ends = change["xaxis.range"] ?? [change["xaxis.range[0]"], change["xaxis.range[1]"]];
    if (ends[0] !== undefined) {
      range = ends;
      link({ "xaxis.range": [...ends] }, place);
    } else if (change["xaxis.autorange"]) {
      range = null;
      link({ "xaxis.autorange": true }, place);
    }
    if (ends[0] !== undefined || change["xaxis.autorange"]) refine();
  }

  // Lines get their samples when the reader has come to rest.
  const anyDetails = figures.some(({ traces }) => traces.some((t) => t.detail !== undefined));
  let due = 0;
  function refine() {
    if (!anyDetails) return;
    clearTimeout(due);
    due = setTimeout(async () => {
      await unpackedDetails();
      redraw();
    }, 150);
  }

  document.querySelectorAll("nav [data-group]").forEach((button) =>
    button.addEventListener("click", () => {
      const group = button.dataset.group;
      if (!hidden.delete(group)) hidden.add(group);
      button.setAttribute("aria-pressed", String(!hidden.has(group)));
      redraw();
    }),
  );
  document.getElementById("reset").addEventListener("click", () => {
    const again = [...drawn];
    range = span;
    drawn.clear();
    again.forEach((place) => {
      Plotly.purge(place);
      draw(place);
    });
  });
  document.getElementById("drag").addEventListener("click", (event) => {
    dragmode = dragmode ? false : "zoom";
    event.target.setAttribute("aria-pressed", String(Boolean(dragmode)));
    redraw();
  });

  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);

  // Paper has its own width and is always light: every plot is drawn again for it.
  const paper = 660; // pixels between the margins of A4 and of letter
  const closed = [];
  addEventListener("beforeprint", () => {
    document.documentElement.classList.add("on-paper"); // now the medium is still the screen
    document.querySelectorAll("details:is(.section, .part):not([open])").forEach((part) => {
      closed.push(part);
      part.open = true;
    });
    width = paper;
    places.forEach((place) => {
      place.style.width = `${paper}px`;
      draw(place);
    });
  });
  addEventListener("afterprint", () => {
    document.documentElement.classList.remove("on-paper");
    closed.splice(0).forEach((part) => (part.open = false));
    width = undefined;
    places.forEach((place) => (place.style.width = ""));
    redraw();
  });

  // On a phone the page begins with its answers; a touch opens the rest, section by section.
  if (matchMedia("(max-width: 40rem)").matches)
    document.querySelectorAll("details.section").forEach((part) => (part.open = false));
  document.querySelectorAll("nav a").forEach((link) =>
    link.addEventListener("click", () => {
      document.querySelector(link.hash).open = true;
    }),
  );

  // Every plot is to be had as numbers and as a picture.
  async function numbersOf(place) {
    const { traces, over } = figures[places.indexOf(place)];
    if (anyDetails) await unpackedDetails();
    const names = [over === "time" ? "time_s" : "frequency_Hz"];
    const rows = new Map();
    for (const trace of traces.filter((t) => t.name && t.x && t.y && t.type === "scatter")) {
      const whole = trace.detail === undefined || !details.length ? null : detailedLine(details[trace.detail], -Infinity, Infinity, Infinity);
      const { x, y } = whole ?? { x: trace.x, y: typeof trace.y.bdata === "string" ? plain(trace.y) : trace.y };
      for (let k = 0; k < x.length; k++) {
        if (Number.isNaN(x[k])) continue;
        const row = rows.get(x[k]) ?? rows.set(x[k], []).get(x[k]);
        if (!Number.isNaN(y[k])) row[names.length - 1] = y[k];
      }
      names.push(trace.yaxis === "y2" ? `residual of ${trace.name}` : trace.name);
    }
    const cell = (value) => (value === undefined ? "" : String(Number(value.toPrecision(8))));
    const lines = [...rows].sort((a, b) => a[0] - b[0]);
    const quoted = names.map((name) => `"${name.replace(/"/g, '""')}"`);
    return [quoted.join(","), ...lines.map(([x, row]) =>
      [x, ...Array.from({ length: names.length - 1 }, (_, k) => row[k])].map(cell).join(","))].join("\n");
  }
  const plain = ({ dtype, bdata }) => {
    const raw = Uint8Array.from(atob(bdata), (c) => c.charCodeAt(0)).buffer;
    return dtype === "f4" ? new Float32Array(raw) : new Float64Array(raw);
  };
  const fileName = (place) => place.getAttribute("aria-label").replace(/[^A-Za-z0-9_]+/g, "-").slice(0, 60);
  const saved = (text, name) => {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([text], { type: "text/csv" }));
    link.download = name;
    link.click();
    URL.revokeObjectURL(link.href);
  };
  const takes = {
    CSV: async (place) => saved(await numbersOf(place), `${fileName(place)}.csv`),
    picture: async (place) => {
      if (!drawn.has(place)) draw(place);
      await Plotly.downloadImage(place, { format: "png", scale: 2, filename: fileName(place) });
    },
  };
  places.forEach((place) => {
    const bar = document.createElement("p");
    bar.className = "take";
    for (const [word, take] of Object.entries(takes)) {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = word;
      button.setAttribute("aria-label", `${word} of ${place.getAttribute("aria-label")}`);
      button.addEventListener("click", () => take(place));
      bar.append(button);
    }
    place.after(bar);
  });

  document.querySelectorAll(".scroll").forEach((box) => {
    const button = document.createElement("button");
    button.className = "copy";
    button.type = "button";
    button.textContent = "copy";
    button.addEventListener("click", () => {
      const rows = [...box.querySelectorAll("tr")].map((row) =>
        [...row.cells].map((cell) => cell.innerText.replace(/\s+/g, " ").trim()).join("\t"),
      );
      navigator.clipboard.writeText(rows.join("\n")).then(() => (button.textContent = "copied"));
    });
    box.before(button);
  });

  // Plotly notices a resized window, but not a figure that became narrower within it.
  const fitter = new ResizeObserver((entries) =>
    entries.forEach(({ target }) => drawn.has(target) && Plotly.relayout(target, { autosize: true })),
  );
  places.forEach((place) => fitter.observe(place));

  // A plot is drawn when it comes near the screen: long pages open at once.
  const watcher = new IntersectionObserver(
    (entries) =>
      entries
        .filter((entry) => entry.isIntersecting)
        .forEach(({ target }) => {
          watcher.unobserve(target);
          draw(target);
        }),
    { rootMargin: "600px" },
  );
  places.forEach((place) => watcher.observe(place));
})();
