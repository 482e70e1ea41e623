"""A time history of Radioss in memory, record by record as the solver writes it."""

import struct

import numpy as np

from crashfuse.units import G
from tests.importing.crashes import SPEED_MPS, half_sine_g

END_MS = 120.0


def time_history(codes: tuple[int, ...] = (1, 4, 7), layout: int = 3040, step_ms: float = 0.1) -> bytes:
    """A car in mm, ms and kg with an engine and a cell, and energies that a half sine knows nothing of."""
    time_ms = np.arange(0.0, END_MS, step_ms)
    width = 100 if layout >= 4021 else 40

    def record(*parts: object) -> bytes:
        body = b"".join(part if isinstance(part, bytes) else struct.pack(">i", part) for part in parts)
        return struct.pack(">i", len(body)) + body + struct.pack(">i", len(body))

    def title(text: str) -> bytes:
        return text.encode().ljust(width)

    content = record(layout, b"Nova".ljust(80)) + record(b"today".ljust(80))
    if layout > 3050:
        content += record(100) + record(np.array([1.0, 1e-3, 1e-3], ">f4").tobytes())
    content += record(1, 1, 1, 1, 2, 22) + record(*range(1, 23))
    content += record(1, title("rail"), 0, 1, 1, 1) + record(1) + record(1, title("steel")) + record(1, title("shell"))
    content += record(0, 0, 0, 1, 0, title("GLOBAL MODEL")) + record(1)
    content += (
        record(1, 0, 0, 2, len(codes), title("mains")) + record(690, title("engine")) + record(758, title("cell"))
    )
    content += record(*codes)
    content += record(2, 102, 0, 1, 2, title("wall")) + record(1, title("w")) + record(1, 2)
    accel = half_sine_g(time_ms * 1e-3) * G * 1e-3  # mm/ms²
    velocity = SPEED_MPS + np.concatenate([[0.0], np.cumsum((accel[1:] + accel[:-1]) / 2)]) * step_ms
    for state, time in enumerate(time_ms):
        spent = state / time_ms.size
        told = np.zeros(22)
        told[[0, 1, 7, 8, 10, 11]] = [80 * spent, 100 - 90 * spent, 1 * spent, -3 * spent, 2 * spent, 4 * spent]
        told[[5, 17]] = [1700.0, 1.25]
        content += record(struct.pack(">f", time)) + record(told.astype(">f4").tobytes())
        content += record(np.zeros(1, ">f4").tobytes())
        nodes = [
            [{4: -scale * velocity[state], 7: -scale * accel[state]}.get(code, 0.0) for code in codes]
            for scale in (1.2, 1.0)
        ]
        content += record(np.array(nodes, ">f4").tobytes()) + record(np.zeros(2, ">f4").tobytes())
    return content
