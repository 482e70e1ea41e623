"""The matrix of conditions: from a table or as a grid, each condition once."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from crashfuse.certification.matrix import Matrix
from crashfuse.condition import Condition
from crashfuse.errors import DataError, UsageError
from crashfuse.results.certification_tables import csv_as_given, matrix_table
from crashfuse.units import KPH, LB, MPH
from tests.conftest import problems_of

FACTORS = {"drive": ("AWD", "FWD")}
HEADER = "id,speed_mph,front_weight_lb,rear_weight_lb"


def matrix_file(folder: Path, *lines: str) -> Path:
    """A table of conditions."""
    path = folder / "matrix.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_a_table_is_read_with_its_units_and_factors(tmp_path: Path) -> None:
    """Columns end in their unit, as in tests.csv; a factor that no test has that value of is read as it stands."""
    lines = "id,speed_kph,front_weight_lb,rear_weight_kg,drive", "A,50,2000,700,FWD", "B,56,2000,700,RWD"
    found = Matrix.read(matrix_file(tmp_path, *lines), FACTORS)
    assert found.ids == ("A", "B")
    assert found.conditions[0] == Condition.of_vector([50 * KPH, 2000 * LB, 700.0], (("drive", "FWD"),))
    assert found.conditions[1].factors == (("drive", "RWD"),)


def test_a_data_frame_is_the_same_matrix_as_its_file(tmp_path: Path) -> None:
    path = matrix_file(tmp_path, f"{HEADER},drive", "A,30.1,2000,1500,FWD", "B,35.7,2050.55,1500,AWD")
    assert Matrix.of(pd.read_csv(path), FACTORS) == Matrix.read(path, FACTORS)


@pytest.mark.parametrize(
    ("lines", "sentence"),
    [
        ([""], "matrix.csv: expected a table with a header, found an empty one"),
        ([HEADER], "matrix.csv: expected a header and at least one row, found an empty table"),
        ([HEADER, "A,30,2000,1500", "B,30,2000,1500"], "row 3: expected each condition once, found that of A again"),
        ([HEADER, "A,30,2000,1500", "A,31,2000,1500"], "row 3: expected each id once, found 'A' a second time"),
        ([HEADER, "A,30,2000,x"], "column rear_weight_lb, row 2: expected a number, found 'x'"),
        ([HEADER, "A,0,2000,1500"], "column speed_mph, row 2: expected a number of at least"),
        ([HEADER, "A,300,2000,1500"], "row 2: expected at most 224 mph and 132277 lb in all, found 300.0 mph"),
        ([f"{HEADER},fuel", "A,30,2000,1500,gas"], "expected no further columns than those of tests.csv (drive)"),
        (["id,speed_mph,front_weight_lb", "A,30,2000"], "rear_weight"),
    ],
)
def test_a_table_that_is_no_matrix_is_refused_in_a_sentence(tmp_path: Path, lines: list[str], sentence: str) -> None:
    [problem] = map(str, problems_of(lambda: Matrix.read(matrix_file(tmp_path, *lines), FACTORS)))
    assert sentence in problem


def test_a_table_of_more_conditions_than_can_be_predicted_is_refused(tmp_path: Path) -> None:
    rows = (f"C{i},{5 + i / 1000},2000,1500" for i in range(10_001))
    with pytest.raises(DataError, match="expected at most 10,000 conditions, found 10,001"):
        Matrix.read(matrix_file(tmp_path, HEADER, *rows), FACTORS)


def test_what_is_wrong_in_a_table_in_memory_is_told_of_that_table() -> None:
    """There is no file; rows count from 0 as in the table. A factor that no test has is one sentence."""
    table = pd.DataFrame([{"id": "A", "speed_mph": 30, "front_weight_lb": 2000, "rear_weight_lb": 1500, "wheels": "4"}])
    with pytest.raises(DataError) as caught:
        Matrix.of(table, {"drive": ("FWD",)})
    assert str(caught.value) == (
        "matrix: expected no further columns than those of tests (drive), found wheels; rename or remove the column."
    )
    with pytest.raises(DataError, match="matrix, column id, row 1: expected each condition once, found that of A"):
        Matrix.of(pd.concat([table, table.assign(id="B")]).drop(columns="wheels"), {})


@settings(max_examples=20, deadline=None)  # files are written and read
@given(
    st.sampled_from(["mph", "kph", "mps"]),
    st.sampled_from(["lb", "kg"]),
    st.sampled_from(["lb", "kg"]),
    st.integers(51, 400).map(lambda tenths: tenths / 10),
)
def test_what_was_typed_is_written_as_typed(speed: str, front: str, rear: str, number: float) -> None:
    """Units and numbers, whatever they are; and read again they are the same conditions."""
    names = f"speed_{speed}", f"front_weight_{front}", f"rear_weight_{rear}"
    table = pd.DataFrame([["A", number, 1000.5, 750.1], ["B", number + 1, 1000.5, 750.1]], columns=["id", *names])
    matrix = Matrix.of(table, {})
    written = matrix_table(matrix)
    pd.testing.assert_frame_equal(written, table, check_exact=True)
    assert Matrix.of(written, {}) == matrix
    assert csv_as_given(written).decode().splitlines()[1] == f"A,{number:g},1000.5,750.1"
    assert Condition.of(**{str(k): v for k, v in written.drop(columns="id").iloc[0].items()}) == matrix.conditions[0]


def test_a_grid_has_every_combination_once() -> None:
    found = Matrix.grid([20 * MPH, 30 * MPH], [900.0], [650.0, 700.0], {"drive": ("FWD", "AWD")})
    assert found.ids == tuple(f"M{number:03d}" for number in range(1, 9))
    assert len(set(found.conditions)) == 8
    assert found.conditions[1] == Condition.of_vector([20 * MPH, 900.0, 650.0], (("drive", "AWD"),))
    assert found.conditions[-1] == Condition.of_vector([30 * MPH, 900.0, 700.0], (("drive", "AWD"),))


@pytest.mark.parametrize(
    ("speeds", "sentence"),
    [
        ([10.0, 10.0], "A grid takes each speed once"),
        ([0.0], "as a number above 0"),
        ([float("nan")], "as a number above 0"),
        ([float("inf")], "as a number above 0"),
        ([1000.0], "No barrier test is made at 2236.9 mph"),
        ([1 + i / 1000 for i in range(10_001)], "at most 10,000 conditions; this grid has 10,001"),
        ([], "1 to 10,000 conditions, not 0"),
    ],
)
def test_a_grid_that_cannot_be_predicted_is_refused(speeds: list[float], sentence: str) -> None:
    with pytest.raises(UsageError, match=sentence):
        Matrix.grid(speeds, [900.0], [650.0], {})


def test_conditions_within_the_tolerance_of_a_test_are_one() -> None:
    """B is A and D is C, not E, though it is near D; whatever comes first stands for the others. Factors tell apart."""
    here = Condition.of_vector([15.0, 900.0, 700.0])
    speeds = {"A": 15.0, "B": 15.0 + 0.9 * KPH, "C": 17.0, "D": 17.0 + 0.9 * KPH, "E": 17.0 + 1.8 * KPH}
    matrix = Matrix(tuple(speeds), tuple(replace(here, speed_mps=v) for v in speeds.values()))
    assert matrix.alike() == {"B": "A", "D": "C"}
    assert matrix.alike(["D", "B"]) == {"A": "B", "C": "D", "E": "D"}
    assert matrix.alike(["D"], ["C", "B"]) == {"A": "B", "E": "D"}
    heavier = replace(here, front_weight_kg=900.0 * 1.021)
    drives = [replace(here, factors=(("drive", drive),)) for drive in ("FWD", "AWD")]
    assert Matrix(tuple("ABC"), (heavier, *drives)).alike() == {}


near_conditions = st.builds(
    Condition,
    speed_mps=st.integers(0, 30).map(lambda step: 15.0 + 0.1 * step * KPH),
    front_weight_kg=st.integers(0, 10).map(lambda step: 900.0 * (1 + 0.005 * step)),
    rear_weight_kg=st.sampled_from([700.0, 714.0, 720.0]),
    factors=st.sampled_from([(), (("drive", "FWD"),), (("drive", "AWD"),), (("drive", ""), ("seat", "1"))]),
)


@given(st.lists(near_conditions, min_size=1, max_size=8, unique=True), st.lists(near_conditions, max_size=4))
def test_a_test_is_made_for_the_nearest_condition(planned: list[Condition], run: list[Condition]) -> None:
    """As asked of each condition by itself: 1 km/h and 2 % of each weight, and no factor tells them apart."""
    matrix = Matrix(tuple(f"P{i}" for i in range(len(planned))), tuple(planned))
    tests = [(f"T{i}", own) for i, own in enumerate(run)]

    def away(there: Condition, condition: Condition) -> float:
        speed, front, rear = np.abs(there.vector - condition.vector).tolist()
        off = (speed / KPH, front / (0.02 * condition.front_weight_kg), rear / (0.02 * condition.rear_weight_kg))
        return float(max(off))

    found = matrix.made_for(tests)
    for test, there in tests:
        near = {i: away(there, own) for i, own in matrix.items if own.may_be(there)}
        assert (test in found) is any(own <= 1 + 1e-9 for own in near.values())
        assert test not in found or near[found[test]] == pytest.approx(min(near.values()))
    assert matrix.run(tests) == tuple(
        tuple(test for test, there in tests if found.get(test) == i or there.is_at(own)) for i, own in matrix.items
    )
