// Streamlit opens a page in two steps of history, of which the first has the old page with the choices of the new one:
// it gets back its own. A choice that was made before, and acts on the new page, too, is no such step: whoever made it
// has touched the page again since, to open the other.
const PAUSE_MS = 1500, push = history.pushState.bind(history);
let last = {}, touched = null;
const slid = (from, to) => {  // the one choice that differs between two views of a page, if a slider was touched last
  if (!touched?.closest?.('[data-testid="stSlider"]') || from.pathname !== to.pathname) return null;
  const [before, after] = [from, to].map(view => view.searchParams);
  const changed = [...new Set([...before.keys(), ...after.keys()])]
    .filter(key => `${before.getAll(key)}` !== `${after.getAll(key)}`);
  return changed.length === 1 ? changed[0] : null;
};
if (!window.crashfuseHistory) {
  window.crashfuseHistory = true;
  for (const kind of ["keydown", "pointerdown"]) {
    document.addEventListener(kind, event => { touched = event.target; last.alone = false; }, true);
  }
  history.pushState = (state, title, url) => {
    const from = location.href, to = new URL(url, from), slider = slid(new URL(from), to);
    const since = last.to === from ? Date.now() - last.at : Infinity;
    const opens = to.pathname !== location.pathname && to.search === location.search;
    if (opens && last.alone && last.to === from) history.replaceState(history.state, "", last.from);
    const goesOn = slider && slider === last.slider && since < PAUSE_MS;
    if (goesOn) history.replaceState(state, title, url);
    else push(state, title, url);
    last = { from: goesOn ? last.from : from, to: location.href, at: Date.now(), slider, alone: true };
  };
}
export default () => {};
