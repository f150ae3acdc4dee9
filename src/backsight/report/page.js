"use strict";
(async () => {
  const unpacked = async (id) => {
    const bytes = Uint8Array.from(atob(document.getElementById(id).textContent), (c) => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Response(stream).text();
  };
  const library = document.createElement("script");
  library.textContent = await unpacked("plotly");
  document.head.append(library);
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

  // Colours are names of CSS variables; everything else passes through.
  const css = getComputedStyle(document.documentElement); // of the medium: paper is light
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
    const { traces, layout } = coloured(figures[places.indexOf(place)]);
    const data = traces.map((t) => ({ ...t, visible: !hidden.has(t.legendgroup) }));
    const xaxis = { ...layout.xaxis };
    if (range) xaxis.range = [...range];
    // uirevision keeps what the reader zoomed when colours or visibility change.
    const view = { ...layout, xaxis, dragmode, template: coloured(template), uirevision: "kept" };
    drawn.add(place);
    Plotly.react(place, data, view, config);
    if (first) place.on("plotly_relayout", (change) => follow(place, change));
  }

  const redraw = () => drawn.forEach(draw);

  function link(change, except) {
    linking = true;
    const others = [...drawn].filter((place) => place !== except);
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
    document.querySelectorAll("details.section:not([open])").forEach((part) => {
      closed.push(part);
      part.open = true;
    });
    places.forEach((place) => {
      place.style.width = `${paper}px`;
      draw(place);
    });
  });
  addEventListener("afterprint", () => {
    closed.splice(0).forEach((part) => (part.open = false));
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
