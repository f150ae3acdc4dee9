"""The fixed texts of the page: what was done, and how the paper was read."""

LEAD = (
    "The paper finds out where, when and how hard a cantilever beam is hit: eight places, three "
    "displacement sensors, and no more knowledge of the forces than that few act at a time. A "
    "moving horizon estimator minimises model and measurement error and the l1 norm of the forces. "
    "Here sections 4.1 to 4.4 are worked through. In short:"
)

SETUP = (
    "A cantilever, 405 × 25 × 3 mm, its first three modes; sensors at 245, 325 and 405 mm, "
    "400 samples per second. Four hits, each held over one sampling period: −10 N at 405 mm, −5 N "
    "at 365 mm, 5 N at 285 mm and 10 N at 165 mm, at 30, 60, 90 and 120 ms. The recording has 61 "
    "samples, so that the last hit passes through a whole window of 11 samples; there are 51 full "
    "windows. The true beam is 3 mm thick; the estimators' are thinner, which shifts all "
    "frequencies by 0, −3.3, −6.7 and −10 %, and changes their masses, too.",
    "MSE is the mean square error of all 80 forces of all windows; the output of a window is at "
    "its first step, k = T − N + 1. A false force is an output of at least 1 N where nothing "
    "struck.",
)

READINGS = (
    "The values of Table 3 are powers of e: ε_R = e^5 1e-10 m²; ε_Q = e^2, e^5, e^11, e^11 times "
    "1e-2; λ = e^15, e^19.5, e^14.5, e^15 times 1e-10.",
    "ε_Q scales B B', the covariance of independent forces at the eight places. With Q = ε_Q I, in "
    "mass-normalised modes, the process noise explains every recording and no force is found, "
    "whatever the setting of Table 3; see the table below. Q is singular then (rank 3), and is "
    "never inverted here.",
    "There is no factor 1/2 in the cost.",
    "The paper mentions no noise. Its own weights are good without noise only: with 10 µm they "
    "find forces that are not there, up to dozens of them; see the checks.",
    "α* (eq. 13) can be read in three ways. I: a quadratic prior on the same α, the l1 norm stays. "
    "II: the same, and elements with a prior leave the l1 norm. III: separate extra states, "
    "u = α + α*, as in “n extra states” of Algorithm 1.",
    "Q_drift is not in the text. The variance of one force is about 2000 N² with ε_Q = 599 N² "
    "(0.5 N² with 0.074), so a small Q_drift freezes the first, worst guess: 0.1 to 1 N² with "
    "reading I, 100 to 1000 N² with II and III, growing linearly from the first to the last step.",
    "The covariance of a problem with an l1 norm is that of the least-squares problem in which the "
    "forces that are zero stay zero and the others are free.",
    "The smoothed arrival cost is as written in the paper, although it counts measurements twice.",
    "The discarded energy is spread in proportion over the forces that are kept, so that the sum "
    "of all magnitudes of the recording stays.",
)

CASES = (
    "Without noise. “No carryover” is Algorithm 1 without lines 5 to 14. The second setting is the "
    "one that is best for the largest mismatch, taken for all four."
)

COVARIANCE = (
    "Weight λ from which on no window contains any force, for both readings of ε_Q, beside λ of "
    "Table 3; and the least MSE with squares instead of the l1 norm, whatever their weight."
)

FILTERS = (
    "Filters that know nothing of sparsity, without noise: a Kalman filter whose states are "
    "augmented by forces as random walks, and the joint input and state filter, to which forces "
    "may do anything. Both have background forces of 1e-3 N at all places and ε_R of Table 3. The "
    "variance of the walks' steps, 1e-4 to 1e6 N² per sample, is the best one; so is the "
    "choice between the filter one sample later, which is when a force is first seen, and the "
    "smoother over the whole recording. Three places are observable, but must be the right ones: "
    "at those of F1, F3 and F4, with a true model, little more than F2 is missed. The sensors' "
    "places, or those of F1, F2 and F3, are hardly better than no force at all, and the joint "
    "filter explains the hits elsewhere by large forces at these places that cancel."
)

CLAIMS = "Each statement is decided by the numbers below it."

CAPTIONS = {
    "fig5": "Fig. 5. Three sensors show three constant forces, and eight places act through three "
    "modal forces: random walks can follow three places, whichever comes first.",
    "fig6": "Fig. 6. Error over λ with ε_Q, ε_R of Table 3, no carryover. Without noise and model "
    "error there is no minimum: the smaller λ, the better.",
    "fig7_8": "Fig. 7 and 8. Least error over λ, and the λ for it, without noise and carryover. "
    "Only ε_Q / ε_R counts; along a line of constant ratio λ goes as 1 / ε.",
    "fig9": "Fig. 9. States and forces of window 7, true model, Table 3.",
    "fig10": "Fig. 10. Outputs over the recording, reading I, Table 3, and spread as the paper "
    "does; right: with a model error of −3.3 %.",
    "fig11": "Fig. 11. All windows, reading I, Table 3.",
    "fig12": "Fig. 12. One window with a model error of −10 %, reading I, Table 3.",
    "fig13": "Fig. 13. Outputs with a model error of −10 % above two thresholds; as Fig. 12.",
}

SOURCE = (
    "Source: Kirchner, Croes, Cosco, Desmet, “Exploiting input sparsity for joint state/input "
    "moving horizon estimation”, Mechanical Systems and Signal Processing 101, 2018, "
    "doi:10.1016/j.ymssp.2017.08.024."
)

LIMITS = (
    "The weights were chosen with the truth known, as in the paper. Which covariance ε_Q scales, "
    "Q_drift, and the length of the recording are decisions of this study, not of the text. "
    "Numbers to meet are of an independent implementation of the same decisions."
)
