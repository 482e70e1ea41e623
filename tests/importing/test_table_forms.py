"""Tables sorted by their headers, so that what their columns are is said once."""

from pathlib import Path

from crashfuse.importing import ColumnChoice
from crashfuse.importing.sources import tables_of
from crashfuse.importing.table_forms import table_forms
from tests.importing.crash_files import german, library, write
from tests.importing.crashes import clock, half_sine_g


def test_tables_are_sorted_by_their_headers(tmp_path: Path) -> None:
    """Two of one form and one of conditions; what cannot be read is passed over."""
    write(library(tmp_path), {"a.csv": b"ID;v [km/h]\n1;2\n", "b.csv": b"ID;v [km/h]\n2;3\n3;4\n", "c.csv": b"\x00"})
    forms = {form.names: form for form in table_forms(tables_of(tmp_path))}
    assert set(forms) == {("a.csv", "b.csv"), ("conditions.csv",), ("runs.csv",)}
    assert forms["a.csv", "b.csv"].columns == ("ID", "v [km/h]")
    assert forms["runs.csv",].proposed.kind == "pulses"
    assert forms["runs.csv",].unit_of(["Run 0 [m/s^2]", "Run 1 [m/s^2]"]) == "m/s²"
    assert forms["runs.csv",].unit_of(["Time [s]", "Run 1 [m/s^2]"]) is None


def test_only_what_differs_from_the_proposal_is_a_choice(tmp_path: Path) -> None:
    """A column that is not picked any more is ignored; one whose unit is named otherwise keeps its role."""
    table = write(
        tmp_path, {"x.csv": german(clock(), half_sine_g(clock()), 0 * clock(), header="Zeit [ms];a [g];b [g]")}
    )
    (form,) = table_forms([table / "x.csv"])
    same = {"time": ["Zeit [ms]"], "acceleration": ["a [g]", "b [g]"], "id": ()}
    assert form.choices(same, {"time": None}) == ()  # type: ignore[arg-type]
    picked = {**same, "acceleration": ["a [g]"]}
    assert form.choices(picked, {"time": "s", "acceleration": "m/s²"}) == (  # type: ignore[arg-type]
        ColumnChoice("Zeit [ms]", "time", "s"),
        ColumnChoice("a [g]", "acceleration", "m/s²"),
        ColumnChoice("b [g]", "ignored"),
    )
    assert {choice.role for choice in form.nothing()} == {"ignored"}
