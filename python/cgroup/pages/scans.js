// Many scans: shows some of them, or the two of an edge.
(async () => {
  const stage = await staged;
  if (!stage) return;
  const boxes = [...document.querySelectorAll(".scans input")];

  function showScans() {
    const shown = new Set(boxes.filter((box) => box.checked).map((box) => Number(box.dataset.row)));
    return stage.plotly.restyle(stage.area, {visible: stage.view.rows.map((row) => shown.has(row))}, stage.traces);
  }

  // An edge of the graph, the same line of the table, and its two scans alone; null for all.
  function choose(edge) {
    const chosen = edge === null ? null : stage.view.edges[edge];
    for (const each of document.querySelectorAll("[data-edge]")) each.classList.toggle("chosen", Number(each.dataset.edge) === edge);
    for (const box of boxes) box.checked = !chosen || chosen.includes(Number(box.dataset.row));
    return showScans();
  }

  document.getElementById("all").addEventListener("click", () => choose(null));
  for (const box of boxes) box.addEventListener("change", showScans);
  for (const each of document.querySelectorAll("[data-edge]")) {
    const toggle = () => choose(each.classList.contains("chosen") ? null : Number(each.dataset.edge));
    each.addEventListener("click", toggle);
    each.addEventListener("keydown", (event) => { if (event.key === "Enter") toggle(); });
  }
  await stage.begin();
})();
