// Two clouds and lines of matches: moves the source, shows what a method kept, and tells of a match why.
(async () => {
  const view = JSON.parse(document.getElementById("viewer-data").textContent);
  const figure = JSON.parse(document.querySelector("#scene script").textContent);
  const get = (id) => document.getElementById(id);
  const [SOURCE, TARGET, HIGHLIGHT] = [0, 1, view.kinds.length + 2];
  const cloud = (trace) => ["x", "y", "z"].map((axis) => numbersOf(figure.data[trace][axis]));
  const centered = moved(cloud(SOURCE), inverse(view.poses.apart)); // the figure has it beside the target
  const fixed = cloud(TARGET);
  let place = {start: "apart", share: 0};
  const most = 150; // lines of one kind: more hide each other
  let framed = false; // on the clouds laid together
  let chosen = Number(document.querySelector("input[name=method]:checked")?.value ?? 0);
  let pinned = null;
  let isPlaying = null;

  let area;
  try { area = await charts.get("scene"); } catch { return; }
  const plotly = charts.plotly;
  document.querySelectorAll("[disabled]").forEach((control) => { control.disabled = false; });

  // Arrays as plotly writes them: bytes in base64.
  function numbersOf(array) {
    if (!array.bdata) return Float32Array.from(array);
    return new Float32Array(bytesOf(array.bdata).buffer);
  }

  function bytesOf(text) {
    return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  }

  function color(name) {
    return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  }

  // Unit quaternion (w, x, y, z) of the rotation in a 4x4 matrix of rows.
  function quaternionOf(m) {
    const [a, b, c, d, e, f, g, h, i] = [m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]];
    const squares = [1 + a + e + i, 1 + a - e - i, 1 - a + e - i, 1 - a - e + i];
    const largest = squares.indexOf(Math.max(...squares));
    const q = [
      [squares[0], h - f, c - g, d - b],
      [h - f, squares[1], b + d, c + g],
      [c - g, b + d, squares[2], f + h],
      [d - b, c + g, f + h, squares[3]],
    ][largest];
    const length = Math.hypot(...q);
    return q.map((part) => part / length);
  }

  // Part of the way from one pose to another: the source turns about its centre and moves straight on.
  function between(from, to, share) {
    let [p, q] = [quaternionOf(from), quaternionOf(to)];
    let cosine = p.reduce((sum, part, k) => sum + part * q[k], 0);
    if (cosine < 0) { q = q.map((part) => -part); cosine = -cosine; }
    const angle = Math.acos(Math.min(1, cosine));
    const weight = (part) => (angle < 1e-4 ? part : Math.sin(part * angle) / Math.sin(angle));
    const [w, x, y, z] = p.map((part, k) => weight(1 - share) * part + weight(share) * q[k]);
    const [tx, ty, tz] = [3, 7, 11].map((k) => (1 - share) * from[k] + share * to[k]);
    return [
      1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y), tx,
      2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x), ty,
      2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y), tz,
    ];
  }

  function moved([xs, ys, zs], m) {
    const out = [0, 1, 2].map(() => new Float32Array(xs.length));
    for (let k = 0; k < xs.length; k++) {
      const [x, y, z] = [xs[k], ys[k], zs[k]];
      for (let row = 0; row < 3; row++) out[row][k] = m[4 * row] * x + m[4 * row + 1] * y + m[4 * row + 2] * z + m[4 * row + 3];
    }
    return out;
  }

  function inverse(m) {
    const turned = [m[0], m[4], m[8], 0, m[1], m[5], m[9], 0, m[2], m[6], m[10], 0];
    const [x, y, z] = moved([[m[3]], [m[7]], [m[11]]], turned);
    [turned[3], turned[7], turned[11]] = [-x[0], -y[0], -z[0]];
    return turned;
  }

  const pose = () => between(view.poses[place.start], view.poses.placed, place.share);

  // Lines of some matches: vertices along each, so that the mouse finds it, and a gap.
  function lines(rows) {
    const m = pose();
    const out = {x: [], y: [], z: [], customdata: []};
    for (const row of rows) {
      const [p, q] = [view.matches.source[row], view.matches.target[row]];
      for (let axis = 0; axis < 3; axis++) {
        const start = m[4 * axis] * p[0] + m[4 * axis + 1] * p[1] + m[4 * axis + 2] * p[2] + m[4 * axis + 3];
        for (let stop = 0; stop <= 6; stop++) out["xyz"[axis]].push(start + (stop / 6) * (q[axis] - start));
        out["xyz"[axis]].push(null);
      }
      for (let stop = 0; stop <= 7; stop++) out.customdata.push(row);
    }
    return out;
  }

  const kindOf = (row) => view.methods[chosen].kind[row];
  const rowsOf = (kind) => view.matches.index.map((_, row) => row).filter((row) => kindOf(row) === kind);
  const spread = (rows) => (rows.length <= most ? rows : Array.from({length: most}, (_, k) => rows[Math.floor(k * (rows.length - 1) / (most - 1))]));
  const isShown = (id) => get(`show-${id}`).checked;

  // All that moves with the source, for one call of plotly.
  function changes() {
    const kinds = view.kinds.map((kind, k) => lines(isShown(kind.id) ? spread(rowsOf(k)) : []));
    const all = [...kinds, lines(pinned === null ? [] : [pinned])];
    const [x, y, z] = moved(centered, pose());
    const part = (name, of) => [of, ...all.map((each) => each[name])];
    const colors = [...view.kinds.map((kind) => color(kind.id)), color("text")];
    const traces = [SOURCE, ...all.map((_, k) => k + 2)];
    return [{
      x: part("x", x), y: part("y", y), z: part("z", z), customdata: part("customdata", null),
      visible: [isShown("source"), ...all.map(() => true)], "line.color": [null, ...colors],
    }, traces];
  }

  const draw = () => plotly.restyle(area, ...changes());

  // The marker of a cloud: shaded in the colour of its scan, coloured by distance, or as the scanner saw it.
  function marker(cloud, colors) {
    const {color, colorscale} = figure.data[cloud].marker;
    if (colors === "distance") {
      const {stops, alone, distance} = view.colors;
      const ramp = stops.map((stop, k) => [k / (stops.length - 1) * 254 / 255, stop]);
      return {color: Array.from(bytesOf(distance[cloud])), colorscale: [...ramp, [254.5 / 255, alone], [1, alone]]};
    }
    const own = colors === "own" && view.colors.own[cloud];
    if (!own) return {color, colorscale};
    const bytes = bytesOf(own);
    return {color: Array.from({length: bytes.length / 3}, (_, k) => `rgb(${bytes.subarray(3 * k, 3 * k + 3).join()})`), colorscale};
  }

  function paint() {
    const colors = document.body.dataset.colors = get("colors").value;
    get("legend").hidden = colors !== "distance";
    const markers = [SOURCE, TARGET].map((cloud) => marker(cloud, colors));
    return plotly.restyle(area, Object.fromEntries(["color", "colorscale"].map((name) =>
      [`marker.${name}`, markers.map((each) => each[name])])), [SOURCE, TARGET]);
  }

  // What the slider can show, or the clouds laid together.
  function shownClouds() {
    const ends = place.share === 1 ? ["placed"] : [place.start, "placed"];
    return [fixed, ...ends.map((end) => moved(centered, view.poses[end]))];
  }

  // Their box, in one scale along all axes.
  function frame() {
    const clouds = shownClouds();
    const low = [0, 1, 2].map((axis) => Math.min(...clouds.map((cloud) => cloud[axis].reduce((a, b) => Math.min(a, b)))));
    const high = [0, 1, 2].map((axis) => Math.max(...clouds.map((cloud) => cloud[axis].reduce((a, b) => Math.max(a, b)))));
    const sizes = high.map((value, axis) => value - low[axis]);
    const most = Math.max(...sizes) || 1;
    const margin = 0.02 * most;
    const layout = {"scene.aspectmode": "manual"};
    ["x", "y", "z"].forEach((name, axis) => {
      layout[`scene.${name}axis.range`] = [low[axis] - margin, high[axis] + margin];
      layout[`scene.aspectratio.${name}`] = (sizes[axis] + 2 * margin) / most;
    });
    return layout;
  }

  // Points as the camera has them, without the one in 500 that lies far out on either side of a cloud.
  function core(layout) {
    const clouds = shownClouds();
    const sorted = clouds.map((cloud) => cloud.map((values) => Float64Array.from(values).sort()));
    const sides = ["x", "y", "z"].map((name, axis) => {
      const quantile = (share) => sorted.map((cloud) => cloud[axis][Math.round(share * (cloud[axis].length - 1))]);
      const [inner, outer] = [Math.min(...quantile(0.002)), Math.max(...quantile(0.998))];
      const [first, last] = layout[`scene.${name}axis.range`];
      const room = 0.3 * (outer - inner);
      return {low: inner - room, high: outer + room, middle: (first + last) / 2, scale: layout[`scene.aspectratio.${name}`] / (last - first)};
    });
    const points = [];
    for (const cloud of clouds) {
      for (let k = 0; k < cloud[0].length; k++) {
        const point = [cloud[0][k], cloud[1][k], cloud[2][k]];
        if (point.every((value, axis) => value >= sides[axis].low && value <= sides[axis].high))
          points.push(point.map((value, axis) => sides[axis].scale * (value - sides[axis].middle)));
      }
    }
    return points;
  }

  const dot = (one, other) => one.reduce((sum, value, k) => sum + value * other[k], 0);
  const cross = ([a, b, c], [d, e, f]) => [b * f - c * e, c * d - a * f, a * e - b * d];
  const normalized = (vector) => vector.map((value) => value / Math.hypot(...vector));
  // Without its part along a direction; if nothing much is left, that of another vector.
  function across(vector, direction, instead) {
    const part = dot(vector, direction);
    const rest = vector.map((value, k) => value - part * direction[k]);
    return Math.hypot(...rest) < 0.3 ? across(instead, direction, vector) : normalized(rest);
  }

  // The view that shows most of the target; where the clouds stand as given, from a side that shows both.
  function directions() {
    const {right, up, towards} = view.camera;
    const from = view.poses.given;
    const offset = [from[3], from[7], from[11]];
    if (place.start !== "given" || place.share === 1 || !Math.hypot(...offset)) return {right, up, towards};
    const eye = across(towards, normalized(offset), up);
    const top = across(up, eye, right);
    return {right: cross(top, eye), up: top, towards: eye};
  }

  // The directions of the camera as it stands.
  function present() {
    const {eye, center, up} = area.layout.scene.camera;
    const towards = normalized(["x", "y", "z"].map((name) => eye[name] - center[name]));
    const top = across([up.x, up.y, up.z], towards, [0, 0, 1]);
    return {right: cross(top, towards), up: top, towards};
  }

  // The whole of the clouds as large as it fits.
  function wholeView(axes = directions()) {
    framed = place.share === 1;
    const layout = frame();
    const seen = core(layout).map((point) => ["right", "up", "towards"].map((name) => dot(point, axes[name])));
    const [low, high] = [Math.min, Math.max].map((pick) => [0, 1, 2].map((k) => seen.reduce((end, point) => pick(end, point[k]), seen[0][k])));
    const middle = low.map((value, k) => (value + high[k]) / 2);
    const [tangent, aspect, room] = [Math.tan(Math.PI / 8), area.clientWidth / area.clientHeight, 1.08]; // of half of plotly's field of view
    const half = ([right, up]) => room * Math.max(Math.abs(up - middle[1]), Math.abs(right - middle[0]) / aspect);
    const away = seen.reduce((most, point) => Math.max(most, point[2] - middle[2] + half(point) / tangent), 0);
    const center = [0, 1, 2].map((k) => axes.right[k] * middle[0] + axes.up[k] * middle[1] + axes.towards[k] * middle[2]);
    const eye = axes.towards.map((value, k) => center[k] + away * value);
    const isPerspective = get("perspective").checked;
    // Without perspective the frame is two units high, from wherever it is seen.
    const scale = isPerspective ? 1 : 1 / seen.reduce((most, point) => Math.max(most, half(point)), 1e-9);
    for (const name of ["x", "y", "z"]) layout[`scene.aspectratio.${name}`] *= scale;
    const named = (vector) => Object.fromEntries(["x", "y", "z"].map((name, k) => [name, scale * vector[k]]));
    const type = isPerspective ? "perspective" : "orthographic";
    return {...layout, "scene.camera": {eye: named(eye), up: named(axes.up), center: named(center), projection: {type}}};
  }

  const resetView = () => plotly.relayout(area, wholeView());
  const keepInView = () => plotly.relayout(area, wholeView(present()));

  function show(move) {
    place = {...place, ...move};
    get("place").value = 100 * place.share;
    get("start").value = place.start;
    if (!isPlaying) get("play").textContent = place.share < 0.5 ? "Place it" : "Take it off";
    return draw();
  }

  async function play() {
    if (isPlaying) { isPlaying = null; return; }
    const token = isPlaying = {};
    get("play").textContent = "Stop";
    const [from, to] = [place.share, place.share < 0.5 ? 1 : 0];
    if (from === 1) { place.share = 0.999; await keepInView(); }
    const started = performance.now();
    for (let passed = 0; isPlaying === token && passed < 1; ) {
      await new Promise(requestAnimationFrame);
      passed = Math.min(1, (performance.now() - started) / 1500);
      const eased = passed * passed * (3 - 2 * passed);
      await show({share: from + (to - from) * eased});
    }
    if (isPlaying === token) { isPlaying = null; await keepInView(); }
    await show({});
  }

  // What is known of a match, in words and numbers.
  const unit = (value) => (value === null ? null : `${Number(value.toPrecision(3))}${view.unit}`);

  function factsOf(row) {
    const method = view.methods[chosen];
    const at = (name) => (method[name] ? method[name][row] : null);
    const facts = [["it is", view.kinds[kindOf(row)].name]];
    if (at("score") !== null) facts.push(["score", `${Number(at("score").toPrecision(3))}, rank ${at("rank")} of ${view.count}`]);
    if (at("residual") !== null) facts.push(["off under the group's pose", unit(at("residual"))]);
    if (view.matches.error) facts.push(["off under the true pose", unit(view.matches.error[row])]);
    if (at("agreeing") !== null) facts.push(["keeps its distance to", `${at("agreeing")} others, ${at("agreeing_in_group")} of the group`]);
    return facts;
  }

  function element(name, text) {
    const made = document.createElement(name);
    made.textContent = text;
    return made;
  }

  function tell(row) {
    const place = get("about");
    place.textContent = "";
    if (row === null) { place.append(element("p", view.hint)); return; }
    const list = document.createElement("dl");
    for (const [name, value] of factsOf(row)) list.append(element("dt", name), element("dd", value));
    const why = view.methods[chosen].why[row];
    place.append(element("p", `Match ${view.matches.index[row]}: ${why}.`), list);
  }

  async function pin(row) {
    pinned = row;
    if (row !== null) get("number").value = view.matches.index[row];
    tell(row);
    await draw();
  }

  function count() {
    view.kinds.forEach((kind, k) => {
      const [count, drawn] = [view.methods[chosen].counts[k], spread(rowsOf(k)).length];
      const text = count.toLocaleString("en");
      get(`count-${kind.id}`).textContent = drawn < count ? `${drawn} of ${text} drawn` : text;
    });
  }

  function choose(method) {
    chosen = method;
    count();
    tell(pinned);
    return draw();
  }

  function find() {
    const wanted = Number(get("number").value);
    const row = view.matches.index.indexOf(wanted);
    if (row >= 0) { pin(row); return; }
    pinned = null;
    const drawn = view.matches.index.length;
    get("about").replaceChildren(element("p", drawn < view.count && wanted >= 0 && wanted < view.count
      ? `Match ${wanted} isn't among the ${drawn} that this page holds. In Python: grouping.explain(${wanted}).`
      : `There are matches 0 to ${view.count - 1}.`));
    draw();
  }

  // The tip follows the mouse; a click or a tap keeps the match.
  const tip = get("tip");
  let mouse = [0, 0];
  area.parentElement.addEventListener("pointermove", (event) => {
    const box = area.parentElement.getBoundingClientRect();
    mouse = [event.clientX - box.left, event.clientY - box.top];
  });
  const rowAt = (event) => { const row = event.points[0].customdata; return typeof row === "number" ? row : null; };
  let hovered = null;
  area.on("plotly_hover", (event) => {
    const row = hovered = rowAt(event);
    if (row === null) return;
    tip.textContent = `Match ${view.matches.index[row]}, ${view.kinds[kindOf(row)].name}: ${view.methods[chosen].why[row]}`;
    tip.hidden = false;
    const [width, height] = [area.clientWidth, area.clientHeight];
    tip.style.left = `${Math.max(4, Math.min(mouse[0] + 14, width - tip.offsetWidth - 6))}px`;
    tip.style.top = `${Math.max(4, mouse[1] + 18 + tip.offsetHeight > height ? mouse[1] - tip.offsetHeight - 12 : mouse[1] + 18)}px`;
  });
  area.on("plotly_unhover", () => { tip.hidden = true; hovered = null; });
  let pressed = [0, 0];
  area.parentElement.addEventListener("pointerdown", (event) => { pressed = [event.clientX, event.clientY]; }, true);
  area.parentElement.addEventListener("pointerup", (event) => {
    const still = Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < 6;
    // After a tap plotly looks for what lies under the finger when it draws next.
    if (still) setTimeout(() => { if (hovered !== null) pin(hovered); }, event.pointerType === "touch" ? 250 : 0);
  }, true);

  get("place").addEventListener("input", async (event) => {
    isPlaying = null;
    await show({share: event.target.value / 100});
    if (framed && place.share < 1) keepInView();
  });
  get("start").addEventListener("change", async (event) => { isPlaying = null; await show({start: event.target.value, share: 0}); resetView(); });
  get("play").addEventListener("click", play);
  get("reset").addEventListener("click", resetView);
  get("perspective").addEventListener("change", keepInView);
  get("colors").addEventListener("change", paint);
  get("number").addEventListener("change", find);
  for (const box of document.querySelectorAll(".show input")) {
    box.addEventListener("change", () => (box.id === "show-target" ? plotly.restyle(area, {visible: box.checked}, [TARGET]) : draw()));
  }
  for (const box of document.querySelectorAll("input[name=method]")) box.addEventListener("change", () => choose(Number(box.value)));
  document.querySelector(".methods tbody")?.addEventListener("click", (event) => event.target.closest("tr")?.querySelector("input").click());
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);

  tell(null);
  count();
  const [data, traces] = changes();
  await plotly.update(area, data, wholeView(), traces);
  await paint();
  document.body.dataset.ready = "yes";
})();
