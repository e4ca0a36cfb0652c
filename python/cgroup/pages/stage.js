// Clouds on a stage. `await staged` gives a page's own script the stage, null without a chart: it may set
// `stage.more`, a function that returns the changes of further traces for each draw.
for (const button of document.querySelectorAll("[data-copy]")) button.addEventListener("click", async () => {
  const text = document.createElement("textarea");
  try { await navigator.clipboard.writeText(button.dataset.copy); } catch { // refused, or an old browser
    text.value = button.dataset.copy;
    button.after(text);
    text.select();
    document.execCommand("copy");
    text.remove();
  }
  button.textContent = "Copied";
});
const staged = (async () => {
  const view = JSON.parse(document.getElementById("stage-data").textContent);
  const get = (id) => document.getElementById(id);
  const names = ["x", "y", "z"];
  const eye = 1.6; // distance of the camera, in which the frame is 2 * 1.6 * tan(22.5 degrees) high
  let share = view.start === "joined" ? 1 : 0;
  let isPlaying = null;
  let nearest = null; // the cloud that fills the view, null for all

  let area;
  try { area = await charts.get("scene"); } catch { return null; }
  const plotly = charts.plotly;
  const traces = view.joined.map((_, k) => k);
  const centered = traces.map((k) => names.map((name, axis) =>
    numbersOf(area.data[k][name]).map((value) => value - view[view.start][k][axis])));
  document.querySelectorAll("[disabled]").forEach((control) => { control.disabled = false; });

  // Arrays as plotly writes them: bytes in base64.
  function numbersOf(array) {
    return array.bdata ? new Float32Array(bytesOf(array.bdata).buffer) : Float32Array.from(array);
  }

  function bytesOf(text) {
    return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  }

  const mix = (from, to) => from.map((value, axis) => (1 - share) * value + share * to[axis]);
  const place = (k) => mix(view.apart[k], view.joined[k]);

  // The box about all clouds, as large as it fits.
  function frame() {
    const [low, high] = [-1, 1].map((side) => (nearest === null
      ? mix(view.boxes.apart[(1 + side) / 2], view.boxes.joined[(1 + side) / 2])
      : place(nearest).map((value, axis) => value + side * 0.75 * view.sizes[nearest][axis])));
    const sizes = high.map((value, axis) => value - low[axis]);
    const most = Math.max(...sizes, 1e-30);
    const room = 0.9 * 2 * (eye - 0.3) * Math.tan(Math.PI / 8);
    const scale = room / Math.max(sizes[1], sizes[0] * area.clientHeight / area.clientWidth, 0.3 * most);
    const margin = 0.01 * most;
    const layout = {"scene.aspectmode": "manual"};
    names.forEach((name, axis) => {
      layout[`scene.${name}axis.range`] = [low[axis] - margin, high[axis] + margin];
      layout[`scene.aspectratio.${name}`] = scale * (sizes[axis] + 2 * margin);
    });
    return layout;
  }

  function draw(layout = {}) {
    const places = traces.map(place);
    const more = stage.more();
    const data = Object.fromEntries(names.map((name, axis) =>
      [name, traces.map((k) => centered[k][axis].map((value) => value + places[k][axis]))]));
    for (const [name, values] of Object.entries(more)) data[name] = [...(data[name] ?? traces.map(() => null)), ...values];
    return plotly.update(area, data, {...frame(), ...layout}, Object.values(data)[0].map((_, k) => k));
  }

  function move(to) {
    share = to;
    get("place").value = 100 * share;
    if (!isPlaying) get("play").textContent = share < 0.5 ? "Join" : "Take apart";
    return draw();
  }

  async function play() {
    if (isPlaying) { isPlaying = null; return; }
    const token = isPlaying = {};
    get("play").textContent = "Stop";
    const [from, to] = [share, share < 0.5 ? 1 : 0];
    const started = performance.now();
    for (let passed = 0; isPlaying === token && passed < 1; ) {
      await new Promise(requestAnimationFrame);
      passed = Math.min(1, (performance.now() - started) / 1500);
      await move(from + (to - from) * passed * passed * (3 - 2 * passed));
    }
    if (isPlaying === token) isPlaying = null;
    await move(share);
  }

  // Looks from above, or from a side of it by some degrees.
  function look(degrees = 0) {
    const [sine, cosine] = [Math.sin(degrees * Math.PI / 180), Math.cos(degrees * Math.PI / 180)];
    return draw({"scene.camera": {eye: {x: 0, y: -eye * sine, z: eye * cosine}, up: {x: 0, y: cosine, z: sine}, center: {x: 0, y: 0, z: 0}}});
  }

  function zoom(cloud) {
    nearest = cloud;
    return draw();
  }

  get("place").addEventListener("input", (event) => { isPlaying = null; move(event.target.value / 100); });
  get("play").addEventListener("click", play);
  get("reset").addEventListener("click", () => { nearest = null; look(); });
  addEventListener("resize", () => draw());

  async function begin() {
    await move(share);
    document.body.dataset.ready = "yes";
  }

  const stage = {view, area, plotly, traces, place, bytesOf, draw, look, zoom, begin, more: () => ({})};
  return stage;
})();
