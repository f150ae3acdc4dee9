// The machines of the gallery as drawings; lines take the colour of the text around them.

const frame = (inner) =>
  `<svg viewBox="0 0 160 80" fill="none" stroke="currentColor" stroke-width="2" stroke-linecap="round" stroke-linejoin="round" aria-hidden="true">${inner}</svg>`;
const ground = (x, y, w) =>
  `<path d="M${x} ${y}h${w}"/><path stroke-width="1" d="${Array.from({ length: Math.floor(w / 8) }, (_, k) => `M${x + 8 * k + 6} ${y}l-5 6`).join("")}"/>`;
const arrow = (x, y, l) => `<path d="M${x} ${y}h${l}m-6-4l6 4l-6 4"/>`;
const spring = (x, y) => `<path d="M${x} ${y}h5l3-6l6 12l6-12l6 12l6-12l3 6h5"/>`;
const damper = (x, y) => `<path d="M${x} ${y}h16m0-5v10m-5-9h15m-15 18h15M${x + 27} ${y}h13"/><path d="M${x + 11} ${y - 7}v14"/>`;
const word = (x, y, text) =>
  `<text x="${x}" y="${y}" stroke="none" fill="currentColor" font-size="12" font-style="italic" text-anchor="middle">${text}</text>`;

export const drawings = {
  mass_spring: frame(
    `<path d="M14 14v48"/><path stroke-width="1" d="M14 20l-6 5m6 5l-6 5m6 5l-6 5m6 5l-6 5"/>${spring(14, 28)}${damper(14, 50)}<rect x="54" y="16" width="40" height="44" rx="3"/>${word(74, 43, "m")}${arrow(96, 38, 34)}${word(118, 30, "F")}${ground(8, 66, 104)}`,
  ),
  friction_drive: frame(
    `${arrow(12, 34, 34)}${word(26, 26, "F")}<rect x="50" y="18" width="52" height="32" rx="3"/>${word(76, 39, "M")}<path d="M52 55q4-5 8 0t8 0t8 0t8 0t8 0t8 0"/>${ground(30, 60, 110)}<path d="M146 34h-36m6-4l-6 4l6 4"/>${word(130, 26, "load")}`,
  ),
  motor: frame(
    `<rect x="14" y="22" width="48" height="36" rx="4"/>${word(38, 45, "M")}<path d="M22 22v-10m10 10v-10"/>${word(44, 16, "i")}<path d="M62 40h28"/><rect x="90" y="16" width="14" height="48" rx="3"/>${word(97, 76, "J")}<path d="M116 26a22 22 0 0 1 0 28m1-7l-1 7l-7 0"/>${word(138, 44, "load")}`,
  ),
  two_masses: frame(
    `<rect x="22" y="18" width="16" height="44" rx="3"/>${word(30, 76, "J1")}<path d="M38 40h14l3-7l6 14l6-14l6 14l6-14l6 14l3-7h14"/><rect x="102" y="12" width="18" height="56" rx="3"/>${word(111, 79, "J2")}<path d="M12 28a18 18 0 0 0 0 24m-1-7l1 7l7 0"/>${word(8, 20, "T")}<path d="M132 28a20 20 0 0 1 0 24m1-7l-1 7l-7 0"/>${word(146, 20, "load")}`,
  ),
  equations: frame(
    `<g stroke="none" fill="currentColor" font-family="ui-monospace, monospace" font-size="13"><text x="14" y="28">q' = v</text><text x="14" y="48">v' = (F - k*q)/m</text><text x="14" y="68">y  = q</text></g>`,
  ),
};

// The smallest and largest values of the pieces of a column as an area.
export function trace({ band, low, high }) {
  if (!band || low === null) return "";
  const [least, most] = band;
  const span = high - low || 1;
  const y = (v) => (30 - (28 * (v - low)) / span).toFixed(1);
  const x = (k) => ((158 * k) / Math.max(least.length - 1, 1) + 1).toFixed(1);
  const lines = least
    .map((v, k) => (v === null ? "" : `M${x(k)} ${y(v)}V${(Number(y(most[k])) - 0.6).toFixed(1)}`))
    .join("");
  let path = "";
  least.forEach((v, k) => {
    if (v === null) return;
    path += `${k && least[k - 1] !== null ? "L" : "M"}${x(k)} ${y((v + most[k]) / 2)}`;
  });
  return `<svg viewBox="0 0 160 32" preserveAspectRatio="none" fill="none" stroke="currentColor" stroke-width="1" aria-hidden="true"><path d="${lines}"/><path d="${path}"/></svg>`;
}
