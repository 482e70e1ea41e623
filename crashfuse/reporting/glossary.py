"""Definitions of terms that pages and reports explain once each."""

TTZV = (
    "Time of zero velocity (TTZV), counted from contact: crush is largest, and rebound begins. The paper calls it t0."
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
PULSE_SHAPE = (
    "Equivalent square wave: the constant deceleration with the same crush. Two-step pulse: G1 then G2, nearest to the "
    "pulse until TTZV by least squares. Centroid time: crush over impact speed. Front-to-back loading ratio: mean "
    "deceleration in the first half of TTZV over that in the second. Static crush and rebound velocity: when the "
    "vehicle leaves the barrier. Coefficient of restitution: rebound over impact velocity."
)
LF = "LF TCN: low-fidelity (LF) network, trained on CAE runs only."
TIME_DOMAIN = "Time domain: multi-fidelity (MF) network, the LF network fine-tuned on tests."
REPEAT = (
    "A repeat: the rating of a second test at the same condition, estimated from the scatter of the campaign's tests. "
    "A prediction that rates as high is as good as another test."
)
DRAWS = "95 % of the ratings of single pulses drawn from the band, which oscillate more and so rate lower."
RATING_PARTS = (
    "Overall = 0.4 corridor + 0.2 phase + 0.2 magnitude + 0.2 slope. Corridor: how much of the curve is near the test. "
    "Phase: how little it has to be moved in time. Magnitude: how close it is once moved and warped. Slope: how close "
    "slopes are once moved."
)
HUMPS = (
    "A hump rises by a tenth of the largest acceleration above the valleys beside it. Dynamic time warping finds the "
    "same hump in the other curve."
)
