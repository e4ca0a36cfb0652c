// Many scans: moves them from side by side to where their poses lay them, shows some of them, and tells of edges.
(async () => {
  const view = JSON.parse(document.getElementById("scene-data").textContent);
  const get = (id) => document.getElementById(id);
  const boxes = [...document.querySelectorAll(".scans input")];
  const names = ["x", "y", "z"];
  const eye = 1.6; // distance of the camera, in which the frame is 2 * 1.6 * tan(22.5 degrees) high
  let share = 1;
  let isPlaying = null;

  let area;
  try { area = await charts.get("scene"); } catch { return; }
  const plotly = charts.plotly;
  // About the middle of each scan.
  const centered = area.data.map((trace, k) => names.map((name, axis) =>
    numbersOf(trace[name]).map((value) => value - view.joined[k][axis])));
  const all = area.data.map((_, k) => k);
  document.querySelectorAll("[disabled]").forEach((control) => { control.disabled = false; });

  // Arrays as plotly writes them: bytes in base64.
  function numbersOf(array) {
    if (!array.bdata) return Float32Array.from(array);
    return new Float32Array(Uint8Array.from(atob(array.bdata), (letter) => letter.charCodeAt(0)).buffer);
  }

  const mix = (from, to) => from.map((value, axis) => (1 - share) * value + share * to[axis]);

  // The box about all scans, as large as it fits.
  function frame() {
    const [low, high] = [0, 1].map((end) => mix(view.boxes.apart[end], view.boxes.joined[end]));
    const sizes = high.map((value, axis) => value - low[axis]);
    const most = Math.max(...sizes, 1e-30);
    const room = 0.9 * 2 * (eye - 0.3) * Math.tan(Math.PI / 8);
    const scale = room / Math.max(sizes[1], sizes[0] * area.clientHeight / area.clientWidth, 0.3 * most);
    const margin = 0.01 * most;
    const layout = {};
    names.forEach((name, axis) => {
      layout[`scene.${name}axis.range`] = [low[axis] - margin, high[axis] + margin];
      layout[`scene.aspectratio.${name}`] = scale * (sizes[axis] + 2 * margin);
    });
    return layout;
  }

  function draw(layout = {}) {
    const places = all.map((k) => mix(view.apart[k], view.joined[k]));
    const data = Object.fromEntries(names.map((name, axis) =>
      [name, all.map((k) => centered[k][axis].map((value) => value + places[k][axis]))]));
    return plotly.update(area, data, {...frame(), ...layout}, all);
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

  function showScans() {
    const shown = new Set(boxes.filter((box) => box.checked).map((box) => Number(box.dataset.row)));
    return plotly.restyle(area, {visible: view.rows.map((row) => shown.has(row))}, all);
  }

  // An edge of the graph, the same line of the table, and its two scans alone; null for all.
  function choose(edge) {
    const chosen = edge === null ? null : view.edges[edge];
    for (const each of document.querySelectorAll("[data-edge]")) each.classList.toggle("chosen", Number(each.dataset.edge) === edge);
    for (const box of boxes) box.checked = !chosen || chosen.includes(Number(box.dataset.row));
    return showScans();
  }

  const resetView = () => draw({"scene.camera": {eye: {x: 0, y: 0, z: eye}, up: {x: 0, y: 1, z: 0}, center: {x: 0, y: 0, z: 0}}});

  get("place").addEventListener("input", (event) => { isPlaying = null; move(event.target.value / 100); });
  get("play").addEventListener("click", play);
  get("reset").addEventListener("click", resetView);
  get("all").addEventListener("click", () => choose(null));
  for (const box of boxes) box.addEventListener("change", showScans);
  for (const each of document.querySelectorAll("[data-edge]")) {
    const toggle = () => choose(each.classList.contains("chosen") ? null : Number(each.dataset.edge));
    each.addEventListener("click", toggle);
    each.addEventListener("keydown", (event) => { if (event.key === "Enter") toggle(); });
  }
  addEventListener("resize", () => draw());
  await draw();
  document.body.dataset.ready = "yes";
})();
