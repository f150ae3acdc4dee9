"""The fixed texts of the page."""

LEAD = (
    "A moving horizon estimator sees the last N + 1 samples. What came before is summed up in the "
    "arrival cost, a prior for the first state of the window. This study compares the arrival "
    "costs that the library offers, on a linear plant where the right answer is known, and on "
    "three nonlinear ones where a linearisation can fail. In short:"
)

SETUP = (
    "Every estimator is told the true covariances of the noise and the same prior, gets the same "
    "recordings, and iterates to convergence. The numbers are medians over the recordings unless "
    "they say otherwise; the error is the root mean square over the second half of a recording. A "
    "recording is lost when the error is larger than the standard deviation of the prior: not to "
    "measure at all would have been better. Bands have two standard deviations to each side, 95.4 "
    "% of a normal distribution; their coverage counts all states and samples.",
    "None: nothing from before the window counts. Constant: the mean is the estimate of the last "
    "window, the covariance always that of the prior. EKF and UKF: an extended or unscented Kalman "
    "filter that runs N samples behind. Smoothed: one step of a Kalman filter whose derivatives "
    "are taken along the trajectory that the whole window sees, the default. Smoothed, naive: mean "
    "and covariance of the smoothed state itself, so that the measurements in the window count "
    "again and again.",
)

SPRING = (
    "Mass, spring and damper with a white unknown acceleration: the plant of an example that ships "
    "with CasADi and that was reported to be worse than a Kalman filter because its arrival cost "
    "is wrong (github.com/casadi/casadi/issues/4226). On a linear plant with Gaussian noise "
    "nothing is better than the Kalman filter, and an estimator with the right arrival cost equals "
    "it for every horizon. The distance is the largest one at any sample, in standard deviations."
)

REACTOR = (
    "Two gases in a batch reactor, 2 A ⇌ B, k = 0.16 and 0.0064 per minute and atm; the whole "
    "pressure is measured with 0.1 atm of noise every 0.1 min. It starts with 3 and 1 atm, and the "
    "estimators believe 0.1 and 4.5 atm, give or take 6 atm: the first example of Haseltine and "
    "Rawlings, Ind. Eng. Chem. Res. 44 (2005) 2451, doi:10.1021/ie034308l. A negative pressure of "
    "A explains the pressure nearly as well. The right optimum is found if both pressures are "
    "within 0.1 atm at the end.",
    "The extended Kalman filter goes to a negative pressure and mostly stays there. Clipping it to "
    "zero keeps it possible, but not right: its covariance has become small on the way, and the "
    "bands do not hold the truth. Bounds alone do not help: without an arrival cost a short window "
    "cannot tell the gases apart. Nor does the arrival cost alone: without bounds the window stays "
    "at the wrong optimum. Both together find the right one. So does, in this example, a clipped "
    "unscented filter.",
)

OTHERS = (
    "Van der Pol oscillator, q'' = μ (1 − q²) q' − q, with μ = 2 ± 1 unknown, and a driven Duffing "
    "oscillator, q'' = u − k1 q − d q' − k3 q³, with all of k1, d, k3 known to a half. Only the "
    "displacement is measured. Start and parameters of each recording are drawn from the prior, so "
    "that a consistent estimator covers the truth as often as it says."
)

MACHINES = (
    "The recordings of two real machines (nonlinearbenchmark.org), all parameters wrong by half at "
    "the start. Silverbox: an electronic Duffing oscillator, everything per unit of mass. EMPS: a "
    "positioning drive with friction, and a disturbance force as unknown input that fades within "
    "50 ms; frictions are bounded from below by zero. The time is that after which the parameter "
    "stays within its tolerance of the value that others found."
)

MISSING = (
    "No recordings of real machines were found. Set the environment variable BACKSIGHT_DATA to the "
    "folder that the problem files examples/silverbox and examples/emps describe, and run the "
    "study again."
)

CAPTIONS = {
    "reactor": "Batch reactor, first recording: both pressures, the band of the moving horizon "
    "estimator with the smoothed arrival cost, and the truth.",
    "horizon": "Median error over the horizon. What is not drawn has lost most recordings. A right "
    "arrival cost makes the result independent of the horizon.",
    "bands": "How often bands of two deviations hold the truth; 95.4 % is right. The naive "
    "smoothed arrival cost is too sure of itself, most of all about parameters.",
}

START_CAPTION = "{}: parameters divided by their references, from starts that are wrong by half."

LIMITS = (
    "The plants are few and small. An arrival cost that sums up the past as a Gaussian cannot be "
    "right where the past leaves two possibilities open; here bounds exclude one of them."
)

SOURCE = (
    "Sources: Haseltine, Rawlings (2005), doi:10.1021/ie034308l; Rao, Rawlings, Mayne (2003), "
    "doi:10.1109/TAC.2002.808470; Wigren, Schoukens (2013), doi:10.23919/ECC.2013.6669201; Janot, "
    "Gautier, Brunot (2019), Data set and reference models of EMPS."
)
