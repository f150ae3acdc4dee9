"""The fixed texts of the page: what was done, and how the paper was read."""

LEAD = (
    "The paper estimates mass, stiffness and damping of an electromagnetic punch from force and "
    "position, and compares an adaptive high-gain observer (AHG) with an extended (EKF) and an "
    "unscented (UKF) Kalman filter, in simulation. Many values are not given; here they are "
    "chosen as described below, and both readings of its Table 1 are studied. In short:"
)

SETUP = (
    "The plant has a mass of 125 kg, a damping of 1500 N s/m, dry friction of 30 N that the "
    "observers know, and a spring of 20 kN/m (soft: as printed in Table 1) or 20 kN/mm (stiff: as "
    "the text describes it). It makes strokes of 4 mm in 38 ms and of 1 mm at 50 Hz, up to "
    "197 mm/s, with a period of 120 ms, led by a controller with feedforward and state feedback. "
    "The force is held over the sampling period of 0.1 ms; the position has white noise of 1 µm; "
    "the truth is integrated in steps of 10 µs. The observers start at the position 0, the punch "
    "at −2 mm.",
    "AHG: double pole, λ = 300 1/s (soft) and 1000 1/s (stiff), Γ from the motion so that all "
    "parameters converge at the rate g = 10 1/s; two Runge-Kutta steps per sample; the consistent "
    "form of eq. 10. EKF and UKF: state [x, v, c, d, 1/m], start deviations of 80 % of the "
    "parameters, measurement noise as it is, process noise of the speed qx in m/s²/√Hz and of the "
    "parameters (0.05 1/√s with qx = 0.01, else 0.01 1/√s; 0.05 1/√s in the jumps).",
    "A parameter has converged when it stays within 5 % for 0.3 s.",
)

EXCITATION = (
    "Table 1 of the paper gives 20 kN/m, but its text says that a very stiff spring hides the "
    "damper. With 20 kN/m it is the spring that hardly matters; with 20 kN/mm spring and force "
    "nearly cancel and the damper is next to nothing. Only the second reading fits the text; root "
    "mean squares of the contributions to the acceleration in m/s²:"
)

TIMES = (
    "Medians over the seeds, and on how many of them the parameter converged at all; observers "
    "that ran on one seed only have one number. Bias and noise are those of the last two seconds, "
    "relative to the truth."
)

FORM = (
    "Equation 10 as printed multiplies Υ Γ Υ' c0' by λ, like k0. The derivation does not need that "
    "factor, and with it the parameters move so slowly that they do not arrive, or the observer "
    "becomes unstable. The library's default leaves it out.",
    "Holding the measurement over the sampling period delays it by half a period; half a period "
    "times the stiffness looks like damping. Joining the samples by straight lines is enough to "
    "avoid that; the default adds the linearly interpolated innovation to the model's prediction.",
)

START = (
    "Starting all of m, c and d too large by the same factor leaves c/m and d/m right. The AHG "
    "estimates c/m, d/m and 1/m, so that one of its three parameters is wrong; the filters "
    "estimate c, d and 1/m, and all three are. If only d is wrong:"
)

BIAS = (
    "The paper explains the filters' failure on the damping by missing excitation and the AHG's "
    "success by its adaptive law. Neither holds: an EKF with little process noise finds the "
    "damping from the same motion, and one that starts at the truth leaves it when the sensor is "
    "noisy. A process noise that is too large makes the filter follow the sensor noise with its "
    "speed; the speed that is multiplied by the damping is then correlated with the next "
    "innovation, and the estimate is biased by an amount that grows with the square of the noise. "
    "The damper's share in the acceleration is so small that this decides."
)

JUMPS = (
    "c jumps by 20 % at 4 s, d by 30 % at 8 s, m by 10 % at 12 s; all observers start at 1.2 p. "
    "Times until the parameter that jumped is within 5 % again, and the largest relative error of "
    "the others. With qx = 1 the filters are biased before the jump, so that a jump may carry the "
    "truth to the estimate: a time of 0 then is no merit."
)

GAINS = (
    "λ between 100 and 1000 1/s, T = 40 ms, γ = 0.6 µm s (soft), between 500 and 2000 1/s, "
    "T = 10 ms, γ = 0.2 µm s (stiff); S is evaluated every millisecond; the stiffness jumps by "
    "20 % at 4 s. γ must lie above what noise alone does to the innovation at the upper limit, "
    "else the gain never comes down."
)

CLAIMS = "Each statement of sections 4.4 to 4.6, decided by the medians or by every recording."

READINGS = (
    "Equation 10: the surplus λ is left out, see above.",
    "Equation 19: the sign of the exponential is wrong (S would be singular at Inn = γ and "
    "negative below); S = 1/(1 + exp(−β (Inn − γ))). The norm is not squared, and the "
    "prediction starts from the estimates at t − T.",
    "Equation 21: F is divided by m, as in eq. 22 and 24. Equation 24: its first two rows are "
    "swapped.",
    "Table 1: both 20 kN/m and 20 kN/mm.",
    "Friction, noise, strokes, sampling, all gains, covariances and Υ(0) are not given; Υ(0) = 0.",
    "Equation 12-14 use noise densities; the filters here are continuous-discrete with the same "
    "noise. They start from a posterior: their first sample counts as not measured.",
    "λ stays between its limits by construction: eq. 17 is integrated exactly for constant S.",
    "'Global' convergence needs bounded parameters and a large λ: about 2.5 times √(c/m) here.",
)

CAPTIONS = {
    "figure2": (
        "As figure 2 of the paper: all parameters start 1.8 times too large, stiff spring; the "
        "filters with the process noise with which they behave as in the paper, and tuned."
    ),
    "figure3": "As figure 3 of the paper: the same with 1.2 times.",
    "figure4": (
        "As figure 4 of the paper: stiffness, damping and mass jump one after the other. With the "
        "stiff spring, mass and damping of the AHG leave the picture after the first jump."
    ),
    "figure5": "As figure 5 of the paper: fixed and adaptive gain while the stiffness jumps.",
}

BIAS_CAPTION = (
    "Error of the damping by the EKF that starts at the true parameters, over the noise of the "
    "sensor, for three values of the process noise that it assumes for the speed."
)

SOURCE = (
    "Paper: Riva, Dagen, Ortmaier, “Adaptive high-gain observer for joint state and parameter "
    "estimation: a comparison to extended and unscented Kalman filter”."
)

LIMITS = (
    "Limits: one plant, one motion, one level of noise. Convergence times of the filters from so "
    "wrong a start depend on the first samples and differ by seed."
)
