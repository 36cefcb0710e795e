// The style sheet of Debian's furo has no rule for colours that follow the browser ("auto"), only
// for light and dark ones. So one of these is named in its place.
const prefersDark = matchMedia("(prefers-color-scheme: dark)");

function nameColours() {
  if (document.body.dataset.theme === "auto") {
    document.body.dataset.theme = prefersDark.matches ? "dark" : "light";
  }
}

nameColours();
new MutationObserver(nameColours).observe(document.body, { attributeFilter: ["data-theme"] });
prefersDark.addEventListener("change", nameColours);
