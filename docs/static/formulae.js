// Sets the formulae of the page, which stand in it in LaTeX.
for (const place of document.querySelectorAll(".formula")) {
  const displayMode = place.tagName === "DIV";
  katex.render(place.textContent, place, { displayMode, throwOnError: false });
}

// Those that are wider than the page scroll: the style sheet shows it, and the keyboard reaches them.
function markWide() {
  for (const place of document.querySelectorAll("div.formula")) {
    const wide = place.scrollWidth > place.clientWidth;
    place.classList.toggle("wide", wide);
    place.toggleAttribute("tabindex", wide);
    if (wide) {
      place.tabIndex = 0;
      place.title = "wider than the page: scroll sideways";
    } else {
      place.removeAttribute("title");
    }
  }
}

markWide();
addEventListener("resize", markWide);
document.fonts.ready.then(markWide);
