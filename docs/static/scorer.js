// The order of search results: pages that tell how to do something come first, the changelog,
// which names everything, last. Sphinx finds words; it hardly weighs pages.
const PAGES = [
  [/^(how-to|tutorials|forming)\/|^(restart|meshes|map-and-fit|reading-results|failures|pictures|index)$/, 20],
  [/^(install|gallery|commands|case-file|results|law|theory|bodies|solver|explicit|limits|examples)$/, 10],
  [/^(more\/|py-modindex)/, -30],
];

function wordsIn(title) {
  const query = new URLSearchParams(window.location.search).get("q") || "";
  const words = query.toLowerCase().split(/[^\p{L}\p{N}]+/u).filter(Boolean);
  const found = words.filter((word) => title.toLowerCase().includes(word));
  return words.length ? found.length / words.length : 0;
}

var Scorer = {
  score: ([page, title, anchor, text, score, file, kind]) => {
    const weight = PAGES.find(([pattern]) => pattern.test(page));
    // A name of the Python interface is what is looked for only where it is written out.
    const object = kind === "object" ? -15 : 0;
    return score + (weight ? weight[1] : 0) + 15 * wordsIn(title) + object;
  },
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
