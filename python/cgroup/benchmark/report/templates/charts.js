// Charts: `meta` of a chart's layout holds numbers, which become plotly's traces here. Methods that are
// switched off in one chart are switched off in all.
const chartBlocks = [...document.querySelectorAll(".chart-block")];
const filled = new Map();
const hiddenKeys = new Set();
let showIntervals = true;

const escapeText = (text) => String(text).replaceAll("&", "&amp;").replaceAll("<", "&lt;").replaceAll(">", "&gt;");
const isDark = () => matchMedia("(prefers-color-scheme: dark)").matches;
const show = (value) => value === null ? "-" : Math.abs(value) >= 1000 ? Math.round(value).toLocaleString("en") : String(Number(value.toPrecision(3)));

// Dark colours are mixed with white where the page is dark, light ones with black where it isn't.
function visible(color) {
  const parts = [1, 3, 5].map((start) => parseInt(color.slice(start, start + 2), 16));
  const light = (0.3 * parts[0] + 0.59 * parts[1] + 0.11 * parts[2]) / 255;
  if (!isDark() || light > 0.45) return color;
  const share = 0.75 * (0.55 - light) / 0.55;
  return "#" + parts.map((part) => Math.round(part + (235 - part) * share).toString(16).padStart(2, "0")).join("");
}

const fade = (color, alpha) => color + Math.round(255 * alpha).toString(16).padStart(2, "0");

function hoverText(panel, look, series, i, place) {
  const interval = typeof series.low?.[i] === "number" ? ` [${show(series.low[i])}, ${show(series.high[i])}]` : "";
  const lines = [`<b>${escapeText(look.label)}</b>`, `${escapeText(panel.y_title)}: <b>${show(series.y[i])}</b>${interval}`];
  lines.push(`${escapeText(panel.x_title)}: ${escapeText(typeof place === "number" ? show(place) : place)}`);
  if (series.counts) lines.push(`${series.counts[i]} pair${series.counts[i] === 1 ? "" : "s"}`);
  if (series.notes?.[i]) lines.push(escapeText(series.notes[i]));
  return lines.join("<br>");
}

// Bands between the ends of the intervals, one for each stretch of levels that have them.
function bandOf(series, x, color) {
  const xs = [], ys = [];
  for (let start = 0; start < x.length; start += 1) {
    if (typeof series.low?.[start] !== "number") continue;
    let end = start;
    while (typeof series.low[end + 1] === "number") end += 1;
    const stretch = Array.from({length: end - start + 1}, (_, k) => start + k);
    xs.push(...stretch.map((i) => x[i]), ...[...stretch].reverse().map((i) => x[i]), null);
    ys.push(...stretch.map((i) => series.low[i]), ...[...stretch].reverse().map((i) => series.high[i]), null);
    start = end;
  }
  return {x: xs, y: ys, mode: "lines", fill: "toself", fillcolor: fade(color, 0.1), line: {width: 0}, hoverinfo: "skip", showlegend: false};
}

function tracesOf(panel, look, series, x, texts, least) {
  const color = visible(look.color);
  const isSparse = (i) => Boolean(series.counts) && series.counts[i] < least;
  const marker = (symbols) => ({symbol: symbols, size: 8.5 * look.size, color, line: {color: isDark() ? "#16191d" : "#ffffff", width: 0.5}});
  const sparse = x.map((_, i) => isSparse(i));
  const symbols = sparse.map((few) => few ? `${look.symbol}-open` : look.symbol);
  const main = {x, y: series.y, text: texts, hoverinfo: "text", name: escapeText(look.label), marker: marker(symbols), line: {color, width: 2, dash: look.dash}};
  const markersOnly = panel.kind === "points" || typeof panel.at?.[0] === "string";
  if (panel.kind === "lines") return [{...main, mode: "lines", line: {...main.line, shape: "hv"}}];
  if (markersOnly) {
    const ends = (one, other) => series.y.map((y, i) => showIntervals && typeof series.low?.[i] === "number" ? one(i, y) : 0);
    const bars = {type: "data", symmetric: false, array: ends((i, y) => series.high[i] - y), arrayminus: ends((i, y) => y - series.low[i]), thickness: 1.2, width: 3, color};
    const labelled = panel.kind === "points" && series.y.length === 1;
    const label = labelled ? {mode: "markers+text", texttemplate: escapeText(look.label), textposition: "top center", textfont: {size: 11, color}} : {mode: "markers"};
    return [{...main, ...label, marker: {...main.marker, line: {color, width: 1}}, error_y: bars, cliponaxis: false}];
  }
  const traces = [];
  if (showIntervals) traces.push(bandOf(series, x, color));
  // A stretch between two levels is dotted if either has few pairs.
  const dotted = {x: [], y: []};
  for (let i = 0; i + 1 < x.length; i += 1) {
    if (sparse[i] || sparse[i + 1]) { dotted.x.push(x[i], x[i + 1], null); dotted.y.push(series.y[i], series.y[i + 1], null); }
  }
  const solid = {x: [], y: []};
  x.forEach((place, i) => {
    if (i && (sparse[i - 1] || sparse[i])) { solid.x.push(null); solid.y.push(null); }
    solid.x.push(place); solid.y.push(series.y[i]);
  });
  if (dotted.x.length) traces.push({...dotted, mode: "lines", hoverinfo: "skip", showlegend: false, line: {color: fade(color, 0.55), width: 1, dash: "dot"}});
  traces.push({...solid, mode: "lines", hoverinfo: "skip", showlegend: false, line: main.line});
  // The legend shows a trace's first marker, so that hollow ones are a trace of their own.
  for (const hollow of [false, true]) {
    const chosen = x.map((_, i) => i).filter((i) => sparse[i] === hollow);
    if (!chosen.length) continue;
    const pick = (values) => chosen.map((i) => values[i]);
    const outline = hollow ? {color, width: 1.5} : marker().line;
    traces.push({...main, x: pick(x), y: pick(series.y), text: pick(texts), mode: "markers", marker: {...marker(pick(symbols)), line: outline}, cliponaxis: false, showlegend: !hollow || chosen.length === x.length});
  }
  return traces;
}

function buildTraces(meta, panel) {
  const names = typeof panel.at?.[0] === "string" ? panel.at : null;
  const count = panel.series.length;
  return panel.series.flatMap((series, k) => {
    const look = meta.looks[series.key];
    const aside = names && count > 1 ? 0.64 * (k / (count - 1) - 0.5) : 0;
    const x = names ? names.map((_, i) => i + aside) : series.x ?? panel.at;
    const texts = x.map((_, i) => hoverText(panel, look, series, i, names ? names[i] : x[i]));
    const state = {legendgroup: series.key, meta: series.key, visible: hiddenKeys.has(series.key) ? "legendonly" : true};
    return tracesOf(panel, look, series, x, texts, meta.least).map((trace) => ({...trace, ...state}));
  });
}

function layoutOf(area, meta, panel) {
  const narrow = area.clientWidth < 640;
  const old = area.layout;
  const names = typeof panel.at?.[0] === "string" ? panel.at : null;
  const logarithmic = panel.logarithmic ?? "";
  const axis = (which, title) => ({...old[which], title: {text: escapeText(title), standoff: 8, font: {size: 13}}, automargin: true, zeroline: false, fixedrange: matchMedia("(pointer: coarse)").matches, showline: which === "xaxis", autorange: true, range: undefined, tickvals: undefined, ticktext: undefined, type: "linear"});
  const xaxis = axis("xaxis", panel.x_title), yaxis = axis("yaxis", panel.y_title);
  if (names) Object.assign(xaxis, {tickvals: names.map((_, i) => i), ticktext: names.map(escapeText), range: [-0.5, names.length - 0.5], autorange: false, showgrid: false});
  if (logarithmic.includes("x")) Object.assign(xaxis, {type: "log", ...(panel.at ? {tickvals: panel.at, ticktext: panel.at.map(show)} : {dtick: 1, tickformat: "~g"})});
  if (logarithmic.includes("y")) Object.assign(yaxis, {type: "log", dtick: 1, tickformat: "~g"});
  if (panel.share) Object.assign(yaxis, {range: [-0.02, 1.02], autorange: false, dtick: 0.2});
  else if (!logarithmic.includes("y")) yaxis.rangemode = "tozero";
  return {
    ...old, xaxis, yaxis, uirevision: panel.title, hovermode: "closest", showlegend: true, legend: {...old.legend, font: {size: 13}, itemsizing: "constant", ...(narrow ? {orientation: "h", x: 0, y: 1.02, yanchor: "bottom"} : {orientation: "v", x: 1.02, y: 0.95})},
    margin: {l: 52, r: 12, t: 14, b: 48}, hoverlabel: {...old.hoverlabel, align: "left"},
  };
}

function paint(block) {
  const state = filled.get(block);
  if (!state) return;
  const panel = state.meta.panels[state.panel];
  charts.plotly.react(state.area, buildTraces(state.meta, panel), layoutOf(state.area, state.meta, panel));
}

function toggle(key) {
  if (hiddenKeys.has(key)) hiddenKeys.delete(key); else hiddenKeys.add(key);
  filled.forEach((_, block) => paint(block));
}

// Shows one method alone in every chart; once more, all of them.
function isolate(key, keys) {
  const alone = keys.every((each) => (each === key) !== hiddenKeys.has(each));
  for (const each of keys) { if (each !== key && !alone) hiddenKeys.add(each); else hiddenKeys.delete(each); }
  filled.forEach((_, block) => paint(block));
}

async function fill(block) {
  if (filled.has(block)) return;
  const area = await charts.get(block.querySelector("figure.chart").id).catch(() => null);
  if (!area || filled.has(block)) return;
  const state = {area, meta: area.layout.meta, panel: 0};
  filled.set(block, state);
  const keyOf = (event) => event.data[event.curveNumber].meta;
  area.on("plotly_legendclick", (event) => { toggle(keyOf(event)); return false; });
  area.on("plotly_legenddoubleclick", (event) => { isolate(keyOf(event), Object.keys(state.meta.looks)); return false; });
  paint(block);
}

for (const block of chartBlocks) {
  const buttons = [...block.querySelectorAll("button[data-panel]")];
  for (const button of buttons) button.addEventListener("click", async () => {
    await fill(block);
    if (!filled.has(block)) return;
    filled.get(block).panel = Number(button.dataset.panel);
    buttons.forEach((other) => other.setAttribute("aria-pressed", String(other === button)));
    paint(block);
  });
}
for (const button of document.querySelectorAll("button.intervals")) button.addEventListener("click", () => {
  showIntervals = !showIntervals;
  document.querySelectorAll("button.intervals").forEach((each) => each.setAttribute("aria-pressed", String(showIntervals)));
  filled.forEach((_, block) => paint(block));
});
const chartSight = new IntersectionObserver((entries) => {
  for (const entry of entries) if (entry.isIntersecting) { chartSight.unobserve(entry.target); fill(entry.target); }
}, {rootMargin: "300px"});
chartBlocks.forEach((block) => chartSight.observe(block));
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => filled.forEach((_, block) => paint(block)));
addEventListener("beforeprint", () => chartBlocks.forEach(fill));
let lastWidth = innerWidth;
addEventListener("resize", () => { if (innerWidth !== lastWidth) { lastWidth = innerWidth; filled.forEach((_, block) => paint(block)); } });
