"""The dashboard without a browser: a new server for each test, and sessions on it."""

import json
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, cast
from weakref import WeakKeyDictionary

import pandas as pd
import pytest
import streamlit as st
from streamlit.components.v2 import manifest_scanner
from streamlit.proto.WidgetStates_pb2 import WidgetState, WidgetStates
from streamlit.testing.v1 import AppTest
from streamlit.testing.v1.element_tree import Dataframe, ElementTree, InitialValue, Selectbox

from crashfuse.ui.kit.computation import jobs
from crashfuse.ui.server import start_importing

APP = Path(__file__).parents[2] / "app.py"
SOON = 60.0


def as_read(markdown: str) -> str:
    """The text of which the page's Markdown was made."""
    return re.sub(r"\\(\W|_)|\u2060", r"\1", markdown).replace("\N{NO-BREAK SPACE}", " ")


@dataclass(frozen=True)
class Session:
    """One user in front of a page; no step may raise."""

    app: AppTest

    def run(self) -> "Session":
        """Draw the page anew."""
        self.app.run()
        assert not self.app.exception
        return self

    def finish(self, timeout_s: float = SOON) -> "Session":
        """Wait for all jobs, so long for each, and draw the page anew."""
        for job in jobs().active:
            assert job.wait(timeout_s)
        return self.run()

    def go(self, page: str) -> "Session":
        """Turn to another page."""
        self.app.switch_page(f"pages/{page}.py")
        return self.run()

    def press(self, label: str) -> "Session":
        """Press the one button of this label."""
        (button,) = [button for button in self.app.button if as_read(button.label) == label]
        button.click()
        return self.run()

    @property
    def words(self) -> str:
        """All text of the page, as it is read: without the marks that keep it from being Markdown, or on one line."""
        kinds = "title", "subheader", "markdown", "caption", "text", "error", "info", "warning", "success"
        texts = [element.value for kind in kinds for element in getattr(self.app, kind)]
        return as_read("\n".join([*texts, *(bar.text for bar in self.app.progress)]))

    @property
    def tables(self) -> list[pd.DataFrame]:
        """All tables of the page, their text as it is read."""
        return [
            table.value.rename(columns=as_read).map(lambda cell: as_read(cell) if isinstance(cell, str) else cell)
            for table in self.app.table
        ]

    @property
    def numbers(self) -> dict[str, str]:
        """What the page Data says first of a campaign."""
        first = dict(zip(("Tests", "CAE runs"), (label.split()[0] for label in self.answer), strict=False))
        speeds = re.search("Tests at (.*) · ", self.words)
        return first | ({"Test speeds": speeds[1]} if speeds else {})

    def open_tab(self, page: str, label: str) -> "Session":
        """Open a tab of a page, if it has tabs now."""
        for tabs in [group for group in self.app.button_group if group.key == f"{page}_tab"]:
            tabs.set_value(label)
        return self.run()

    def open_folder(self, folder: str) -> "Session":
        """Type a folder in on Data, and open it."""
        if "Open another campaign" in self.buttons:
            self.press("Open another campaign")
        self.app.text_input(key="folder").set_value(folder)
        return self.press("Open folder")

    def upload(self, files: Mapping[str, bytes]) -> "Session":
        """Drop files on Data, and open them."""
        if "Open another campaign" in self.buttons:
            self.press("Open another campaign")
        dropped = [(name, content, "application/octet-stream") for name, content in files.items()]
        self.app.file_uploader[0].set_value(dropped)
        return self.press("Open upload")

    def give(self, name: str, content: bytes) -> "Session":
        """Put a file into the last field for files."""
        self.app.file_uploader[-1].set_value([(name, content, "application/octet-stream")])
        return self.run()

    def field(self, label: str) -> Any:
        """The first field whose label begins like this."""
        kinds = "number_input", "selectbox", "multiselect", "text_input", "radio", "button_group"
        fields = [field for kind in kinds for field in getattr(self.app, kind)]
        found = [field for field in fields if getattr(field, "label", "").lower().startswith(label.lower())]
        assert found, f"There is no field {label!r}."
        return found[0]

    def fill(self, values: Mapping[str, object]) -> "Session":
        """Fill fields in by their labels, and draw the page anew."""
        for label, value in values.items():
            self.field(label).set_value(value)
        return self.run()

    def rows(self, table: str) -> list[list[str]]:
        """What a table shows that can be typed into."""
        return self._editor(table).value.fillna("").to_numpy().tolist()  # type: ignore[no-any-return]

    def edit(self, table: str, cells: Mapping[int, Mapping[int, str | None]], *deleted: int) -> "Session":
        """Type into cells of a table, by row and column, new rows below the last, and delete rows."""
        editor, n = self._editor(table), len(self.rows(table))
        edits = {
            "edited_rows": {row: texts for row, texts in cells.items() if row < n},
            "added_rows": [texts for row, texts in cells.items() if row >= n],
            "deleted_rows": deleted,
        }
        sent, usual = WidgetState(id=editor.proto.id, string_value=json.dumps(edits)), ElementTree.get_widget_states
        with pytest.MonkeyPatch.context() as patch:
            both = lambda tree: WidgetStates(widgets=[*usual(tree).widgets, sent])  # noqa: E731
            patch.setattr(ElementTree, "get_widget_states", both)
            return self.run()

    def _editor(self, table: str) -> Dataframe:
        return next(own for own in self.app.data_editor if str(own.key).startswith(f"{table} "))

    @property
    def answer(self) -> dict[str, str]:
        """The line above every page: its links, and what they mean."""
        line = [button for button in self.app.button if str(button.key).startswith("answer")]
        return {as_read(button.label): as_read(button.proto.help) for button in line}

    @property
    def buttons(self) -> list[str]:
        """Labels of all buttons below the line that stands above every page."""
        return [as_read(button.label) for button in self.app.button if not str(button.key).startswith("answer")]

    @property
    def downloads(self) -> list[str]:
        """Files that the page offers."""
        return [button.label for button in self.app.download_button]

    @property
    def charts(self) -> int:
        """How many figures the page shows."""
        return len(self.app.get("plotly_chart"))


Visit = Callable[..., Session]


def begin(page: str = "data", **parameters: str | list[str]) -> Session:
    """Begin a session on a page, by a link with these parameters."""
    app = AppTest.from_file(APP, default_timeout=SOON)
    app.query_params.update(parameters)
    return Session(app).go(page)


@pytest.fixture(scope="session", autouse=True)
def components_are_searched_once() -> Iterator[None]:
    """Streamlit's tests look through all installed packages for components, for each session anew: most of its time."""
    found = cache(manifest_scanner.scan_component_manifests)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(manifest_scanner, "scan_component_manifests", found)
        yield


@pytest.fixture(scope="session", autouse=True)
def everything_is_imported() -> None:
    """What a server imports in its first seconds is there: no thread imports beside a test or its fixtures."""
    for imported in start_importing():
        imported.result()


@pytest.fixture(autouse=True)
def fresh_server(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Nothing is left of another test: no campaign, no job, not even one that still runs."""
    monkeypatch.delenv("CRASHFUSE_CAMPAIGN", raising=False)
    st.cache_resource.clear()
    yield
    for job in jobs().active:
        assert job.wait(SOON), f"{job.title} goes on after its test."
    st.cache_resource.clear()


@pytest.fixture(autouse=True)
def a_list_sends_the_label_it_held(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a browser, which knows a list by its key and what is chosen by its label, whatever options say since."""
    usual, held = cast(property, Selectbox._widget_state).fget, WeakKeyDictionary[AppTest, dict[str, str]]()
    assert usual is not None

    def sent(own: Selectbox[object]) -> WidgetState:
        assert own.root._runner is not None
        state, labels = cast(WidgetState, usual(own)), held.setdefault(own.root._runner, {})
        if state.HasField("string_value"):
            if isinstance(own._value, InitialValue) and not own.proto.set_value:
                state.string_value = labels.get(own.id, state.string_value)
            labels[own.id] = state.string_value
        return state

    monkeypatch.setattr(Selectbox, "_widget_state", property(sent))


@pytest.fixture
def open_campaign(campaign_folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The server is started with the small campaign."""
    monkeypatch.setenv("CRASHFUSE_CAMPAIGN", str(campaign_folder))
    return campaign_folder


@pytest.fixture
def visit() -> Visit:
    """Begins a session on the server of this test."""
    return begin


@pytest.fixture(autouse=True)
def slides_can_be_made(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages offer slides, whether or not this machine has a browser that draws them."""
    monkeypatch.setattr("crashfuse.ui.kit.files.missing_for", lambda _: "")
