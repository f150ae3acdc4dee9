"""The fixed texts of the page: what was done, and how the paper was read."""

LEAD = (
    "The paper estimates displacement, speed, parameters and an unknown force of a nanopositioning "
    "stage while its payload is taken off, and compares a moving horizon observer with two weights "
    "(MHOa: α = 1, MHOb: α = 10⁻⁴) with an extended Kalman filter. Its measured data are not "
    "public; here the stage is simulated, so that the truth is known. In short:"
)

SETUP = (
    "The plant is an oscillator with 423 Hz and a damping ratio of 0.0146 with payload, 483 Hz and "
    "0.0143 without (section VI.B). The payload goes at 0.2 s; displacement and speed stay "
    "continuous, the actuator's gain per mass changes like the stiffness per mass, and a force "
    "pulse of 3 ms and a constant force act from then on. A pseudo-random binary voltage of ±1.5 V "
    "excites the stage, the sensor has white noise of 10⁻³ µm, the sampling period is 0.1 ms, and "
    "u and y both pass the paper's band-pass filter. The truth is integrated with another method "
    "and 2.5 times finer than the estimators do.",
    "In the scenario mode2 the plant has a second mode in parallel (1100 Hz, damping ratio 0.02, "
    "4 % of the static displacement) that no estimator knows of, like the real stage.",
    "Estimators, noise and start values are those of section VI.C and D. The window is solved in "
    "two ways: converged (Gauss-Newton with exact derivatives until the step is negligible), and "
    "with the paper's rule (BFGS from the identity, ended when the cost changes by less than "
    "2·10⁻⁵ (1 + |J|) or the state by 10⁻⁶), an emulation of the general-purpose routine that the "
    "paper used.",
)

TABLE_ONE = (
    "Root square errors (eq. 44) over all samples but the first and the last: RSE x1 against the "
    "measured displacement, RSE x2 against the speed differentiated from it (eq. 39). The "
    "amplitude of the excitation was chosen so that RSE x2 has the size of the paper's; "
    "only the ratios to the EKF can be compared."
)

TRUTH = (
    "Errors against the true speed after the first 200 samples; the time from the removal until "
    "k/m stays within 2 % for 10 ms ('–' if it does not on every recording); the relative scatter "
    "of the parameters from 0.1 s after the removal on, which still contains the drift of those "
    "that converge slowly, and of their steps from sample to sample.",
    "The mean NIS of an honest covariance is 1. Much smaller values mean that the noise assumed in "
    "the paper's tuning is far larger than what the simulated stage needs.",
)

CLAIMS = (
    "Each statement of the paper's abstract and section VI.E, decided on every recording. 'Yes' "
    "means that it holds on all of them. The numbers behind the words are in claims.csv."
)

SOLVERS = (
    "The paper's cost J is a sum of squares of scaled quantities and of the order of 10⁻⁶. Its "
    "tolerance on the change of J is therefore in effect absolute, and ends the iterations after "
    "the first steps. What is reached by then depends on the steps: BFGS from the identity begins "
    "with a steepest descent.",
    "The tables have an EKF with another tuning beside the paper's: its parameters may change "
    "faster, σ3 and σ5 are ten times and σ4 twenty times as large. It shows how much of a "
    "difference between methods is one between tunings.",
)

CAPTIONS = {
    "figure4": (
        "As figure 4 of the paper: displacement and speed errors of EKF and MHOa; below, the error "
        "against the true speed."
    ),
    "figure5": "As figure 5 of the paper: parameters and disturbance, EKF and MHOa.",
    "figure6": (
        "As figure 6 of the paper: displacement and speed errors of EKF and MHOb. Where only one "
        "line can be seen, the two coincide."
    ),
    "figure7": (
        "As figure 7 of the paper: parameters and disturbance, EKF and MHOb. Where only one line "
        "can be seen, the two coincide."
    ),
    "transient": "Relative error of k/m after the removal of the payload.",
}

SWEEP = (
    "Measures over the weight α of the measurements in the window, converged. Towards small "
    "weights the observer becomes the EKF."
)

READINGS = (
    "The band-pass filter is printed with 2ζπf in place of 2ζωn; the damping ratio of the text, "
    "0.1, is used.",
    "S = R P⁻¹ (eq. 43) with a scalar R: J/R then weighs the prior by P⁻¹ and every measurement by "
    "α/R, so that α = 1 is the statistical weight and α = 10⁻⁴ treats the sensor as 100 times "
    "noisier.",
    "Q is a spectral density, the variance per sample divided by the sampling period; the "
    "covariance equation is integrated by Heun's method with the Jacobian frozen at the last "
    "estimate (eq. 14-16).",
    "The bounds of eq. 27 are not given; k/m, b/m and c/m are kept from becoming negative, in the "
    "window and by clipping in the filters, as section VI.C says.",
    "The paper starts from a posterior at sample 0. Here that sample counts as not measured, "
    "which is the same.",
    "The observer's first estimate is at sample 16; before, the EKF's is used, and errors are "
    "summed from sample 1.",
    "x6 estimates the force behind the filter, plus what filtering and a jump of the parameters do "
    "to each other for some milliseconds; a constant force is invisible behind a high-pass filter.",
    "'N = 15 captures one oscillation period' is not so: see the checks.",
)

SOURCE = (
    "Paper: Polóni, Eielsen, Rohaľ-Ilkiv, Johansen, “Moving horizon observer for vibration "
    "dynamics with plant uncertainties in nanopositioning system estimation”, American Control "
    "Conference 2012."
)

LIMITS = (
    "Limits: the stage is simulated; force pulse, excitation and second mode are plausible "
    "guesses. A statement that holds here need not hold on the measured data, and the other way "
    "round."
)
