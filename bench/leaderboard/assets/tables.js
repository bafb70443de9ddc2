// Sort a table by the heading that is clicked. Cells that have no number come last either way.
for (const table of document.querySelectorAll("table.sortable")) {
  const heads = [...table.tHead.rows[0].cells];
  const body = table.tBodies[0];
  const value = (row, column) => {
    const cell = row.cells[column];
    if (!cell || !cell.hasAttribute("data-value")) return null;
    const text = cell.getAttribute("data-value");
    return cell.classList.contains("number") || cell.classList.contains("rank") ? Number(text) : text;
  };
  heads.forEach((head, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.className = "sort";
    button.append(...head.childNodes);
    head.append(button);
    head.setAttribute("aria-sort", "none");
    button.addEventListener("click", () => {
      const falling = head.getAttribute("aria-sort") === "ascending";
      heads.forEach((other) => other.setAttribute("aria-sort", "none"));
      head.setAttribute("aria-sort", falling ? "descending" : "ascending");
      const rows = [...body.rows].map((row) => [value(row, column), row]);
      rows.sort(([p], [q]) => {
        if (p === q) return 0;
        if (p === null) return 1;
        if (q === null) return -1;
        return (p < q ? -1 : 1) * (falling ? -1 : 1);
      });
      body.append(...rows.map(([, row]) => row));
    });
  });
}
// Say so where a table is wider than its place.
const widths = new ResizeObserver((entries) => {
  for (const { target } of entries) target.classList.toggle("wider", target.scrollWidth > target.clientWidth + 1);
});
for (const box of document.querySelectorAll(".scroll")) widths.observe(box);
