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
