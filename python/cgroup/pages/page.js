"use strict";
// Charts are drawn when they come into sight. `charts.get(name)` promises the element of a drawn chart, for
// a page's own script, which may then call `charts.plotly.restyle(element, ...)`.
const charts = (() => {
  const missing = "This browser can't show the charts of this page: it is older than Chrome 80, Edge 80, Firefox 113 or Safari 16.4. Texts and tables are complete without them.";
  const noWebgl = "This chart is drawn in 3D by WebGL, which this browser or machine doesn't offer.";
  const drawn = new Map();
  let library = null;

  // Unpacks plotly, which lies in the page compressed.
  async function unpack() {
    if (!("DecompressionStream" in window)) throw new Error(missing);
    const packed = atob(document.getElementById("chart-library").textContent.trim());
    const bytes = Uint8Array.from(packed, (letter) => letter.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    const script = document.createElement("script");
    script.textContent = await new Response(stream).text();
    document.head.append(script);
    return window.Plotly;
  }

  function load() {
    library ??= unpack();
    return library;
  }

  function color(name) {
    return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  }

  // The colours that follow the page's light or dark look: a flat object, as `Plotly.relayout` takes it.
  function look(layout) {
    const colors = {
      "paper_bgcolor": "rgba(0,0,0,0)", "plot_bgcolor": "rgba(0,0,0,0)", "font.color": color("--text"),
      "hoverlabel.bgcolor": color("--soft"), "hoverlabel.bordercolor": color("--line"), "hoverlabel.font.color": color("--text"),
      "legend.bgcolor": "rgba(0,0,0,0)", "modebar.bgcolor": "rgba(0,0,0,0)", "modebar.color": color("--quiet"), "modebar.activecolor": color("--text"),
    };
    const axes = Object.keys(layout).filter((key) => /^[xy]axis\d*$/.test(key));
    for (const axis of axes.length ? axes : ["xaxis", "yaxis"]) {
      for (const part of ["gridcolor", "zerolinecolor"]) colors[`${axis}.${part}`] = color("--grid");
      colors[`${axis}.linecolor`] = color("--quiet");
    }
    return colors;
  }

  function assign(layout, flat) {
    for (const [path, value] of Object.entries(flat)) {
      const keys = path.split(".");
      const last = keys.pop();
      keys.reduce((part, key) => (part[key] ??= {}), layout)[last] = value;
    }
  }

  function hasWebgl() {
    try { return Boolean(document.createElement("canvas").getContext("webgl")); } catch { return false; }
  }

  async function draw(figure) {
    const area = figure.querySelector(".chart-area");
    try {
      const {data, layout} = JSON.parse(figure.querySelector("script").textContent);
      if (data.some((trace) => /3d$|^surface$|^cone$/.test(trace.type)) && !hasWebgl()) throw new Error(noWebgl);
      const plotly = await load();
      api.plotly = plotly;
      const touch = matchMedia("(pointer: coarse)").matches;
      if (touch && !layout.scene) layout.dragmode = false; // a finger scrolls the page
      assign(layout, {...look(layout), "font.family": getComputedStyle(document.body).fontFamily, "autosize": true});
      layout.margin ??= {l: 56, r: 16, t: layout.title ? 48 : 16, b: 48};
      area.textContent = "";
      await plotly.newPlot(area, data, layout, {
        responsive: true, displaylogo: false, scrollZoom: Boolean(layout.scene), displayModeBar: touch ? false : "hover",
        modeBarButtonsToRemove: ["lasso2d", "select2d", "resetCameraLastSave3d", "sendDataToCloud", "sendChartToCloud"],
        plotlyServerURL: "", // nothing leaves the page
      });
      return area;
    } catch (error) {
      area.textContent = error.message;
      area.className = "notice";
      throw error;
    }
  }

  function get(name) {
    const figure = document.getElementById(name);
    if (!drawn.has(figure)) drawn.set(figure, draw(figure));
    return drawn.get(figure);
  }

  function drawQuietly(figure) {
    get(figure.id).catch(() => {}); // the chart's place shows the error
  }

  const figures = [...document.querySelectorAll("figure.chart")];
  const sight = new IntersectionObserver((entries) => {
    for (const entry of entries) {
      if (!entry.isIntersecting) continue;
      sight.unobserve(entry.target);
      drawQuietly(entry.target);
    }
  }, {rootMargin: "300px"});
  figures.forEach((figure) => sight.observe(figure));
  addEventListener("beforeprint", () => figures.forEach(drawQuietly));
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", async () => {
    for (const promise of drawn.values()) {
      const area = await promise.catch(() => null);
      if (area) api.plotly.relayout(area, look(area.layout));
    }
  });

  const api = {get, plotly: null};
  return api;
})();
