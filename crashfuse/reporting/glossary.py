"""Definitions of terms that pages and reports explain once each."""

TTZV = (
    "Time of zero velocity (TTZV), counted from contact: crush is at its maximum, and rebound begins. The paper calls "
    "it t0, which in crash laboratories means contact."
)
METRICS = {
    "peak": "Largest deceleration.",
    "peak_time": "From contact to the largest deceleration.",
    "delta_v": "Largest change of velocity, that of the rebound included.",
    "t0": TTZV,
    "max_crush": "Displacement at zero velocity, where it is largest.",
    "mean": "Impact speed over the time of zero velocity.",
    "sm25": "Largest loss of velocity within 25 ms, over 25 ms.",
    "olc": "Deceleration of an occupant who first moves freely and is then stopped evenly by the restraint.",
    "vpi": "Largest deceleration of an occupant on a spring with slack (ISO/TR 12353-3).",
}
"""What the metrics of the tables mean."""
PULSE_SHAPE = (
    "Equivalent square wave: the constant deceleration that stops the vehicle within the same crush. Two-step pulse: "
    "G1 then G2, nearest to the pulse until TTZV by least squares. Centroid time: crush over impact speed. "
    "Front-to-back loading ratio: mean deceleration in the first half of TTZV over that in the second. Static crush "
    "and rebound velocity: when the vehicle leaves the barrier. Coefficient of restitution: rebound over impact "
    "velocity."
)
LF = "LF TCN: low-fidelity (LF) network, trained on CAE runs only."
TIME_DOMAIN = "Time domain: multi-fidelity (MF) network, the LF network fine-tuned on tests."

REPEAT = (
    "A repeat: the rating of a second test at the same condition against this one, estimated from the scatter of the "
    "campaign's tests. A prediction that rates as high is as good as another test."
)

DRAWS = (
    "95 % of the ratings of single pulses drawn from the band, which oscillate more than the expected one and so rate "
    "lower."
)
RATING_PARTS = (
    "Overall = 0.4 corridor + 0.2 phase + 0.2 magnitude + 0.2 slope. Corridor: how much of the curve lies near the "
    "test. Phase: how little it has to be moved in time to correlate best. Magnitude: how close it is once moved and "
    "warped in time. Slope: how close the slopes are once moved."
)
HUMPS = (
    "A hump rises by a tenth of the largest acceleration above the valleys beside it. Humps are the same in both "
    "curves if dynamic time warping aligns the peak of each with a moment of the other."
)
