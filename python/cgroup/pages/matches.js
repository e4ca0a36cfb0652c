// Lines of matches: shows the group of a method, and explains each match.
(async () => {
  const stage = await staged;
  if (!stage) return;
  const {view, area, plotly, bytesOf, draw} = stage;
  const get = (id) => document.getElementById(id);
  const [SOURCE, TARGET] = [0, 1];
  const most = 150; // lines of one kind: more hide each other
  const markers = [SOURCE, TARGET].map((cloud) => ({...area.data[cloud].marker}));
  let chosen = Number(document.querySelector("input[name=method]:checked")?.value ?? 0);
  let pinned = null;

  function color(name) {
    return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  }

  // Lines of some matches: vertices along each, so that the mouse finds it, and a gap.
  function lines(rows) {
    const [from, to] = [SOURCE, TARGET].map(stage.place);
    const out = {x: [], y: [], z: [], customdata: []};
    for (const row of rows) {
      for (let axis = 0; axis < 3; axis++) {
        const [start, end] = [view.matches.source[row][axis] + from[axis], view.matches.target[row][axis] + to[axis]];
        for (let stop = 0; stop <= 6; stop++) out["xyz"[axis]].push(start + (stop / 6) * (end - start));
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

  // Traces of each kind of match, and of the pinned one.
  stage.more = () => {
    const kinds = view.kinds.map((kind, k) => lines(isShown(kind.id) ? spread(rowsOf(k)) : []));
    const all = [...kinds, lines(pinned === null ? [] : [pinned])];
    const changes = Object.fromEntries(["x", "y", "z", "customdata"].map((name) => [name, all.map((each) => each[name])]));
    return {...changes, "line.color": [...view.kinds.map((kind) => color(kind.id)), color("text")]};
  };

  // The marker of a cloud: shaded in one colour, coloured by distance, or in its own colours.
  function marker(cloud, colors) {
    const {color, colorscale} = markers[cloud];
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
    const painted = [SOURCE, TARGET].map((cloud) => marker(cloud, colors));
    return plotly.restyle(area, Object.fromEntries(["color", "colorscale"].map((name) =>
      [`marker.${name}`, painted.map((each) => each[name])])), [SOURCE, TARGET]);
  }

  // Words and numbers of a match.
  const unit = (value) => (value === null ? null : `${Number(value.toPrecision(3))}${view.unit}`);

  function factsOf(row) {
    const method = view.methods[chosen];
    const at = (name) => (method[name] ? method[name][row] : null);
    const facts = [["kind", view.kinds[kindOf(row)].name]];
    if (at("score") !== null) facts.push(["score", `${Number(at("score").toPrecision(3))}, rank ${at("rank")} of ${view.count}`]);
    if (at("residual") !== null) facts.push(["error under the group's pose", unit(at("residual"))]);
    if (view.matches.error) facts.push(["error under the true pose", unit(view.matches.error[row])]);
    if (at("agreeing") !== null) facts.push(["keeps its distance to", `${at("agreeing")} others, ${at("agreeing_in_group")} of the group`]);
    return facts;
  }

  function element(name, text) {
    const made = document.createElement(name);
    made.textContent = text;
    return made;
  }

  function describe(row) {
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
    describe(row);
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
    describe(pinned);
    return draw();
  }

  function find() {
    const wanted = Number(get("number").value);
    const row = view.matches.index.indexOf(wanted);
    if (row >= 0) { pin(row); return; }
    pinned = null;
    const drawn = view.matches.index.length;
    get("about").replaceChildren(element("p", drawn < view.count && wanted >= 0 && wanted < view.count
      ? `Match ${wanted} is not one of the ${drawn} on this page. In Python: grouping.explain(${wanted}).`
      : `Matches are numbered 0 to ${view.count - 1}.`));
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

  get("colors").addEventListener("change", paint);
  get("number").addEventListener("change", find);
  for (const box of document.querySelectorAll(".show input")) {
    const cloud = ["show-source", "show-target"].indexOf(box.id);
    box.addEventListener("change", () => (cloud < 0 ? draw() : plotly.restyle(area, {visible: box.checked}, [cloud])));
  }
  for (const box of document.querySelectorAll("input[name=method]")) box.addEventListener("change", () => choose(Number(box.value)));
  document.querySelector(".methods tbody")?.addEventListener("click", (event) => event.target.closest("tr")?.querySelector("input").click());
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => draw());

  describe(null);
  count();
  await paint();
  await stage.begin();
})();
