// Filters claims by verdict and by words.
const controls = document.getElementById("claims-controls");
const claimRows = [...document.querySelectorAll("#claims-table tbody tr")];
function filterClaims() {
  const chosen = new Set([...controls.querySelectorAll("input[name=verdict]:checked")].map((box) => box.value));
  const text = controls.querySelector("input[type=search]").value.toLowerCase();
  for (const row of claimRows) row.hidden = !chosen.has(row.dataset.verdict) || !row.textContent.toLowerCase().includes(text);
  const shown = claimRows.filter((row) => !row.hidden).length;
  controls.querySelector("output").textContent = `${shown} of ${claimRows.length} shown`;
}
controls.addEventListener("input", filterClaims);
controls.addEventListener("submit", (event) => event.preventDefault());
// A link to a claim shows it, whatever the filter is.
function reveal() {
  const row = claimRows.find((each) => "#" + each.id === location.hash);
  if (row && row.hidden) { controls.reset(); filterClaims(); row.scrollIntoView(); }
}
addEventListener("hashchange", reveal);
filterClaims();
reveal();
