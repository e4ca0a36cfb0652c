// Tables are sorted by a click on a header: numbers by their key, texts as people read them.
for (const table of document.querySelectorAll("table.sortable")) {
  const headers = [...table.tHead.rows[0].cells];
  headers.forEach((header, column) => header.querySelector("button").addEventListener("click", () => {
    const numeric = "numeric" in header.dataset;
    const before = header.getAttribute("aria-sort");
    const ascending = before ? before !== "ascending" : !("descending" in header.dataset);
    headers.forEach((other) => other.removeAttribute("aria-sort"));
    header.setAttribute("aria-sort", ascending ? "ascending" : "descending");
    const body = table.tBodies[0];
    const key = (row) => numeric ? Number(row.cells[column].dataset.key.replace("inf", "Infinity")) : row.cells[column].innerText;
    const compare = (one, other) => numeric ? key(one) - key(other) : key(one).localeCompare(key(other), "en", {numeric: true});
    const rows = [...body.rows].sort((one, other) => ascending ? compare(one, other) : compare(other, one));
    body.append(...rows);
  }));
}

// On a narrow screen a button opens the list of sections, and a choice closes it.
const menu = document.querySelector("nav button");
const setMenu = (open) => { menu.setAttribute("aria-expanded", String(open)); document.body.classList.toggle("menu-open", open); };
menu.addEventListener("click", () => setMenu(menu.getAttribute("aria-expanded") !== "true"));
document.querySelector("nav ul").addEventListener("click", (event) => { if (event.target.closest("a")) setMenu(false); });
document.documentElement.classList.add("scripted");

// On paper everything is open.
const folded = [...document.querySelectorAll("details")];
let wasOpen = [];
addEventListener("beforeprint", () => { wasOpen = folded.map((each) => each.open); folded.forEach((each) => { each.open = true; }); });
addEventListener("afterprint", () => folded.forEach((each, i) => { each.open = wasOpen[i]; }));

// The section in sight is marked in the list.
const links = new Map([...document.querySelectorAll("nav a")].map((link) => [link.hash.slice(1), link]));
const headings = [...document.querySelectorAll("h2[id]")].filter((heading) => links.has(heading.id));
function markSection() {
  const passed = headings.filter((heading) => heading.getBoundingClientRect().top < 120);
  const current = passed.length ? passed[passed.length - 1].id : headings[0]?.id;
  links.forEach((link, id) => link.toggleAttribute("aria-current", id === current));
}
addEventListener("scroll", markSection, {passive: true});
markSection();
