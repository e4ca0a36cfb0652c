// Clouds in a map or a scene: shows some of them, from above or from a side, and near.
(async () => {
  const stage = await staged;
  if (!stage) return;
  const listen = (name, event, act) => {
    for (const each of document.querySelectorAll(`[data-${name}]`)) each.addEventListener(event, () => act(Number(each.dataset[name]), each));
  };
  listen("cloud", "change", (cloud, box) => stage.plotly.restyle(stage.area, {visible: box.checked}, [cloud]));
  listen("near", "click", (cloud) => stage.zoom(cloud));
  listen("look", "click", (degrees) => stage.look(degrees));
  const placed = stage.traces.slice(1); // larger points, which the others don't hide
  await stage.plotly.restyle(stage.area, {"marker.size": 1.8 * stage.area.data[0].marker.size}, placed);
  await stage.begin();
})();
