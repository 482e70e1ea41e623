"""Scales of TDMS channels: the values of npTDMS, an independent reader, whatever level and order they stand in."""

from io import BytesIO
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nptdms import ChannelObject, GroupObject, RootObject, TdmsFile

from crashfuse.errors import DataError
from crashfuse.readers.tdms_container import parse_tdms
from tests.readers.test_tdms import written

RAW = 0xFFFFFFFF
VALUES = np.linspace(-2000, 2000, 41).astype(np.int16)
Scale = dict[str, Any]


def linear(n: int, slope: float, intercept: float = 0.0, source: int = RAW) -> Scale:
    told = {"Slope": slope, "Y_Intercept": intercept, "Input_Source": np.uint32(source)}
    return kind(n, "Linear", told)


def kind(n: int, name: str, told: Scale) -> Scale:
    return {f"NI_Scale[{n}]_Scale_Type": name} | {f"NI_Scale[{n}]_{name}_{key}": value for key, value in told.items()}


def polynomial(n: int, *coefficients: float) -> Scale:
    told = {f"Coefficients[{i}]": value for i, value in enumerate(coefficients)}
    return kind(n, "Polynomial", {"Coefficients_Size": np.uint32(len(coefficients)), **told})


def table(n: int, source: int = RAW) -> Scale:
    pairs = ((3000.0, -1.0), (0.0, 0.5), (-3000.0, 4.0))
    told = {f"Pre_Scaled_Values[{i}]": x for i, (x, _) in enumerate(pairs)}
    told |= {f"Scaled_Values[{i}]": y for i, (_, y) in enumerate(pairs)}
    size = np.uint32(len(pairs))
    sizes = {"Pre_Scaled_Values_Size": size, "Scaled_Values_Size": size, "Input_Source": np.uint32(source)}
    return kind(n, "Table", told | sizes)


def both(n: int, name: str, left: int, right: int) -> Scale:
    told = {"Left_Operand_Input_Source": np.uint32(left), "Right_Operand_Input_Source": np.uint32(right)}
    return kind(n, name, told)


def file_of(channel: Scale, group: Scale | None = None, root: Scale | None = None) -> bytes:
    """A file of one channel with properties at each level."""
    parts = [RootObject(properties=root or {}), GroupObject("g", properties=group or {})]
    return written([*parts, ChannelObject("g", "a", VALUES, properties=channel)])


def ours(content: bytes) -> np.ndarray[Any, Any]:
    file = parse_tdms(content, "it")
    return file.values(file.channels[0])


CHAIN = {**linear(0, 0.5, 3.0), **polynomial(1, 1.0, -0.2, 1e-4), **both(2, "Subtract", 0, 1), **table(3, 2)}
COUNT = {"NI_Number_Of_Scales": np.uint32(1)}
SCALED = {"NI_Scaling_Status": "scaled"}


@pytest.mark.parametrize(
    ("channel", "group", "root"),
    [
        (linear(0, 0.88), {}, {}),  # without their number
        (linear(0, 0.88) | COUNT, {}, {}),
        ({}, linear(0, 0.88) | COUNT, {}),
        ({}, {}, linear(0, 0.88, 1.0)),
        (linear(0, 2.0), linear(0, 3.0), linear(0, 5.0)),  # the channel's before the group's before the file's
        ({}, linear(0, 3.0), linear(0, 5.0)),
        (linear(0, 0.88) | SCALED, {}, {}),
        ({}, linear(0, 0.88) | SCALED, {}),
        (CHAIN, {}, {}),
        (CHAIN | COUNT, {}, {}),  # the first alone
        (
            {**linear(0, 2.0), **both(1, "Add", 0, RAW), **kind(2, "AdvancedAPI", {"Input_Source": np.uint32(1)})},
            {},
            {},
        ),
    ],
)
def test_values_are_those_of_nptdms(channel: Scale, group: Scale, root: Scale) -> None:
    content = file_of(channel, group, root)
    expected = TdmsFile.read(BytesIO(content))["g"]["a"][:]
    np.testing.assert_allclose(ours(content), expected, rtol=1e-12, atol=1e-12)


@given(st.lists(st.tuples(st.floats(-3, 3), st.floats(-50, 50)), min_size=1, max_size=8))
def test_any_chain_of_linear_scales_is_their_product(chain: list[tuple[float, float]]) -> None:
    scales: Scale = {}
    expected = VALUES.astype(float)
    for n, (slope, intercept) in enumerate(chain):
        scales |= linear(n, slope, intercept, n - 1 if n else RAW)
        expected = slope * expected + intercept
    np.testing.assert_allclose(ours(file_of(scales)), expected, rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize(
    ("scales", "found"),
    [
        (linear(0, 1.0, source=0), "in a circle"),
        ({**linear(0, 1.0, source=1), **linear(1, 1.0, source=0)}, "in a circle"),
        ({k: v for n in range(40) for k, v in both(n, "Add", max(n - 1, 0), max(n - 1, 0)).items()}, "in a circle"),
        (linear(0, 1.0, source=7), "scale 7 of the kind none"),
        (kind(0, "Linear", {"Slope": 2.0}), "without y_intercept"),
        (kind(0, "Linear", {"Slope": "2", "Y_Intercept": 0.0}), "without slope"),
        (kind(0, "Strain", {"Configuration": np.uint32(10183)}), "of the kind Strain"),
        (kind(0, "Thermocouple", {}), "of the kind Thermocouple"),
        (kind(0, "Polynomial", {"Coefficients_Size": np.uint32(4_000_000_000)}), "4,000,000,000 coefficients"),
        ({"NI_Number_Of_Scales": "three"}, "ni_number_of_scales three"),
    ],
)
def test_scales_that_give_no_acceleration_are_refused_at_once(scales: Scale, found: str) -> None:
    """Those that take themselves for input, too, which would go on for ever."""
    with pytest.raises(DataError, match=f"expected scales that give an acceleration, found .*{found}"):
        ours(file_of(scales))
