"""Definitions of terms that pages and reports explain once each."""

TTZV = "Time of zero velocity (TTZV), from contact: crush is largest, rebound begins. The paper's t0."
METRICS = {
    "peak": "Largest deceleration.",
    "peak_time": "From contact to the largest deceleration.",
    "delta_v": "Largest change of velocity, rebound included.",
    "t0": TTZV,
    "max_crush": "Displacement at zero velocity, the largest.",
    "mean": "Impact speed over the time of zero velocity.",
    "sm25": "Largest loss of velocity within 25 ms, over 25 ms.",
    "olc": "Deceleration of an occupant who moves freely, then is stopped evenly by the restraint.",
    "vpi": "Largest deceleration of an occupant on a spring with slack (ISO/TR 12353-3).",
}
PULSE_SHAPE = (
    "Equivalent square wave: constant deceleration with the same crush. Two-step pulse: G1, then G2, by least squares "
    "until TTZV. Centroid time: crush over impact speed. Front-to-back loading ratio: mean deceleration in the first "
    "half of TTZV over the second. Static crush, rebound velocity: on leaving the barrier. Restitution: rebound over "
    "impact velocity."
)
LF = "LF TCN: low-fidelity (LF) network, trained on CAE runs only."
TIME_DOMAIN = "Time domain: multi-fidelity (MF) network, the LF network fine-tuned on tests."
REPEAT = (
    "A repeat: rating of a second test at the same condition, estimated from the scatter of the tests. A prediction "
    "that rates as high is as good as a test."
)
DRAWS = "95 % of the ratings of single pulses drawn from the band, which oscillate more and so rate lower."
RATING_PARTS = (
    "Overall = 0.4 corridor + 0.2 phase + 0.2 magnitude + 0.2 slope. Corridor: share of the curve near the test. "
    "Phase: how little it is moved in time. Magnitude: closeness once moved and warped. Slope: closeness of slopes "
    "once moved."
)
HUMPS = (
    "A hump rises above its valleys by a tenth of the largest acceleration. Dynamic time warping finds it in the other "
    "curve."
)
