"""What a laboratory wrote is shown as it is written, on every page: it makes no link and fetches nothing."""

import shutil
from pathlib import Path
from typing import Any

import pytest

from tests.browser.conftest import FIGURE, MAIN, PILL, Server, User

PICTURE, LINK = "![p](http://crash.test/p.png)", "[Log in again](https://crash.test/in) www.crash.test me@crash.test"
OWN = "![p](own.png)"  # all that an id, which names a file, may hold of an address
TAGS = "<a href='http://crash.test'>front</a> <img src='http://crash.test/i.png'>"
MADE = """
const place = e => e.href?.baseVal ?? e.href ?? e.src;  // a link, a link in a figure, a picture
const is_foreign = e => /^\\w+:/.test(place(e)) && !/^(data|blob):/.test(place(e))
  && (new URL(place(e)).host !== location.host || place(e).endsWith("own.png"));
return [...document.querySelectorAll("a, img, image")].filter(is_foreign).map(e => e.outerHTML);
"""


@pytest.fixture
def foreign(campaign_on_disk: Path, tmp_path: Path) -> Path:
    """The small campaign with such words as name, notice, ids, factors and their values, notes and criteria."""
    folder = shutil.copytree(campaign_on_disk, tmp_path / "www.crash.test")
    head, first, *rows = (folder / "tests.csv").read_text(encoding="utf-8").splitlines()
    table = [f'{head},"{PICTURE}",{LINK}', f'{first},"{TAGS}",www.crash.test', *(f"{row},rear,{LINK}" for row in rows)]
    (folder / "tests.csv").write_text("\n".join(table).replace("\nT", f"\n{OWN} www.T"), encoding="utf-8")
    for pulse in (folder / "tests").iterdir():
        pulse.rename(folder / "tests" / f"{OWN} www.{pulse.name}")
    (folder / "campaign.toml").write_text(
        f'name = "{PICTURE} {LINK}"\nnotice = "{LINK}: {PICTURE}"\n', encoding="utf-8"
    )
    note = f'test,start_ms,end_ms,text\n{OWN} www.T1,30,,"{LINK} {TAGS}"\n'
    (folder / "notes.csv").write_text(note, encoding="utf-8")
    criterion = f'[[criterion]]\nname = "{LINK} {PICTURE}"\nmetric = "max_crush"\nat_most = 700\n'
    (folder / "criteria.toml").write_text(criterion, encoding="utf-8")
    return folder


def made(user: User) -> list[str]:
    """The links to elsewhere, and the pictures from there or by an id, that are on the page."""
    return [str(html) for html in user.browser.execute_script(MADE)]


def test_no_page_makes_anything_of_it(server: Server, user: User, foreign: Path) -> None:
    """No link, no picture, in text, fields, tables and figures; a heading is read as it is written."""
    steps: list[tuple[Any, ...]] = [
        (user.open_folder, server, foreign),
        *((user.open_tab, "Conditions"), (user.find, FIGURE), (user.open_tab, "CAE model"), (user.find, FIGURE)),
        *((user.open_tab, "Tests"), (user.press, "www.T4", f"{MAIN} {PILL}"), (user.sees, "Take ![p]")),
        *((user.press, "Undo"), (user.go, "Train"), (user.choose_approaches, "CAE", "Displacement domain")),
        *((user.open_tab, "Diagnostics"), (user.sees, "Train without", "button")),
        *((user.go, "Compare"), (user.sees, "Predict test", "button"), (user.starts, "Predict test", FIGURE)),
        *((user.press, "Notes and marks", "summary"), (user.sees, "Log in again")),
        *((user.open_tab, "Why"), (user.sees, "Humps, and")),
        *((user.open_tab, "Ratings and metrics"), (user.sees, "Ratings; scores")),
        *((user.open_tab, "Pulses"), (user.sees, "Nearest")),
        *((user.press, "Over displacement", PILL), (user.sees, "Marks: maximum crush")),
        *((user.go, "Study"), (user.starts, "Leave out each", FIGURE)),
        *((user.open_tab, tab) for tab in ("Bands", "Past results", "Ratings")),
        *((user.go, "Predict"), (user.starts, "Predict", FIGURE)),
        *((user.press, "Pin this prediction"), (user.press, "1 pinned")),
        (lambda: user.open(server, "certify", campaign=foreign.name, approach="cae"),),
        *((user.sees, "Planned tests from"), (user.starts, "Certify", '[class*="_tab"] button')),
        *((user.open_tab, tab) for tab in ("Track record", "Validated domain", "Answer")),
        *((user.press, "", '[class*="planned_tests"] button'), (user.sees, "See the predicted pulse there")),
    ]
    for step, *given in steps:
        step(*given)
        assert made(user) == []
