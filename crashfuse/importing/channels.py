"""The channels of a record that are averaged into the pulse: those chosen, or those proposed that agree."""

import numpy as np

from crashfuse.campaign_folder.plausibility import CREEP_MPS
from crashfuse.errors import DataError, Problem
from crashfuse.importing.choices import Choices
from crashfuse.importing.detection import delta_v
from crashfuse.importing.sampling import even, on_one_clock
from crashfuse.readers.quantities import speed
from crashfuse.readers.record import Record, RecordedChannel, quoted
from crashfuse.readers.unit_spelling import ACCELERATION_UNITS
from crashfuse.signals.pulse import FloatArray
from crashfuse.wording import Sentence, joined, number

_DISSENT = 0.2  # of the larger ΔV of two


def missing_choices(record: Record, choices: Choices) -> list[Problem]:
    """Missing choices about the channels: which ones, and their unit if there is no speed to infer it from."""
    chosen = record.chosen(choices.channels)
    missing = []
    if not chosen:
        expected = f"a channel of {record.id} that is known to be the vehicle's pulse"
        advice = f"choose the one that is, or several to be averaged (--channel {quoted(record.channels[0].name)})"
        missing.append(Problem(record.source, expected, record.listed, advice))
    speeds = (record.condition.speed_mps, choices.condition.speed_mps)
    if choices.unit is None and speeds == (None, None) and not any(one.unit for one in chosen or record.channels):
        expected = f"the unit of the acceleration of {record.id}"
        missing.append(Problem(record.source, expected, "none", "give the unit if the speed does not tell it (--unit)"))
    return missing


def agreeing_channels(
    record: Record, choices: Choices, speed_mps: float, steps: list[str]
) -> tuple[RecordedChannel, ...]:
    """The channels to average: those chosen, else the largest group of proposed channels whose ΔV agrees."""
    chosen = record.chosen(choices.channels)
    if choices.channels:
        steps.append(f"Channels chosen by the user: {', '.join(channel.name for channel in chosen)}.")
    units = {choices.unit or channel.unit for channel in chosen}
    if len(chosen) == 1 or len(units) > 1 or speed_mps <= CREEP_MPS:
        return chosen
    gains = np.array([delta_v(*even(channel, record.source)[:2]) for channel in chosen])
    agree = np.abs(gains[:, None] - gains) <= _DISSENT * np.maximum.outer(np.abs(gains), np.abs(gains))
    with_most = agree[agree.sum(axis=1).argmax()]
    if with_most.all():
        return chosen
    factor = ACCELERATION_UNITS.get(units.pop() or "")
    told = [
        Sentence(
            "{}: {}",
            channel.name,
            f"integral {number(gain, '.4g')} (unit not stated)" if factor is None else speed(gain * factor),
        )
        for channel, gain in zip(chosen, gains.tolist(), strict=True)
    ]
    if choices.channels:
        careful = "Careful: the channels that are averaged differ in their changes of velocity, {}."
        steps.append(Sentence(careful, joined(told, ", ")))
        return chosen
    if with_most.sum() * 2 <= len(chosen):
        expected, found = f"channels of {record.id} that agree in their change of velocity", joined(told, ", ")
        raise DataError(Problem(record.source, expected, found, "choose one (--channel)"))
    odd = joined([text for text, near in zip(told, with_most, strict=True) if not near], ", ")
    steps.append(Sentence("Left out for a change of velocity unlike the others': {}.", odd))
    return tuple(channel for channel, near in zip(chosen, with_most, strict=True) if near)


def averaged(
    record: Record, channels: tuple[RecordedChannel, ...], choices: Choices, steps: list[str]
) -> tuple[FloatArray, FloatArray]:
    """The time and the mean of the channels, in the unit of the first."""
    if choices.unit is None and len({channel.unit for channel in channels}) > 1:
        found = ", ".join(f"{channel.name} in {channel.unit or 'an unknown one'}" for channel in channels)
        raise DataError(Problem(record.source, "channels of one unit to average", found, "choose some of them"))
    time_s, values = on_one_clock(channels, record.source, steps)
    if len(channels) > 1:
        steps.append(f"{len(channels)} channels averaged.")
    return time_s, values.mean(axis=0)
