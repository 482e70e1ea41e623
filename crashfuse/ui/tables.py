"""Tables on a page, with a button that copies them for a spreadsheet."""

import re
import string
from collections import Counter
from collections.abc import Callable, Hashable
from functools import partial

import pandas as pd
import streamlit as st
from pandas.io.formats.style import Styler

from crashfuse.reporting.exports import spreadsheet_text
from crashfuse.reporting.plots.palette import GRADE_COLOURS
from crashfuse.ui.text import as_read, plain

BUTTON_CSS = """
.row { display: flex; gap: 0.4rem }
button { font: inherit; font-size: 0.8rem; color: inherit; opacity: 0.7; background: none; cursor: pointer;
         border: 1px solid var(--st-border-color); border-radius: 4px; padding: 0 0.6rem }
button:hover, button:focus-visible { opacity: 1 }
"""
_JS = """
export default ({ parentElement, data }) => {
  const button = parentElement.querySelector("button");
  button.onclick = async () => {
    try {
      await navigator.clipboard.writeText(data);
    } catch {  // an address that is not secure, or a browser that refuses
      const area = Object.assign(document.createElement("textarea"), { value: data });
      document.body.append(area);
      area.select();
      document.execCommand("copy");
      area.remove();
    }
    button.textContent = "Copied";
    setTimeout(() => { button.textContent = "Copy"; }, 1500);
  };
};
"""
_RIGHT = "text-align: right !important"
_DIGIT_WIDE, _POINT_WIDE, _BRACKET_WIDE = "\u2007", "\u2008", "\u2004"
_BLANKS = {
    **{ord(char): _DIGIT_WIDE for char in string.printable + "≤≥"},
    **{ord(char): _POINT_WIDE for char in ".,"},
    **{ord(char): _BRACKET_WIDE for char in "[]()"},
    ord(" "): "\N{NO-BREAK SPACE}",
}
_COPY = '<button type="button" title="Copy this table for a spreadsheet">Copy</button>'
_copy_button = st.components.v2.component("crashfuse_copy_table", html=_COPY, css=BUTTON_CSS, js=_JS)


_NUMBER = re.compile(r"((?:[≤≥] )?[+−-]?[\d.,]+(?:–[\d.,]+| ± [\d.,]+| %| of \d+)?|–|)( \[.*\]| \(.*\))?")
"""A cell with a number, perhaps with its interval or a remark, or without one."""
_GRADED = re.compile(rf"\d\.\d+ ({'|'.join(GRADE_COLOURS)})")


def show_table(table: Styler | pd.DataFrame, key: str) -> None:
    """Show a table without its index, and below it a button that copies it; the key is unique on the page."""
    styler = aligned(table if isinstance(table, Styler) else literal(table))
    st.table(styler, border="horizontal")
    _copy_button(data=spreadsheet_text(styler.data.rename(columns=as_read)), key=f"copy {key}")


def literal(table: pd.DataFrame) -> Styler:
    """A table without its index, whose headings are shown literally: they may be a laboratory's."""
    return table.rename(columns=plain).style.hide(axis="index")


def aligned(styler: Styler) -> Styler:
    """A :func:`literal` table with numbers at the right, their digits under each other and their intervals lighter."""
    forms: dict[Hashable, Callable[[object], object]] = dict.fromkeys(styler.columns, _literally)
    right = []
    for place, name in enumerate(styler.columns):
        matches = [_NUMBER.fullmatch(str(cell)) for cell in styler.data.iloc[:, place]]
        numbers = [match for match in matches if match is not None]
        if len(numbers) == len(matches) and any(match[1] for match in numbers):
            longest = max((match[2] or "" for match in numbers), key=len)
            forms[name] = partial(_with_light_interval, longest=longest)
            right.append(place)
    styler.format(forms)
    styler.set_properties(subset=styler.columns[right], **{"text-align": "right !important"})
    heads = [{"selector": f"th.col{place}", "props": _RIGHT} for place in right]
    return styler.set_table_styles(heads, overwrite=False)


def _with_light_interval(cell: object, longest: str) -> str:
    """A number as Markdown, its interval lighter, and filled up so that the numbers of a column end at one place.

    ``longest`` is the column's longest interval; where there is none, spaces as wide as its characters stand for it.
    """
    number, interval = (str(part) for part in _NUMBER.findall(str(cell))[0])
    escaped = interval.strip().replace(" ", "\N{NO-BREAK SPACE}").replace("[", "\\[").replace("]", "\\]")
    if not escaped:
        return number + longest.translate(_BLANKS)
    missing = Counter(longest.translate(_BLANKS)) - Counter(interval.translate(_BLANKS))
    return f"{number}\N{NO-BREAK SPACE}:gray[{escaped}]" + "".join(missing.elements())


def _literally(cell: object) -> object:
    """Text as it is, on one line if it is a rating with its grade."""
    if not isinstance(cell, str):
        return cell
    return plain(cell).replace(" ", "\N{NO-BREAK SPACE}") if _GRADED.fullmatch(cell) else plain(cell)
