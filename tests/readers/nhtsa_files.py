"""A small NHTSA test in memory: a specification and a channel a sensor."""

from crashfuse.signals.pulse import FloatArray
from crashfuse.units import G
from tests.importing.crashes import clock, half_sine_g, ringing_g, scatter_g

SENSORS = {
    1: ("AC", "01", "HDCG", "XL", "G'S", "AM", "P", "DRIVER HEAD X"),
    93: ("AC", "NA", "FLLR", "XG", "G'S", "AM", "P", "LEFT REAR SEAT CROSSMEMBER X"),
    94: ("AC", "NA", "FLRR", "XG", "G'S", "AM", "P", "RIGHT REAR SEAT CROSSMEMBER X"),
    95: ("AC", "NA", "ENGN", "XG", "G'S", "AM", "P", "TOP OF ENGINE X"),
    97: ("AC", "NA", "FLLR", "ZG", "G'S", "AM", "P", "LEFT REAR SEAT CROSSMEMBER Z"),
    99: ("AC", "NA", "FLLR", "XG", "G'S", "AM", "R", "LEFT REAR SEAT CROSSMEMBER XR"),
    100: ("AC", "NA", "FLRR", "XG", "G'S", "CF", "R", "RIGHT REAR SEAT CROSSMEMBER XR"),
    101: ("LC", "NA", "LC01", "XG", "NWT", "AM", "P", "BARRIER A-1"),
}


def specification(speed: str = "56.0", behind: str = "1200", setup: str = "VTB", number: int = 5) -> str:
    """An EV5 file in the form of the database's own."""
    test = ["V5", "2099 NOVA TEST", *[""] * 5, "NCA", setup, *[""] * 2, "22", *[""] * 2, speed, *["0"] * 3, "8", ""]
    car = ["1", "00", "00", "2099", *[""] * 6, "1700", "1500", "2700", "4800", "1800", behind, *[""] * 25, speed, "0"]
    lines = [f"# Source: Test Number: {number}", "----- EV5 -----", "----- TEST -----", "|".join(test)]
    lines += ["----- VEHICLE -----", "|".join(car), "----- BARRIER -----", "R|LCB|0|0|", "----- INSTRUMENTATION -----"]
    for curve, (kind, seat, place, axis, unit, data, rank, name) in SENSORS.items():
        vehicle = "0" if kind == "LC" else "1"
        fields = [vehicle, str(curve), kind, seat, place, axis, "SEC", unit, "2800", "", "", "800", "21", speed]
        lines.append("|".join([*fields, "-500", "2999", "100", data, rank, name]))
    return "\n".join([*lines, "----- END -----"])


def samples(time_s: FloatArray, values: FloatArray) -> str:
    return "".join(f"{t:f}\t{value:f}\n" for t, value in zip(time_s.tolist(), values.tolist(), strict=True))


def nhtsa_files(number: int = 5, **of_specification: str) -> dict[str, bytes]:
    """Files of a whole test, by name: raw pulses, left a little harder than right."""
    time_s = clock()
    raw = half_sine_g(time_s) + scatter_g(time_s, 2.0 * (number - 5)) + ringing_g(time_s)
    scales = {93: 1.02, 94: 0.98, 95: 3.0, 99: 1.02, 100: 0.1, 101: 1700 * G}
    texts = {f"v{number:05d}.{curve:03d}": samples(time_s, scales.get(curve, 0.5) * raw) for curve in SENSORS}
    texts[f"v{number:05d}.EV5"] = specification(number=number, **of_specification)
    return {name: text.encode("latin-1") for name, text in texts.items()}
