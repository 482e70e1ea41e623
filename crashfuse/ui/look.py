"""The look of pages beyond the theme: density, tabs, focus, and fills that follow the theme."""

import streamlit as st

from crashfuse.reporting.plots.palette import IN_THE_DARK, MEASURED_COLOUR

STYLE = """<style>
/* Streamlit writes white on the accent colour, which is too light for it in the dark theme */
button[data-testid^="stBaseButton-primary"], [data-testid="stMultiSelectTagsContainer"] :is([data-tag], [data-tag] *) {
  color: light-dark(#FFFFFF, #14181F) }
/* the first screen belongs to the figure; the logo stands in the sidebar, or in a narrow window's header */
@media (min-width: 1100px) {
  [data-testid="stHeader"] { height: 2.5rem; min-height: 2.5rem }
  [data-testid="stMainBlockContainer"] { padding-top: 2.5rem }
}
[data-testid="stMainBlockContainer"] { padding-inline: clamp(1rem, 3vw, 5rem) }
[data-testid="stMainBlockContainer"] > [data-testid="stVerticalBlock"], .st-key-alone { gap: 0.7rem }
[data-testid="stMain"] h1 { padding: 0 }
/* whole pixels: a figure that is told the width that it has already is not drawn again */
[data-testid="stMain"] [data-testid="stFullScreenFrame"] { width: round(down, 100%, 1px) }
[data-testid="stMain"] h3 { padding: 0.25rem 0 }
/* Streamlit draws what follows a heading over its lower edge */
[data-testid="stMain"] [data-testid="stElementContainer"]:not(.st-key-head *)
  [data-testid="stHeading"] > [data-testid="stMarkdownContainer"] { margin-bottom: -0.35rem }
.st-key-head, .st-key-recommendation { row-gap: 0; column-gap: 1rem }
.st-key-recommendation { overflow: visible }
.st-key-recommendation > :first-child { flex-shrink: 1; min-width: 0 }
.st-key-recommendation > :last-child { flex-shrink: 0 }
.st-key-recommendation button { min-height: 0; padding-block: 0 }
.st-key-asked :is([data-testid="stButton"], [data-testid="stPopover"]) button { min-height: 1.9rem }
.st-key-head [data-testid="stHeading"] { margin: 0 }
/* an answer is there before what it replaces would begin to fade; to wait for that takes a third of a browser's work */
.st-key-alone [data-stale="true"] { opacity: 1 !important; transition: none !important }
/* a slider right below its number, which it need not repeat */
.st-key-condition [data-testid="stColumn"] > [data-testid="stVerticalBlock"] { gap: 0 }
.st-key-condition :is([data-testid="stSliderThumbValue"], [data-testid="stSliderTickBar"]) { display: none }
.st-key-condition [data-testid="stSlider"] > div > div { padding-block: 0.3rem 0 }
/* a row of tabs is no row of buttons */
[class*="_tab"] [data-testid="stButtonGroup"] button { border-width: 0 0 2px; border-radius: 0; background: none }
[class*="_tab"] [data-testid="stButtonGroup"] button:not([aria-checked="true"]) { border-color: transparent }
[class*="_tab"] [data-testid="stButtonGroup"] button p { font-size: 1rem }
[class*="_tab"] [role="radiogroup"] { border-bottom: 1px solid var(--st-border-color, #8885) }
/* jobs, whose names take several lines */
[data-testid="stSidebar"] button[kind="tertiary"] { text-align: left; justify-content: flex-start }
/* links to the pages, no closer than a finger can tell them apart */
[data-testid="stSidebar"] [data-testid="stPageLink-NavLink"] { padding-block: 0.1rem }
[data-testid="stSidebar"] [data-testid="stPageLink"] { margin-block: 0.27rem }
/* in a narrow window the sidebar lies over the page while it is open, its header included, and shows how to close it */
@media (max-width: 1099px) {
  [data-testid="stSidebar"] { position: fixed !important; height: 100vh; z-index: 999991; box-shadow: 0 0 1rem #0006 }
  [data-testid="stSidebarCollapseButton"] { visibility: visible !important }
}
/* where the keyboard is; a line outside a figure would be cut off, and one inside lies under what is drawn */
:is(a, button, summary, h1, [role="tab"]):focus-visible {
  outline: 2px solid light-dark(#0B5CAD, #79B8F5) !important; outline-offset: 1px }
.js-plotly-plot:focus-visible { position: relative; outline: none }
.js-plotly-plot:focus-visible::after { content: ""; position: absolute; inset: 0; z-index: 1000; pointer-events: none;
  border: 2px solid light-dark(#0B5CAD, #79B8F5) }
[data-testid="stMain"] code { font-size: 0.8rem }
[data-testid="stCaptionContainer"] code { color: inherit; background: none; padding: 0 }
/* digits of one width, so that decimal points stand under each other */
[data-testid="stTable"] td, .cf-ratings { font-variant-numeric: tabular-nums }
/* a shadow where a table goes on beside what is seen of it; what lies before the shadow moves with the table */
[data-testid="stTable"] :has(> table) {
  --page: light-dark(#FFFFFF, #14181F); --shadow: light-dark(#0003, #FFF4);
  background: linear-gradient(to right, var(--page) 60%, transparent) left / 2rem 100% no-repeat local,
    linear-gradient(to left, var(--page) 60%, transparent) right / 2rem 100% no-repeat local,
    linear-gradient(to right, var(--shadow), transparent) left / 0.7rem 100% no-repeat,
    linear-gradient(to left, var(--shadow), transparent) right / 0.7rem 100% no-repeat }
/* sentences in a table use a wide window's room; Streamlit breaks them at 400 px */
@media (min-width: 1800px) { [data-testid="stTable"] [data-testid="stMarkdownContainer"] { max-width: 45rem } }
/* on a browser's first visit the sidebar is narrower than requested; three windows would not fit side by side */
[data-testid="stSidebar"] [data-testid="stButtonGroup"] button { padding-inline: 0.6rem }
/* its camera is pressed by the buttons below, whose images keep the font */
.modebar-btn[data-title^="Download plot"] { display: none !important }
/* what Plotly says of saved files, and its tips, would outlive the page of their figure */
.plotly-notifier { display: none }
/* the ratings in a row */
.cf-ratings { display: flex; flex-wrap: wrap; gap: 0.5rem }
.cf-ratings > div { padding: 0.3rem 0.6rem; border-radius: 6px;
  outline: 1px solid light-dark(#D5DAE1, #3A434F); outline-offset: -1px }
.cf-ratings > .cf-best { outline: 2px solid light-dark(#0B5CAD, #79B8F5); outline-offset: -2px }
.cf-ratings .cf-name { font-size: 0.8rem; display: flex; gap: 0.5rem; justify-content: space-between }
.st-key-clicks { display: none }
.cf-ratings [role="button"] { cursor: pointer; text-decoration: underline dotted; text-underline-offset: 0.2em }
.cf-ratings [role="button"]:is(:hover, :focus-visible) { text-decoration-style: solid }
.cf-ratings .cf-values { display: flex; gap: 0.5rem; align-items: baseline; line-height: 1.4 }
.cf-ratings b { font-size: 1.2rem; font-weight: 600 }
.cf-ratings small, .cf-grade { font-size: 0.8rem }
.cf-grade { padding: 0 0.4rem; border-radius: 4px }
@media (max-width: 1099px) { /* one row of six */
  [data-testid="stMainBlockContainer"] > [data-testid="stVerticalBlock"], .st-key-alone { gap: 0.5rem }
  .cf-ratings, .cf-ratings .cf-values { gap: 0.25rem }
  .cf-ratings > div { padding-inline: 0.4rem }
}
.cf-better { color: light-dark(#1A7F37, #4CC38A) }
.cf-worse { color: light-dark(#B4331A, #FF9B7A) }
</style>"""


def fill(colour: str) -> str:
    """CSS of a cell or chip in a colour of the palette, with text that reads on it, in the page's theme."""
    ground, ink = colour, MEASURED_COLOUR
    if st.context.theme.type == "dark":
        ground, ink = IN_THE_DARK[colour], IN_THE_DARK[MEASURED_COLOUR]
    return f"background-color: {ground}; color: {ink}"
