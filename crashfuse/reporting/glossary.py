"""Definitions of terms that pages and reports explain once each."""

TTZV = (
    "Time of zero velocity (TTZV): the vehicle has come to rest, its crush is at its maximum, and rebound begins. "
    "Counted from contact, at 0 ms. The paper calls it t0, which in crash laboratories means contact."
)
PULSE_SHAPE = (
    "Equivalent square wave: the constant deceleration that stops the vehicle within the same crush. Two-step pulse: "
    "two constant decelerations, G1 then G2, nearest to the pulse until TTZV by least squares. Centroid time: crush "
    "over impact speed. Front-to-back loading ratio: mean deceleration in the first half of TTZV over that in the "
    "second; above 1 the pulse is front-loaded. Static crush and rebound velocity: displacement and velocity "
    "when the vehicle leaves the barrier. Coefficient of restitution: rebound velocity over impact velocity."
)
LF = "LF TCN: low-fidelity (LF) network, trained on CAE runs only."
TIME_DOMAIN = "Time domain: multi-fidelity (MF) network, the LF network fine-tuned on tests."

REPEAT = (
    "A repeat: the rating that a second test at the same condition would get against this one, estimated from how much "
    "the tests of this campaign scatter. A prediction that rates as high is as good as another test."
)

RATING_PARTS = (
    "The overall rating is 0.4 corridor + 0.2 phase + 0.2 magnitude + 0.2 slope. Corridor: how much of the curve lies "
    "near the test. Phase: how little it has to be moved in time to correlate best. Magnitude: how close it is once "
    "moved and warped in time. Slope: how close the slopes are once moved."
)
HUMPS = (
    "A hump rises by a tenth of the largest acceleration above the valleys beside it. It is the same hump in both "
    "curves if dynamic time warping, on the curves as they stand, aligns the peak of each with a moment of the other."
)
