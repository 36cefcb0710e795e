// Sets the formulae of the page, which stand in it in LaTeX.
for (const place of document.querySelectorAll(".formula")) {
  const displayMode = place.tagName === "DIV";
  katex.render(place.textContent, place, { displayMode, throwOnError: false });
}
