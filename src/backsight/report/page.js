"use strict";
(() => {
  const { template, span, figures } = JSON.parse(document.getElementById("figures").textContent);
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
  const css = getComputedStyle(document.documentElement);
  const coloured = (value, key = "") => {
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
  addEventListener("beforeprint", () => places.forEach((place) => drawn.has(place) || draw(place)));

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
